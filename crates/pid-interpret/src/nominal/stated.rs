//! What a diagnosis adds to a description: the effects it named, and how it simulated the robot with them.
//!
//! This module reads places, names and numbers. Which effects there are, and what each parameter
//! may be, is the business of the library of effects.

use std::collections::BTreeMap;
use std::path::Path;

use pid_toml::{Place, Spanned, nearest};
use serde::Deserialize;

use super::error::NominalError;
use super::source::Source;

/// An effect beside the nominal structure, as written.
#[derive(Debug, Clone, PartialEq)]
pub struct Effect {
    /// Identifier.
    pub id: Written<String>,
    /// Its joint, from 0; `None` for an effect of the whole robot.
    pub joint: Option<Written<usize>>,
    /// Parameters by name.
    pub parameters: Vec<EffectParameter>,
}

/// A parameter of an effect, as written.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectParameter {
    /// Name.
    pub name: String,
    /// Value, SI.
    pub value: Written<f64>,
    /// Unit as text.
    pub unit: Option<Written<String>>,
    /// Interval of 95 %, if the records determine one.
    pub interval: Option<(f64, f64)>,
}

/// A value and where it stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Written<T> {
    /// The value.
    pub value: T,
    /// Its place; `None` for one that was not read from a file.
    pub place: Option<Place>,
}

impl<T> Written<T> {
    /// A value that was not read from a file.
    pub fn new(value: T) -> Self {
        Written { value, place: None }
    }
}

/// How a diagnosis simulated the robot, where the records decided: with the same figures a free run
/// gives the same gap.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulated {
    /// One per joint, base to tip.
    pub joints: Vec<SimulatedJoint>,
    /// Factor on the number of substeps.
    pub substeps: usize,
    /// Whether substeps are as short as those of a gear although there is none.
    pub short_substeps: bool,
    /// Whether the states at the start that no sensor reads are looked for.
    pub hidden_states: bool,
    /// Test records that were fitted too.
    pub fitted_records: Vec<String>,
}

/// Noise levels and sizes of one joint, SI units of the joint.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimulatedJoint {
    /// Standard deviation of a position reading.
    pub position_noise: f64,
    /// Standard deviation of a velocity reading.
    pub velocity_noise: f64,
    /// Standard deviation of the applied torque, from sample to sample.
    pub torque_noise: f64,
    /// Standard deviation of what the torque noise of other joints does to this one, as a torque.
    pub passed_noise: f64,
    /// Typical torque.
    pub torque: f64,
    /// Typical inertia, the other joints free.
    pub inertia: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawEffect {
    id: Spanned<String>,
    joint: Option<Spanned<String>>,
    #[serde(default)]
    parameters: BTreeMap<Spanned<String>, RawParameter>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawParameter {
    value: Spanned<f64>,
    unit: Option<Spanned<String>>,
    interval: Option<Spanned<[f64; 2]>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawSimulated {
    joint: Spanned<Vec<SimulatedJoint>>,
    substeps: Spanned<usize>,
    #[serde(default)]
    short_substeps: bool,
    #[serde(default)]
    hidden_states: bool,
    #[serde(default)]
    fitted_records: Vec<String>,
}

/// Reads effects; `joints` are the names of the robot's joints.
pub(super) fn effects(
    source: &Source<'_>,
    raw: &[RawEffect],
    joints: &[String],
) -> Result<Vec<Effect>, NominalError> {
    raw.iter().map(|raw| effect(source, raw, joints)).collect()
}

fn effect(source: &Source<'_>, raw: &RawEffect, joints: &[String]) -> Result<Effect, NominalError> {
    let item = format!("effect {}", raw.id.get_ref());
    let joint = match &raw.joint {
        None => None,
        Some(name) => {
            let Some(index) = joints.iter().position(|j| j == name.get_ref()) else {
                let like = nearest(name.get_ref(), joints.iter().map(String::as_str));
                let like = like.map_or(String::new(), |n| format!("did you mean `{n}`? "));
                let mend = format!("{like}the joints of the robot are {}", joints.join(", "));
                let found = format!("\"{}\"", name.get_ref());
                return Err(source.error(name, &item, "joint", found, mend));
            };
            Some(written(source, name, index))
        }
    };
    let mut parameters = Vec::with_capacity(raw.parameters.len());
    for (name, own) in &raw.parameters {
        let item = format!("{item}, parameter {}", name.get_ref());
        let value = source.number(&own.value, &item, "value", |_| true, "give a finite number")?;
        let interval = match &own.interval {
            None => None,
            Some(ends) => {
                let [low, high] = source.list(ends, &item, "interval")?;
                if !(low <= value && value <= high) {
                    let mend = format!("an interval holds the value, here {value}");
                    let found = format!("[{low}, {high}]");
                    return Err(source.error(ends, &item, "interval", found, mend));
                }
                Some((low, high))
            }
        };
        parameters.push(EffectParameter {
            name: name.get_ref().clone(),
            value: written(source, &own.value, value),
            unit: (own.unit.as_ref()).map(|unit| written(source, unit, unit.get_ref().clone())),
            interval,
        });
    }
    Ok(Effect {
        id: written(source, &raw.id, raw.id.get_ref().clone()),
        joint,
        parameters,
    })
}

fn written<S, T>(source: &Source<'_>, at: &Spanned<S>, value: T) -> Written<T> {
    Written {
        value,
        place: Some(source.place(at)),
    }
}

/// Reads how the robot was simulated.
pub(super) fn simulated(
    source: &Source<'_>,
    raw: &RawSimulated,
    joints: usize,
) -> Result<Simulated, NominalError> {
    let own = raw.joint.get_ref();
    if own.len() != joints {
        let mend = format!("give one table per joint of the robot, here {joints}");
        let found = format!("a list of {}", own.len());
        return Err(source.error(&raw.joint, "simulated", "joint", found, mend));
    }
    let good = own.iter().all(|j| {
        let levels = [
            j.position_noise,
            j.velocity_noise,
            j.torque_noise,
            j.torque,
            j.inertia,
        ];
        levels.iter().all(|x| x.is_finite() && *x > 0.0)
            && j.passed_noise.is_finite()
            && j.passed_noise >= 0.0
    });
    if !good {
        let mend = "noise levels, torque and inertia are positive; `passed_noise` may be zero";
        return Err(source.error(&raw.joint, "simulated", "joint", "not positive", mend));
    }
    // A thousand substeps per sample would take hours.
    if !(1..=1000).contains(raw.substeps.get_ref()) {
        let mend = "give a whole number from 1 to 1000";
        let found = raw.substeps.get_ref();
        return Err(source.error(&raw.substeps, "simulated", "substeps", found, mend));
    }
    Ok(Simulated {
        joints: own.clone(),
        substeps: *raw.substeps.get_ref(),
        short_substeps: raw.short_substeps,
        hidden_states: raw.hidden_states,
        fitted_records: raw.fitted_records.clone(),
    })
}

/// An error at an effect, for those who know what it may be.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// Where it stands; `None` if it was not read from a file.
    pub place: Option<Place>,
    /// What it is about: `effect stribeck`.
    pub item: String,
    /// The key.
    pub key: &'static str,
    /// The value found.
    pub found: String,
    /// What to write instead.
    pub mend: String,
}

impl Fault {
    /// The error in a file.
    pub fn within(self, file: &Path) -> NominalError {
        NominalError::Value {
            place: self.place.unwrap_or_else(|| Place {
                file: file.display().to_string().into(),
                line: 0,
                column: 0,
            }),
            item: self.item,
            key: self.key,
            found: self.found,
            mend: self.mend,
        }
    }
}
