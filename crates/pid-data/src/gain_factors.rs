//! Gains of position loops that differ from record to record, and drives that are off in some.

use std::str::FromStr;

use crate::{ChangeError, Dataset};

/// By how many times the gains of the drives' position loops in a record are those of the description. A servo whose
/// register for kp holds 100 in one record and 400 in another has one gain per unit of the register, and factors of 100
/// and 400. A drive that is off has open terminals: no current flows, and the motor exerts no torque.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GainFactors {
    /// In the order of [`GainFactors::KEYS`], one per joint; empty where all are 1.
    all: [Vec<f64>; GainFactors::KEYS.len()],
    /// Whether the drive is off, one per joint; empty where all are on.
    off: Vec<bool>,
}

impl GainFactors {
    /// Gains that may differ, by their keys in a description.
    pub const KEYS: [&'static str; 4] = ["kp", "kd", "ki", "kv"];

    /// Whether the gains are those of the description, and all drives on.
    pub fn are_one(&self) -> bool {
        self.all.iter().flatten().all(|x| *x == 1.0) && !self.off.contains(&true)
    }

    /// Whether the drive of a joint is off.
    pub fn is_off(&self, joint: usize) -> bool {
        self.off.get(joint).copied().unwrap_or(false)
    }

    /// Whether the drives are off, one per joint; empty where all are on.
    pub fn off(&self) -> &[bool] {
        &self.off
    }

    /// Says of drives whether they are off: one for all joints or one for each.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(crate) fn set_off(&mut self, off: &[bool], joints: usize) -> Result<(), String> {
        let all = for_each(off, joints)?;
        self.off = if all.contains(&true) { all } else { Vec::new() };
        Ok(())
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
        self.all[gain] = for_each(factors, joints)?;
        Ok(())
    }
}

/// One value for each joint, from one for all or one for each.
fn for_each<T: Copy>(stated: &[T], joints: usize) -> Result<Vec<T>, String> {
    match stated {
        [one] => Ok(vec![*one; joints]),
        all if all.len() == joints => Ok(all.to_vec()),
        all => {
            let plural = if joints == 1 { "" } else { "s" };
            Err(format!(
                "{} values for {joints} joint{plural}: give one for all or one per joint",
                all.len()
            ))
        }
    }
}

/// What holds in all records whose names fit a pattern: factors of a gain, `*_kp400=kp:4` or `slow=kd:1,0.5`, or drives
/// that are off, `drop_*=off`.
#[derive(Debug, Clone, PartialEq)]
pub struct GainRule {
    pattern: String,
    holds: Holds,
}

#[derive(Debug, Clone, PartialEq)]
enum Holds {
    /// A gain, and its factors.
    Times(usize, Vec<f64>),
    Off,
}

impl FromStr for GainRule {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = || {
            format!(
                "`{text}` is not RECORD=GAIN:FACTOR\n  help: as in `*_kp400=kp:4`, or `drop_*=off` for drives that are off; gains are {}",
                GainFactors::KEYS.join(", ")
            )
        };
        let (pattern, own) = text.rsplit_once('=').ok_or_else(form)?;
        let pattern = pattern.to_owned();
        if own.trim() == "off" {
            let holds = Holds::Off;
            return Ok(Self { pattern, holds });
        }
        let (key, factors) = own.split_once(':').ok_or_else(form)?;
        let keys = GainFactors::KEYS.iter();
        let gain = keys.clone().position(|own| *own == key.trim());
        let factors = factors.split(',').map(|x| x.trim().parse::<f64>().ok());
        let factors: Option<Vec<f64>> = factors.collect();
        let holds = Holds::Times(gain.ok_or_else(form)?, factors.ok_or_else(form)?);
        Ok(Self { pattern, holds })
    }
}

impl GainRule {
    /// What it says of the records that it fits.
    fn said(&self) -> String {
        match self.holds {
            Holds::Times(gain, _) => format!("{}:…", GainFactors::KEYS[gain]),
            Holds::Off => "off".to_owned(),
        }
    }

    /// Holds for a record with so many joints.
    fn put(&self, own: &mut GainFactors, joints: usize) -> Result<(), String> {
        match &self.holds {
            Holds::Times(gain, factors) => own.set(*gain, factors, joints),
            Holds::Off => own.set_off(&[true], joints),
        }
    }
}

impl Dataset {
    /// The data with gains by record as the rules say; the last that fits a record counts.
    ///
    /// # Errors
    /// [`ChangeError::GainFactors`]: a rule that fits no record, or with factors that no gain has.
    pub fn with_gain_factors(mut self, rules: &[GainRule]) -> Result<Self, ChangeError> {
        Self::set_gain_factors(std::slice::from_mut(&mut self), rules)?;
        Ok(self)
    }

    /// Sets gains by record in several data sets, each rule in those where it fits.
    ///
    /// # Errors
    /// As [`Dataset::with_gain_factors`].
    pub fn set_gain_factors(all: &mut [Self], rules: &[GainRule]) -> Result<(), ChangeError> {
        for rule in rules {
            let refuse = |why: String| ChangeError::GainFactors {
                rule: format!("{}={}", rule.pattern, rule.said()),
                why,
            };
            let mut fitted = false;
            for own in all.iter_mut() {
                let joints = own.nq();
                let records = own.experiments.iter_mut();
                for e in records.filter(|e| matches(&rule.pattern, &e.name)) {
                    rule.put(&mut e.gain_factors, joints).map_err(refuse)?;
                    fitted = true;
                }
            }
            if !fitted {
                let records = all.iter().flat_map(|own| &own.experiments);
                let records: Vec<&str> = records.map(|e| e.name.as_str()).collect();
                return Err(refuse(format!(
                    "no record has a name like that; they are {}",
                    records.join(", ")
                )));
            }
        }
        Ok(())
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
        assert_eq!(rule.pattern, "*_kp400 = x");
        assert_eq!(rule.holds, Holds::Times(1, vec![1.0, 0.5]));
        let rule: GainRule = "drop_*=off".parse().expect("a rule");
        assert_eq!((rule.pattern.as_str(), rule.holds), ("drop_*", Holds::Off));
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
        let mut own = GainFactors::default();
        own.set_off(&[false, true], 2).expect("one for each");
        assert_eq!([own.is_off(0), own.is_off(1)], [false, true]);
        assert!(!own.are_one() && own.set_off(&[true; 3], 2).is_err());
        own.set_off(&[false], 2).expect("one for all");
        assert!(own.are_one() && own.off().is_empty());
    }
}
