//! One experiment on one clock: rows are the samples of the positions; channels of other clocks are
//! brought to them.

use crate::assign::{Assigned, Source};
use crate::error::LogError;
use crate::log::Log;
use crate::settings::{Sentences, Settings};

/// An experiment in SI, before it has a role. Each channel has one value per row.
#[derive(Debug, Clone)]
pub(crate) struct Record {
    pub(crate) file: String,
    pub(crate) name: String,
    pub(crate) t: Vec<f64>,
    pub(crate) q: Vec<Vec<f64>>,
    /// `None` for joints without velocity.
    pub(crate) v: Vec<Option<Vec<f64>>>,
    pub(crate) u: Vec<Vec<f64>>,
    pub(crate) tau: Option<Vec<Vec<f64>>>,
    pub(crate) qref: Option<Vec<Vec<f64>>>,
}

/// What a channel does between its samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Between {
    Held,
    Linear,
}

/// Everything that is needed to fetch values.
struct Builder<'a> {
    log: &'a Log,
    assigned: &'a Assigned,
    times: Vec<Vec<f64>>,
    /// The clock of the positions, and its rows with a sample.
    clock: usize,
    rows: Vec<usize>,
    t: Vec<f64>,
    /// First and last row where all that is needed is there.
    overlap: (usize, usize),
}

/// The record of a log.
pub(crate) fn build(
    log: &Log,
    assigned: &Assigned,
    settings: &Settings,
    said: &mut Sentences,
) -> Result<Record, LogError> {
    let times = (0..log.clocks.len())
        .map(|k| times(log, assigned, settings, k, said))
        .collect::<Vec<_>>();
    let channel = |s: &Source| match s {
        Source::Channel(i, _) => Some(*i),
        Source::Constant(_) => None,
    };
    let positions: Vec<usize> = assigned.position.iter().filter_map(channel).collect();
    let clock = positions.first().map_or(0, |&i| log.channels[i].clock);
    let there = |row: usize| {
        positions.iter().any(|&i| {
            log.channels[i].clock == clock
                && log.channels[i]
                    .values
                    .get(row)
                    .is_some_and(|v| v.is_finite())
        })
    };
    let all = times.get(clock).map_or(0, Vec::len);
    let rows: Vec<usize> = (0..all).filter(|&row| there(row)).collect();
    let t: Vec<f64> = rows.iter().map(|&r| times[clock][r]).collect();
    if rows.len() < 2 {
        return Err(LogError::Empty {
            file: log.file.clone(),
            what: format!("{} samples of positions", rows.len()),
            mend: "a record needs at least two samples".to_owned(),
        });
    }
    if rows.len() < all {
        let sentence = format!(
            "{} of {all} rows have no position and are no samples",
            all - rows.len()
        );
        said.say(&log.file, sentence);
    }
    increasing(log, assigned, clock, &rows, &t)?;
    let overlap = (0, rows.len() - 1);
    let mut builder = Builder {
        log,
        assigned,
        times,
        clock,
        rows,
        t,
        overlap,
    };
    builder.record(said)
}

impl Builder<'_> {
    fn record(&mut self, said: &mut Sentences) -> Result<Record, LogError> {
        let a = self.assigned;
        let input = if a.input_measured {
            Between::Linear
        } else {
            Between::Held
        };
        let mut q = self.all(&a.position, Between::Linear, true, said)?;
        let mut u = self.all(&a.input, input, true, said)?;
        let mut v = Vec::new();
        for source in &a.velocity {
            v.push(match source {
                Some(source) => Some(self.values(source, Between::Linear, false, said)?),
                None => None,
            });
        }
        let mut of = |sources: &Option<Vec<Source>>, between| match sources {
            Some(sources) => self.all(sources, between, false, said).map(Some),
            None => Ok(None),
        };
        let mut tau = of(&a.sensor, Between::Linear)?;
        let mut qref = of(&a.target, Between::Held)?;
        let (first, last) = self.overlap;
        if first + 1 > last {
            return Err(LogError::Empty {
                file: self.log.file.clone(),
                what: "positions and inputs have no time in common".to_owned(),
                mend: "check that their stamps come from one clock; receive stamps may serve"
                    .to_owned(),
            });
        }
        if (first, last) != (0, self.rows.len() - 1) {
            let sentence = format!(
                "{} rows before {} s and {} after {} s are left out: not all channels go that far",
                first,
                self.t[first],
                self.rows.len() - 1 - last,
                self.t[last]
            );
            said.say(&self.log.file, sentence);
        }
        let cut = |x: &mut Vec<f64>| {
            x.truncate(last + 1);
            x.drain(..first);
        };
        let mut t = self.t.clone();
        cut(&mut t);
        q.iter_mut().chain(&mut u).for_each(cut);
        v.iter_mut().flatten().for_each(cut);
        tau.iter_mut().chain(&mut qref).flatten().for_each(cut);
        Ok(Record {
            file: self.log.file.clone(),
            name: self.log.name.clone(),
            t,
            q,
            v,
            u,
            tau,
            qref,
        })
    }

    fn all(
        &mut self,
        sources: &[Source],
        between: Between,
        needed: bool,
        said: &mut Sentences,
    ) -> Result<Vec<Vec<f64>>, LogError> {
        sources
            .iter()
            .map(|s| self.values(s, between, needed, said))
            .collect()
    }

    /// The values of a source at the rows of the record.
    fn values(
        &mut self,
        source: &Source,
        between: Between,
        needed: bool,
        said: &mut Sentences,
    ) -> Result<Vec<f64>, LogError> {
        let (index, unit) = match source {
            Source::Constant(value) => return Ok(vec![*value; self.rows.len()]),
            Source::Channel(index, unit) => (*index, unit),
        };
        let channel = &self.log.channels[index];
        let clock = &self.log.clocks[channel.clock];
        if let Some((row, text)) = &channel.bad {
            return Err(LogError::Value {
                file: self.log.file.clone(),
                row: clock.row_word.name(*row),
                channel: channel.name.clone(),
                value: text.clone(),
            });
        }
        // A sum with zero would lose the sign of -0.
        let whole = |v: &f64| {
            if channel.offset == 0.0 {
                *v
            } else {
                v + channel.offset
            }
        };
        let value = |row: usize| {
            channel
                .values
                .get(row)
                .map_or(f64::NAN, |v| unit.to_si(whole(v)))
        };
        if channel.clock == self.clock {
            let direct: Vec<f64> = self.rows.iter().map(|&r| value(r)).collect();
            let there = direct.iter().filter(|v| v.is_finite()).count();
            let finite = channel.values.iter().filter(|v| v.is_finite()).count();
            // In a table of several topics, rows of one are blank for the others; a channel with
            // samples of its own clock has most of them elsewhere.
            if 2 * there >= direct.len() || 2 * there >= finite {
                return Ok(direct);
            }
        }
        let own: Vec<usize> = (0..channel.values.len())
            .filter(|&r| channel.values[r].is_finite())
            .collect();
        let times: Vec<f64> = own
            .iter()
            .map(|&r| {
                self.times[channel.clock]
                    .get(r)
                    .copied()
                    .unwrap_or(f64::NAN)
            })
            .collect();
        increasing(self.log, self.assigned, channel.clock, &own, &times)?;
        let values: Vec<f64> = own.iter().map(|&r| value(r)).collect();
        let name = if clock.name.is_empty() {
            channel.name.clone()
        } else {
            clock.name.clone()
        };
        let how = match between {
            Between::Held => "held from sample to sample",
            Between::Linear => "interpolated linearly",
        };
        said.say(&self.log.file, format!("`{name}` has stamps of its own: its values are {how} at the stamps of the positions"));
        let resampled = resample(&times, &values, &self.t, between);
        if needed {
            let first = resampled
                .iter()
                .position(|v| v.is_finite())
                .unwrap_or(resampled.len());
            let last = resampled.iter().rposition(|v| v.is_finite()).unwrap_or(0);
            self.overlap = (self.overlap.0.max(first), self.overlap.1.min(last));
        }
        Ok(resampled)
    }
}

/// Values at other times: NaN before the first sample, and after the last unless they are held.
fn resample(times: &[f64], values: &[f64], at: &[f64], between: Between) -> Vec<f64> {
    at.iter()
        .map(|&t| {
            // Samples up to t.
            let before = times.partition_point(|&x| x <= t);
            match (before, between) {
                (0, _) => f64::NAN,
                (i, Between::Held) => values[i - 1],
                (i, Between::Linear) if times[i - 1] == t => values[i - 1],
                (i, Between::Linear) if i == times.len() => f64::NAN,
                (i, Between::Linear) => {
                    let s = (t - times[i - 1]) / (times[i] - times[i - 1]);
                    values[i - 1] + s * (values[i] - values[i - 1])
                }
            }
        })
        .collect()
}

/// Times of a clock, s.
fn times(
    log: &Log,
    assigned: &Assigned,
    settings: &Settings,
    clock: usize,
    said: &mut Sentences,
) -> Vec<f64> {
    /// Times beyond this, 12 days, count from an epoch and not from the start of a record, s.
    const EPOCH: f64 = 1e6;
    if let Some((index, unit)) = &assigned.time[clock] {
        let channel = &log.channels[*index];
        let first = channel
            .values
            .iter()
            .copied()
            .find(|v| v.is_finite())
            .unwrap_or(0.0);
        let far = unit.to_si(first + channel.offset).abs() > EPOCH;
        if far {
            said.say(
                &log.file,
                format!(
                    "time counts from the first sample, since `{}` counts from an epoch",
                    channel.name
                ),
            );
        }
        let shift = if far { -first } else { channel.offset };
        return channel
            .values
            .iter()
            .map(|v| unit.to_si(v + shift))
            .collect();
    }
    let rows = log.clocks[clock].rows;
    match (&log.clocks[clock].t, settings.sample_time) {
        (Some(t), _) => t.clone(),
        (None, Some(step)) => (0..rows).map(|i| i as f64 * step).collect(),
        (None, None) => Vec::new(),
    }
}

/// Refuses times that do not increase or are missing.
fn increasing(
    log: &Log,
    assigned: &Assigned,
    clock: usize,
    rows: &[usize],
    t: &[f64],
) -> Result<(), LogError> {
    let fault = |at: usize, what: String, mend: &'static str| LogError::Time {
        file: log.file.clone(),
        row: log.clocks[clock].row_word.name(rows[at]),
        channel: match &assigned.time[clock] {
            Some((i, _)) => log.channels[*i].name.clone(),
            None => log.clocks[clock].name.clone(),
        },
        what,
        mend,
    };
    if let Some(at) = t.iter().position(|t| !t.is_finite()) {
        return Err(fault(
            at,
            "it is missing or no number".to_owned(),
            "every sample needs its time",
        ));
    }
    if let Some(at) = (1..t.len()).find(|&i| t[i] <= t[i - 1]) {
        let what = format!("{} s does not come after {} s", t[at], t[at - 1]);
        return Err(fault(
            at,
            what,
            "sort the rows by time and remove repeated ones, or map another time: --map 't=CHANNEL'",
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_held_and_measurements_interpolated() {
        let (times, values) = ([1.0, 2.0, 4.0], [10.0, 20.0, 40.0]);
        let at = [0.5, 1.0, 1.5, 3.0, 4.0, 5.0];
        let held = resample(&times, &values, &at, Between::Held);
        assert!(held[0].is_nan());
        assert_eq!(held[1..], [10.0, 10.0, 20.0, 40.0, 40.0]);
        let linear = resample(&times, &values, &at, Between::Linear);
        assert!(linear[0].is_nan() && linear[5].is_nan());
        assert_eq!(linear[1..5], [10.0, 15.0, 30.0, 40.0]);
    }
}
