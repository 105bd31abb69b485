//! Gains of position loops as the records tell them, in numbers and words.

use pid_page::number;
use serde::{Deserialize, Serialize};

/// A gain of a drive's position loop, as it was found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LoopGain {
    /// Joint from 1.
    pub joint: usize,
    /// `kp`, `kd` or `ki`.
    pub gain: String,
    /// Unit of the values.
    pub unit: String,
    /// As stated; `None` if it was stated as unknown.
    pub stated: Option<f64>,
    /// Its tolerance.
    pub tolerance: Option<f64>,
    /// Where the fit ended.
    pub value: f64,
    /// Standard deviation of it, what the tolerances of all values leave of each other included.
    pub std: Option<f64>,
    /// What the records say of it.
    pub told: Told,
    /// Values that move together with it where it is not determined, the closest first.
    pub together: Vec<Trade>,
}

/// What records say of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Told {
    /// Within 5 %, with 95 % probability.
    Determined,
    /// Better than its tolerance does.
    Roughly,
    /// Little more than its tolerance says.
    Open,
    /// The fit ends at the end of its tolerance: the real value lies there or beyond.
    AtItsTolerance,
}

/// A value that moves together with another one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trade {
    /// Name of the value.
    pub parameter: String,
    /// Its joint, from 1.
    pub joint: Option<usize>,
    /// Its relative change per relative change of the other one: -1 where only the product is told,
    /// 1 where only the ratio is.
    pub change: f64,
}

impl LoopGain {
    /// In words, as in `the drive's kp at joint 2 is 31.0 ± 0.4 N·m/rad instead of 40`.
    pub fn words(&self) -> String {
        let unit = number::unit(&self.unit);
        let head = format!("the drive's {} at joint {}", self.gain, self.joint);
        let value = match self.std {
            Some(std) => number::plus_minus(self.value, std),
            None => number::value(self.value),
        };
        let tolerance = self.tolerance.unwrap_or(0.0);
        let range = self.stated.map_or("unknown".to_owned(), |x| {
            format!("stated {} ± {}", number::value(x), number::value(tolerance))
        });
        let with = self.partners();
        match self.told {
            Told::Determined => {
                let off = |x: &f64| (self.value - x).abs() > 1.96 * self.std.unwrap_or(0.0);
                let instead = match self.stated {
                    Some(x) if off(&x) => format!(" instead of {}", number::value(x)),
                    Some(x) => format!(", as stated ({})", number::value(x)),
                    None => String::new(),
                };
                format!("{head} is {value} {unit}{instead}")
            }
            Told::Roughly => {
                format!("{head} is told roughly only: {value} {unit} ({range}){with}")
            }
            Told::Open => format!("{head} is not determined ({range} {unit}){with}"),
            Told::AtItsTolerance => format!(
                "{head} lies at the end of its tolerance or beyond ({range} {unit}): state a wider one, or unknown = true{with}"
            ),
        }
    }

    /// What it moves together with.
    fn partners(&self) -> String {
        if self.together.is_empty() {
            return String::new();
        }
        let of = |t: &Trade| {
            let joint = t.joint.map_or(String::new(), |j| format!(" of joint {j}"));
            format!(
                "{}{joint} ({:+.0} %)",
                t.parameter.replace('_', " "),
                10.0 * t.change
            )
        };
        let all: Vec<String> = self.together.iter().map(of).collect();
        let first = &self.together[0];
        let near = |x: f64| (first.change - x).abs() < 0.2;
        let name = first.parameter.replace('_', " ");
        let as_a = match (near(-1.0), near(1.0)) {
            (true, _) => format!("; told as its product with the {name} first of all"),
            (_, true) => format!("; told as its ratio to the {name} first of all"),
            _ => String::new(),
        };
        format!(
            "; 10 % more of it goes unnoticed with {}{as_a}",
            all.join(", ")
        )
    }
}

#[cfg(test)]
mod tests {
    use super::{LoopGain, Told, Trade};

    #[test]
    fn a_gain_that_is_not_told_is_not_said() {
        let gain = |told, std, together| LoopGain {
            joint: 2,
            gain: "kp".to_owned(),
            unit: "N*m/rad".to_owned(),
            stated: Some(40.0),
            tolerance: Some(12.0),
            value: 31.0,
            std: Some(std),
            told,
            together,
        };
        let words = |told, std| gain(told, std, Vec::new()).words();
        assert_eq!(
            words(Told::Determined, 0.42),
            "the drive's kp at joint 2 is 31.00 ± 0.42 N·m/rad instead of 40"
        );
        assert!(words(Told::Determined, 5.0).ends_with(", as stated (40)"));
        let trade = Trade {
            parameter: "motor_gain".to_owned(),
            joint: Some(2),
            change: -1.0,
        };
        let open = gain(Told::Open, 6.0, vec![trade]).words();
        assert!(!open.contains("31"), "{open}");
        assert!(
            open.contains("motor gain of joint 2 (-10 %); told as its product with the motor gain"),
            "{open}"
        );
    }
}
