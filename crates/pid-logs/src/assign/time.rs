//! The channel of times of each table.

use super::{Finder, mapped::Mapped};
use crate::error::LogError;
use crate::map::Kind;
use crate::units::{Dimension, Unit};

impl Finder<'_> {
    /// For each clock without stamps the channel of its times; `None` where the step is given.
    pub(crate) fn time(&mut self, mapped: &Mapped) -> Result<Vec<Option<(usize, Unit)>>, LogError> {
        let log = self.log;
        let mut out = Vec::new();
        for (k, clock) in log.clocks.iter().enumerate() {
            if let Some((i, unit)) = &mapped.time
                && log.channels[*i].clock == k
            {
                out.push(Some((*i, self.time_unit(*i, unit.clone())?)));
                continue;
            }
            if clock.t.is_some() {
                out.push(None);
                continue;
            }
            let time = |i: &usize| {
                log.channels[*i].clock == k
                    && self.meanings[*i].what.is_some_and(|w| w.kind == Kind::Time)
            };
            let found: Vec<usize> = (0..log.channels.len()).filter(time).collect();
            match self.pick(found)? {
                Some(i) => {
                    let unit = self.time_unit(i, None)?;
                    out.push(Some((i, unit)));
                }
                None => match self.settings.sample_time {
                    Some(step) => {
                        self.said.say(
                            &log.file,
                            format!("time: steps of {step} s, as --sample-time says"),
                        );
                        out.push(None);
                    }
                    None => return Err(self.no_time()),
                },
            }
        }
        Ok(out)
    }

    /// Of several channels of times the stamps of the header.
    fn pick(&mut self, found: Vec<usize>) -> Result<Option<usize>, LogError> {
        let log = self.log;
        let names: Vec<String> = found
            .iter()
            .map(|&i| format!("`{}`", log.channels[i].name))
            .collect();
        let header: Vec<usize> = found
            .iter()
            .copied()
            .filter(|&i| {
                let words = &self.meanings[i].parsed.words;
                words.iter().any(|w| w == "header") && words.iter().any(|w| w == "stamp")
            })
            .collect();
        match (found.as_slice(), header.as_slice()) {
            ([], _) => Ok(None),
            ([one], _) => Ok(Some(*one)),
            (_, [one]) => {
                let sentence = format!(
                    "time: `{}` of {}: header stamps come before receive stamps",
                    log.channels[*one].name,
                    names.join(", ")
                );
                self.said.say(&log.file, sentence);
                Ok(Some(*one))
            }
            _ => Err(LogError::Ambiguous {
                file: log.file.clone(),
                what: "time".to_owned(),
                candidates: names.join(" or "),
                mend: format!("say which: --map 't={}'", log.channels[found[0]].name),
            }),
        }
    }

    fn no_time(&self) -> LogError {
        match self.missing(Kind::Time, &[]) {
            LogError::Missing { file, quantity, of, found, .. } => LogError::Missing {
                file,
                quantity,
                of,
                found,
                mend: "say which channel: --map 't=CHANNEL[ms]'; or state the step of the log: --sample-time 0.002".to_owned(),
            },
            other => other,
        }
    }

    /// The unit of a channel of times: as mapped, as stated, as Unix stamps show it, otherwise s.
    fn time_unit(&mut self, channel: usize, mapped: Option<Unit>) -> Result<Unit, LogError> {
        let log = self.log;
        let entry = self
            .settings
            .map
            .iter()
            .find(|e| e.kind == Kind::Time && e.column.is_empty());
        let stated = mapped
            .or_else(|| self.meanings[channel].unit.clone())
            .or_else(|| entry.and_then(crate::Entry::unit));
        let name = &log.channels[channel].name;
        if let Some(unit) = stated {
            let sentence = format!("time: `{name}` in {}, as stated", unit.text);
            self.said.say(&log.file, sentence);
            return self.fitting(unit, Kind::Time, Dimension::Time, channel);
        }
        let values = &log.channels[channel].values;
        let first = values
            .iter()
            .copied()
            .find(|v| v.is_finite())
            .unwrap_or(0.0)
            + log.channels[channel].offset;
        // Unix time of the years 2001 to 2128 has these ten digits in seconds; no other unit gives
        // stamps of this century.
        let unix = |digits: f64| (1e9..5e9).contains(&(first / digits));
        let (unit, why) = if unix(1e9) {
            ("ns", "its stamps are Unix times in no other unit")
        } else if unix(1e6) {
            ("us", "its stamps are Unix times in no other unit")
        } else if unix(1e3) {
            ("ms", "its stamps are Unix times in no other unit")
        } else {
            ("s", "SI, since no unit is stated")
        };
        self.said
            .say(&log.file, format!("time: `{name}` in {unit}: {why}"));
        Ok(Unit::parse(unit).unwrap_or_else(|| Unit::si(Dimension::Time)))
    }
}
