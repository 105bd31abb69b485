//! Nominal values outside their stated tolerance: friction, and gains of position loops.

use pid_interpret::nominal::Gain;
use pid_page::number;
use serde::{Deserialize, Serialize};

/// A nominal value outside its stated tolerance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Beyond {
    /// Name, as [`role_name`](crate::nominal::role_name) gives it.
    pub parameter: String,
    /// Joint from 1.
    pub joint: usize,
    /// Unit of the values.
    pub unit: String,
    /// As stated.
    pub stated: f64,
    /// Its tolerance.
    pub tolerance: f64,
    /// As found.
    pub value: f64,
    /// Standard deviation; `None` if the records do not determine it.
    pub std: Option<f64>,
}

impl Beyond {
    /// Whether it is a gain of a position loop, not friction.
    pub fn is_gain(&self) -> bool {
        Gain::ALL.iter().any(|gain| gain.key() == self.parameter)
    }

    /// In words: which value, as found and as stated.
    pub fn words(&self) -> String {
        let value = match self.std {
            Some(std) => number::plus_minus(self.value, std),
            None => number::value(self.value),
        };
        let name = match self.is_gain() {
            true => format!("{} of the drive", self.parameter),
            false => format!("{} friction", self.parameter),
        };
        format!(
            "{name} of joint {} {value} {} (stated {} ± {})",
            self.joint,
            number::unit(&self.unit),
            number::value(self.stated),
            number::value(self.tolerance)
        )
    }
}
