//! A summary in words, for the terminal.

use pid_page::number::{plus_minus, short, unit, value};

use crate::blame::Suspect;
use crate::collect::{Changed, Summary, Unit};
use crate::drift::Shape;

/// Units that are listed at most; all are in the files.
const LISTED: usize = 30;

impl Summary {
    /// Units that stand out: those whose level does, and those that change.
    pub fn standing_out(&self) -> impl Iterator<Item = &Unit> {
        self.units
            .iter()
            .filter(|u| u.deviates || u.change.is_some())
    }

    /// Logs that count.
    pub fn counted(&self) -> usize {
        self.logs - self.gaps.len()
    }

    /// A time in words: a date, or a number.
    pub(crate) fn time(&self, t: f64) -> String {
        match self.dates {
            true => pid_page::Date::of_day(t.floor() as i64).to_string(),
            false => value(t),
        }
    }

    /// The summary for the terminal.
    pub fn in_words(&self) -> String {
        let deviating = self.units.iter().filter(|u| u.deviates).count();
        let changing = self.units.iter().filter(|u| u.change.is_some()).count();
        let mut lines = vec![format!(
            "{}: {} of {} logs of {} units count; {deviating} units differ, {changing} change over time",
            self.robot,
            self.counted(),
            self.logs,
            self.units.len()
        )];
        if !self.gaps.is_empty() {
            lines.push(format!("\n{} logs do not count", self.gaps.len()));
            lines.extend(self.gaps.iter().take(LISTED).map(|gap| {
                let why = gap.why.lines().next().unwrap_or_default();
                format!(
                    "  {:8} job {} ({}) {}  {why}",
                    gap.what.word(),
                    gap.job,
                    gap.unit,
                    gap.log
                )
            }));
            lines.extend(more(self.gaps.len()));
        }
        lines.push(
            "\nOver all units: mean, spread between units, from log to log; nominal".to_owned(),
        );
        lines.extend(self.quantities.iter().map(|q| {
            let drift = match q.trend.filter(|_| q.drifts) {
                Some((slope, deviation)) => format!(
                    "  drifts by {} {}",
                    plus_minus(self.yearly(slope), self.yearly(deviation)),
                    self.per()
                ),
                None => String::new(),
            };
            let far = match q.far > 0.02 {
                true => format!("  {:.1} % of units beyond 3 deviations", 100.0 * q.far),
                false => String::new(),
            };
            format!(
                "  {:16} {:>12} ± {:<10} {:<10} {:>10}  {}{drift}{far}",
                q.name,
                value(q.mean),
                short(q.spread),
                short(q.within.hypot(q.of_a_log)),
                value(q.nominal),
                unit(&q.unit)
            )
        }));
        let named: Vec<&Unit> = self.standing_out().collect();
        if !named.is_empty() {
            lines.push("\nUnits that stand out".to_owned());
            lines.extend(
                named
                    .iter()
                    .take(LISTED)
                    .map(|u| format!("  {}", self.unit_in_words(u))),
            );
            lines.extend(more(named.len()));
        }
        lines.join("\n") + "\n"
    }

    /// Change per year where times are dates.
    pub(crate) fn yearly(&self, slope: f64) -> f64 {
        match self.dates {
            true => 365.25 * slope,
            false => slope,
        }
    }

    pub(crate) fn per(&self) -> &'static str {
        match self.dates {
            true => "a year",
            false => "per unit of time",
        }
    }

    /// What the matter is with a unit.
    fn unit_in_words(&self, u: &Unit) -> String {
        let level = match (u.deviates, &u.change) {
            (true, _) => format!("{} from the first log on", suspects(&u.suspects)),
            (false, _) => String::new(),
        };
        let change = u
            .change
            .as_ref()
            .map_or_else(String::new, |c| self.change_in_words(c));
        let parts: Vec<String> = [level, change]
            .into_iter()
            .filter(|t| !t.is_empty())
            .collect();
        format!("{}: {}", u.name, parts.join("; "))
    }

    pub(crate) fn change_in_words(&self, changed: &Changed) -> String {
        let change = &changed.change;
        let (from, to) = change.between;
        match change.shape {
            Shape::Step => format!(
                "{} between {} and {}",
                suspects(&changed.suspects),
                self.time(from),
                self.time(to)
            ),
            Shape::Ramp => format!(
                "{} by now, growing since {} ({} to {})",
                suspects(&changed.suspects),
                self.time(change.onset),
                self.time(from),
                self.time(to)
            ),
        }
    }
}

/// What explains a shift: the best one, and its rivals.
pub(crate) fn suspects(all: &[Suspect]) -> String {
    let one = |s: &Suspect| {
        let sign = if s.amount > 0.0 { "+" } else { "" };
        format!(
            "{} {sign}{} {}",
            s.name,
            plus_minus(s.amount, s.deviation),
            unit(&s.unit)
        )
    };
    let words: Vec<String> = all.iter().map(one).collect();
    words.join(" or ")
}

fn more(of: usize) -> Option<String> {
    (of > LISTED).then(|| format!("  and {} more, in fleet.json", of - LISTED))
}
