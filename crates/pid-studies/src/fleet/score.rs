//! What a fleet's summary says of units whose matter is known.

use pid_fleet::Summary;
use pid_fleet::collect::Unit;
use pid_withheld::fleet::{COMMON, Coming, FRICTION, Odd};

use super::{Truth, name};

/// Error of an onset that counts as right, share of the time that the unit's logs span.
const NEAR: f64 = 0.05;

/// Counts of a fleet.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Score {
    /// Units that differ from the first log on: found, and how many there are.
    pub deviating: (usize, usize),
    /// Units that change: found as changing, and how many there are.
    pub changing: (usize, usize),
    /// Healthy units that are named, and how many there are.
    pub false_alarms: (usize, usize),
    /// Odd units whose matter is named first: by name and joint; and how many were found.
    pub named: (usize, usize),
    /// The same, among the first three.
    pub among: usize,
    /// Errors of onsets, share of the time that the logs span: steps, ramps.
    pub onsets: [Vec<f64>; 2],
    /// Onsets that lie in the interval that is stated, and how many are stated.
    pub held: (usize, usize),
    /// Spread of Coulomb and viscous friction over the drawn one, joint by joint.
    pub spreads: Vec<(String, f64)>,
    /// Common growth of the first joint's viscous friction over the drawn one.
    pub common: Option<f64>,
    /// A line per odd unit and per false alarm.
    pub lines: Vec<String>,
}

/// Compares a summary with what is hidden.
pub fn score(truth: &Truth, summary: &Summary) -> Score {
    let mut score = Score::default();
    for unit in &summary.units {
        let odd = truth.odd.iter().find(|o| name(o.unit) == unit.name);
        match odd {
            Some(odd) => score.odd(odd, unit, &truth.joints),
            None => {
                score.false_alarms.1 += 1;
                if unit.deviates || unit.change.is_some() {
                    score.false_alarms.0 += 1;
                    score.lines.push(format!(
                        "{}: false: {:?} {:?}",
                        unit.name, unit.suspects, unit.change
                    ));
                }
            }
        }
    }
    for over in &summary.quantities {
        if ["coulomb", "viscous"]
            .iter()
            .any(|stem| over.name.starts_with(stem))
        {
            let drawn = FRICTION * over.nominal;
            score.spreads.push((over.name.clone(), over.spread / drawn));
        }
        if over.name == format!("viscous_{}", truth.joints[0]) {
            score.common = over.trend.map(|t| 365.0 * t.0 / (COMMON * over.nominal));
        }
    }
    score
}

impl Score {
    fn odd(&mut self, odd: &Odd, unit: &Unit, joints: &[String]) {
        let found = match odd.coming {
            Coming::Always => {
                self.deviating.1 += 1;
                self.deviating.0 += usize::from(unit.deviates);
                unit.deviates.then_some(&unit.suspects)
            }
            Coming::Step | Coming::Ramp => {
                self.changing.1 += 1;
                self.changing.0 += usize::from(unit.change.is_some());
                unit.change.as_ref().map(|c| &c.suspects)
            }
        };
        let names = odd.names(joints);
        if let Some(suspects) = found {
            let right = |name: &String| names.contains(name);
            self.named.1 += 1;
            self.named.0 += usize::from(suspects.first().is_some_and(|s| right(&s.name)));
            self.among += usize::from(suspects.iter().any(|s| right(&s.name)));
        }
        if let (Some(changed), true) = (&unit.change, odd.coming != Coming::Always) {
            let error = (changed.change.onset - odd.onset).abs() / (unit.time.1 - unit.time.0);
            self.onsets[usize::from(odd.coming == Coming::Ramp)].push(error);
            let (from, to) = changed.change.between;
            self.held.1 += 1;
            self.held.0 += usize::from((from..=to).contains(&odd.onset));
        }
        let said: Vec<String> = found
            .into_iter()
            .flatten()
            .map(|s| format!("{} {:.4} explains {:.2}", s.name, s.amount, s.explains))
            .collect();
        let onset = unit
            .change
            .as_ref()
            .map_or(f64::NAN, |c| c.change.onset - odd.onset);
        self.lines.push(format!(
            "{}: {odd:?}: {}; onset off by {onset:.1} days",
            unit.name,
            said.join(", ")
        ));
    }

    /// The counts as lines.
    pub fn in_words(&self) -> String {
        let share = |(a, b): (usize, usize)| {
            format!("{a} of {b} ({:.2} %)", 100.0 * a as f64 / b.max(1) as f64)
        };
        let onsets = |errors: &[f64]| {
            let near = errors.iter().filter(|e| **e <= NEAR).count();
            let most = errors.iter().copied().fold(0.0, f64::max);
            format!(
                "{}, median {:.2} %, largest {:.2} %",
                share((near, errors.len())),
                100.0 * pid_fleet::robust::median(errors),
                100.0 * most
            )
        };
        let mut lines = vec![
            format!(
                "units that differ, found              {}",
                share(self.deviating)
            ),
            format!(
                "units that change, found              {}",
                share(self.changing)
            ),
            format!(
                "healthy units that are named          {}",
                share(self.false_alarms)
            ),
            format!(
                "matter and joint right, first          {}",
                share(self.named)
            ),
            format!(
                "matter and joint right, among three    {}",
                share((self.among, self.named.1))
            ),
            format!(
                "onset within 5 % of the time, steps    {}",
                onsets(&self.onsets[0])
            ),
            format!(
                "onset within 5 % of the time, ramps    {}",
                onsets(&self.onsets[1])
            ),
            format!(
                "onset in the stated interval           {}",
                share(self.held)
            ),
        ];
        lines.extend(
            self.spreads
                .iter()
                .map(|(name, ratio)| format!("spread of {name} over the drawn one  {ratio:.3}")),
        );
        if let Some(common) = self.common {
            lines.push(format!(
                "common drift over the drawn one        {common:.3}"
            ));
        }
        lines.join("\n") + "\n"
    }
}
