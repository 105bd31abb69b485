//! Gains of position loops that differ from record to record.

use std::str::FromStr;

use crate::{ChangeError, Dataset};

/// By how many times the gains of the drives' position loops in a record are those of the description. A servo whose
/// register for kp holds 100 in one record and 400 in another has one gain per unit of the register, and factors of 100
/// and 400.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GainFactors {
    /// In the order of [`GainFactors::KEYS`], one per joint; empty where all are 1.
    all: [Vec<f64>; GainFactors::KEYS.len()],
}

impl GainFactors {
    /// Gains that may differ, by their keys in a description.
    pub const KEYS: [&'static str; 4] = ["kp", "kd", "ki", "kv"];

    /// Whether the gains are those of the description.
    pub fn are_one(&self) -> bool {
        self.all.iter().flatten().all(|x| *x == 1.0)
    }

    /// The factor of a gain, by its place in [`GainFactors::KEYS`], at a joint; 1 where none is stated.
    pub fn at(&self, gain: usize, joint: usize) -> f64 {
        let own = self.all.get(gain).and_then(|own| own.get(joint));
        own.copied().unwrap_or(1.0)
    }

    /// Factors that are stated, with the keys of their gains.
    pub fn stated(&self) -> impl Iterator<Item = (&'static str, &[f64])> {
        let all = Self::KEYS.into_iter().zip(&self.all);
        all.filter(|(_, own)| !own.is_empty())
            .map(|(key, own)| (key, own.as_slice()))
    }

    /// Sets the factors of a gain, by its place in [`GainFactors::KEYS`]: one for all joints or one for each.
    ///
    /// # Errors
    /// What is wrong with them.
    pub(crate) fn set(
        &mut self,
        gain: usize,
        factors: &[f64],
        joints: usize,
    ) -> Result<(), String> {
        if let Some(x) = factors.iter().find(|x| !x.is_finite() || **x < 0.0) {
            return Err(format!("{x}: a factor is a number of at least zero"));
        }
        self.all[gain] = match factors {
            [one] => vec![*one; joints],
            all if all.len() == joints => all.to_vec(),
            all => {
                let plural = if joints == 1 { "" } else { "s" };
                return Err(format!(
                    "{} factors for {joints} joint{plural}: give one for all or one per joint",
                    all.len()
                ));
            }
        };
        Ok(())
    }
}

/// Factors of a gain in all records whose names fit a pattern: `*_kp400=kp:4`, `slow=kd:1,0.5`.
#[derive(Debug, Clone, PartialEq)]
pub struct GainRule {
    pattern: String,
    gain: usize,
    factors: Vec<f64>,
}

impl FromStr for GainRule {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = || {
            format!(
                "`{text}` is not RECORD=GAIN:FACTOR\n  help: as in `*_kp400=kp:4`; gains are {}",
                GainFactors::KEYS.join(", ")
            )
        };
        let (pattern, own) = text.rsplit_once('=').ok_or_else(form)?;
        let (key, factors) = own.split_once(':').ok_or_else(form)?;
        let keys = GainFactors::KEYS.iter();
        let gain = keys.clone().position(|own| *own == key.trim());
        let factors = factors.split(',').map(|x| x.trim().parse::<f64>().ok());
        let factors: Option<Vec<f64>> = factors.collect();
        Ok(Self {
            pattern: pattern.to_owned(),
            gain: gain.ok_or_else(form)?,
            factors: factors.ok_or_else(form)?,
        })
    }
}

impl Dataset {
    /// The data with gains by record as the rules say; the last that fits a record counts.
    ///
    /// # Errors
    /// [`ChangeError::GainFactors`]: a rule that fits no record, or with factors that no gain has.
    pub fn with_gain_factors(mut self, rules: &[GainRule]) -> Result<Self, ChangeError> {
        let joints = self.nq();
        for rule in rules {
            let refuse = |why: String| ChangeError::GainFactors {
                pattern: rule.pattern.clone(),
                gain: GainFactors::KEYS[rule.gain],
                why,
            };
            let records: Vec<&str> = self.experiments.iter().map(|e| e.name.as_str()).collect();
            let records = records.join(", ");
            let fits = |name: &str| matches(&rule.pattern, name);
            let mut found = (self.experiments.iter_mut())
                .filter(|e| fits(&e.name))
                .peekable();
            if found.peek().is_none() {
                return Err(refuse(format!(
                    "no record has a name like that; they are {records}"
                )));
            }
            for e in found {
                let set = e.gain_factors.set(rule.gain, &rule.factors, joints);
                set.map_err(refuse)?;
            }
        }
        Ok(self)
    }
}

/// Whether a name fits a pattern in which `*` stands for any characters.
pub fn matches(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == name,
        Some((head, rest)) => name.strip_prefix(head).is_some_and(|tail| {
            (0..=tail.len())
                .filter(|&k| tail.is_char_boundary(k))
                .any(|k| matches(rest, &tail[k..]))
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_match() {
        assert!(matches("*_kp100", "sin_kp100") && matches("*", "x") && matches("a*b*c", "a1b2c"));
        assert!(!matches("*_kp100", "sin_kp1000") && !matches("a", "ab") && !matches("a*b", "ac"));
    }

    #[test]
    fn a_rule_is_read_or_refused_with_its_form() {
        let rule: GainRule = "*_kp400 = x=kd:1, 0.5".parse().expect("a rule");
        assert_eq!((rule.pattern.as_str(), rule.gain), ("*_kp400 = x", 1));
        assert_eq!(rule.factors, [1.0, 0.5]);
        for text in ["kp:4", "a=kp", "a=kq:4", "a=kp:x", "a=kp:"] {
            let message = text.parse::<GainRule>().expect_err(text);
            assert!(
                message.contains(text) && message.contains("kp, kd, ki, kv"),
                "{message}"
            );
        }
    }

    #[test]
    fn factors_are_one_for_all_joints_or_one_for_each() {
        let mut own = GainFactors::default();
        assert!(own.are_one());
        own.set(0, &[4.0], 2).expect("one for all");
        own.set(1, &[1.0, 0.5], 2).expect("one for each");
        assert_eq!([own.at(0, 1), own.at(1, 1), own.at(2, 1)], [4.0, 0.5, 1.0]);
        assert!(!own.are_one());
        for factors in [&[-1.0][..], &[f64::NAN], &[1.0, 2.0, 3.0], &[]] {
            assert!(own.set(0, factors, 2).is_err(), "{factors:?}");
        }
    }
}
