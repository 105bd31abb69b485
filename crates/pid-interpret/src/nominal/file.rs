//! The file as written: keys, places, lines.

use std::path::Path;

use pid_toml::{Place, Spanned};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::error::NominalError;
use super::stated::{RawEffect, RawSimulated};

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawFile {
    pub(super) robot: RawRobot,
    pub(super) tolerance: Option<RawTolerance>,
    pub(super) joint: Vec<RawJoint>,
    #[serde(default)]
    pub(super) effect: Vec<RawEffect>,
    pub(super) simulated: Option<RawSimulated>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawRobot {
    pub(super) name: String,
    pub(super) gravity: Spanned<[f64; 3]>,
    pub(super) tool: Option<Spanned<[f64; 3]>>,
    pub(super) encoder_side: Option<Spanned<String>>,
    pub(super) velocity_filter_hz: Option<Spanned<f64>>,
    pub(super) input_noise: Option<Spanned<f64>>,
    pub(super) horizon_s: Option<Spanned<f64>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawTolerance {
    pub(super) mass_rel: Spanned<f64>,
    pub(super) com_abs_m: Spanned<f64>,
    pub(super) inertia_rel: Spanned<f64>,
    pub(super) rotor_inertia_rel: Spanned<f64>,
    pub(super) motor_gain_rel: Spanned<f64>,
    pub(super) friction_rel: Spanned<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawJoint {
    pub(super) name: Spanned<String>,
    pub(super) r#type: Spanned<String>,
    pub(super) axis: Spanned<[f64; 3]>,
    pub(super) parent: Option<Spanned<String>>,
    pub(super) origin: Spanned<[f64; 3]>,
    pub(super) rpy: Option<Spanned<[f64; 3]>>,
    pub(super) limits: Option<Spanned<[f64; 2]>>,
    pub(super) mass: Spanned<f64>,
    pub(super) com: Spanned<[f64; 3]>,
    pub(super) inertia: Spanned<[f64; 6]>,
    pub(super) rotor_inertia: Spanned<f64>,
    pub(super) coulomb: Spanned<f64>,
    pub(super) viscous: Spanned<f64>,
    pub(super) sharpness: Option<Spanned<f64>>,
    pub(super) motor_gain: Spanned<f64>,
    pub(super) input: Spanned<String>,
    pub(super) velocity: Spanned<String>,
    pub(super) q_resolution: Option<Spanned<f64>>,
    pub(super) q_noise_std: Option<Spanned<f64>>,
    pub(super) dq_noise_std: Option<Spanned<f64>>,
    pub(super) input_noise_std: Option<Spanned<f64>>,
    pub(super) torque_peak: Option<Spanned<f64>>,
    pub(super) speed_scale: Option<Spanned<f64>>,
    pub(super) tolerance: Option<RawHalfWidths>,
}

/// Tolerances of one joint's own values, in their units.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawHalfWidths {
    pub(super) mass: Spanned<f64>,
    pub(super) com: Spanned<[f64; 3]>,
    pub(super) inertia: Spanned<[f64; 6]>,
    pub(super) rotor_inertia: Spanned<f64>,
    pub(super) coulomb: Spanned<f64>,
    pub(super) viscous: Spanned<f64>,
    pub(super) motor_gain: Spanned<f64>,
}

/// A `measurement.toml`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawMeasurement {
    #[serde(default)]
    pub(super) robot: RawMeasuredRobot,
    #[serde(default)]
    pub(super) joint: Vec<RawMeasuredJoint>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawMeasuredRobot {
    pub(super) tool: Option<Spanned<[f64; 3]>>,
    pub(super) encoder_side: Option<Spanned<String>>,
    pub(super) velocity_filter_hz: Option<Spanned<f64>>,
    pub(super) input_noise: Option<Spanned<f64>>,
    pub(super) horizon_s: Option<Spanned<f64>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawMeasuredJoint {
    pub(super) name: Spanned<String>,
    pub(super) velocity: Option<Spanned<String>>,
    pub(super) q_resolution: Option<Spanned<f64>>,
    pub(super) q_noise_std: Option<Spanned<f64>>,
    pub(super) dq_noise_std: Option<Spanned<f64>>,
    pub(super) torque_peak: Option<Spanned<f64>>,
    pub(super) speed_scale: Option<Spanned<f64>>,
}

/// Text and name of a file, from which an error finds its place.
pub(super) struct Source<'a> {
    pub(super) file: &'a Path,
    pub(super) text: &'a str,
}

impl Source<'_> {
    pub(super) fn parse<T: DeserializeOwned>(&self) -> Result<T, NominalError> {
        let name = self.file.display().to_string();
        let source = pid_toml::Source::new(&name, self.text);
        source.parse().map_err(NominalError::Syntax)
    }

    pub(super) fn place<T>(&self, value: &Spanned<T>) -> Place {
        let name = self.file.display().to_string();
        pid_toml::Source::new(&name, self.text).place_of(value)
    }

    /// An error at a value.
    pub(super) fn error<T>(
        &self,
        value: &Spanned<T>,
        item: &str,
        key: &'static str,
        found: impl ToString,
        mend: impl Into<String>,
    ) -> NominalError {
        NominalError::Value {
            place: self.place(value),
            item: item.to_owned(),
            key,
            found: found.to_string(),
            mend: mend.into(),
        }
    }

    /// A finite number that satisfies a condition.
    pub(super) fn number(
        &self,
        value: &Spanned<f64>,
        item: &str,
        key: &'static str,
        holds: impl Fn(f64) -> bool,
        mend: &str,
    ) -> Result<f64, NominalError> {
        let x = *value.get_ref();
        if x.is_finite() && holds(x) {
            return Ok(x);
        }
        Err(self.error(value, item, key, x, mend))
    }

    /// As [`number`](Self::number) for a number that may be left out.
    pub(super) fn optional(
        &self,
        value: Option<&Spanned<f64>>,
        item: &str,
        key: &'static str,
        holds: impl Fn(f64) -> bool,
        mend: &str,
    ) -> Result<Option<f64>, NominalError> {
        value
            .map(|value| self.number(value, item, key, holds, mend))
            .transpose()
    }

    /// Finite numbers.
    pub(super) fn list<const N: usize>(
        &self,
        value: &Spanned<[f64; N]>,
        item: &str,
        key: &'static str,
    ) -> Result<[f64; N], NominalError> {
        match value.get_ref().iter().find(|x| !x.is_finite()) {
            Some(x) => Err(self.error(value, item, key, x, "give finite numbers")),
            None => Ok(*value.get_ref()),
        }
    }

    /// One of some words.
    pub(super) fn word<T: Copy>(
        &self,
        value: &Spanned<String>,
        item: &str,
        key: &'static str,
        words: &[(&str, T)],
    ) -> Result<T, NominalError> {
        let found = value.get_ref();
        match words.iter().find(|(word, _)| word == found) {
            Some(&(_, meaning)) => Ok(meaning),
            None => {
                let names = words.iter().map(|(word, _)| *word);
                let known: Vec<String> = names.clone().map(|w| format!("\"{w}\"")).collect();
                let meant = pid_toml::nearest(found, names)
                    .map_or_else(String::new, |w| format!("; did you mean \"{w}\"?"));
                Err(self.error(
                    value,
                    item,
                    key,
                    format!("\"{found}\""),
                    format!("write one of {}{meant}", known.join(", ")),
                ))
            }
        }
    }
}
