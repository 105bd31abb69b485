//! Files of assumptions: noise, priors, losses and what is held (`docs/assumptions-format.md`).

use std::collections::BTreeMap;

use crate::ident::Likelihood;
use crate::transcribe::{Loss, Prior};
use pid_data::Dataset;
use pid_runtime::dynamics::{Dynamics, ParamInfo};
use serde::Deserialize;

/// A file of assumptions that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AssumptionsError {
    /// Not TOML of this format.
    #[error("{file}: {message}\n  help: docs/assumptions-format.md describes the keys")]
    Toml {
        /// The file.
        file: String,
        /// What the parser says, with line and column.
        message: String,
    },
    /// A joint that the data set does not have.
    #[error(
        "{file}: [noise.{joint}]: the data set has no joint `{joint}`; its joints are {joints}"
    )]
    UnknownJoint {
        /// The file.
        file: String,
        /// The name.
        joint: String,
        /// The joints there are.
        joints: String,
    },
    /// A parameter that the model does not have.
    #[error(
        "{file}: {place}: the model has no parameter `{name}`\n  help: its parameters are {parameters}"
    )]
    UnknownParameter {
        /// The file.
        file: String,
        /// Table or key.
        place: String,
        /// The name.
        name: String,
        /// The parameters there are.
        parameters: String,
    },
    /// A number that cannot be meant.
    #[error("{file}: {place} = {value}: {demand}")]
    Value {
        /// The file.
        file: String,
        /// Table and key.
        place: String,
        /// What stands there.
        value: f64,
        /// What is needed.
        demand: &'static str,
    },
    /// Width of a prior said twice, or not at all.
    #[error(
        "{file}: [prior.{name}] states {count} of `deviation`, `tolerance` and `relative_tolerance`\n  help: state exactly one"
    )]
    PriorWidth {
        /// The file.
        file: String,
        /// The parameter.
        name: String,
        /// How many are stated.
        count: usize,
    },
}

/// What a file says, checked against model and data.
#[derive(Debug, Clone, PartialEq)]
pub struct Assumptions {
    /// Noise, loss and priors.
    pub likelihood: Likelihood,
    /// Positions of held parameters.
    pub hold: Vec<usize>,
    /// Values for the start: means of priors, held values.
    pub values: Vec<(usize, f64)>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    loss: LossName,
    threshold: Option<f64>,
    freedom: Option<f64>,
    #[serde(default)]
    noise: BTreeMap<String, Noise>,
    #[serde(default)]
    prior: BTreeMap<String, PriorTable>,
    #[serde(default)]
    hold: BTreeMap<String, f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum LossName {
    #[default]
    Square,
    Huber,
    StudentT,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Noise {
    position: Option<f64>,
    resolution: Option<f64>,
    velocity: Option<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PriorTable {
    value: Option<f64>,
    deviation: Option<f64>,
    tolerance: Option<f64>,
    relative_tolerance: Option<f64>,
}

/// Threshold of Huber's loss without one: 95 % efficiency for normal errors.
const THRESHOLD: f64 = 1.345;
/// Degrees of freedom of Student's t without them.
const FREEDOM: f64 = 4.0;

impl Assumptions {
    /// Reads a text; `file` is its name in messages.
    ///
    /// # Errors
    /// [`AssumptionsError`].
    pub fn parse(
        file: &str,
        text: &str,
        model: &dyn Dynamics,
        dataset: &Dataset,
    ) -> Result<Self, AssumptionsError> {
        let read: File = toml::from_str(text).map_err(|e| AssumptionsError::Toml {
            file: file.to_owned(),
            message: e.to_string().trim_end().to_owned(),
        })?;
        let params = model.params();
        let positive = |place: String, value: f64| {
            if value.is_finite() && value > 0.0 {
                Ok(value)
            } else {
                Err(AssumptionsError::Value {
                    file: file.to_owned(),
                    place,
                    value,
                    demand: "a number above zero is needed",
                })
            }
        };
        let loss = match read.loss {
            LossName::Square => Loss::Square,
            LossName::Huber => Loss::Huber {
                threshold: positive("threshold".into(), read.threshold.unwrap_or(THRESHOLD))?,
            },
            LossName::StudentT => Loss::StudentT {
                freedom: positive("freedom".into(), read.freedom.unwrap_or(FREEDOM))?,
            },
        };
        let nq = dataset.nq();
        let mut noise = vec![None; 2 * nq];
        for (name, table) in &read.noise {
            let Some(j) = dataset.joints.iter().position(|j| j.name == *name) else {
                return Err(AssumptionsError::UnknownJoint {
                    file: file.to_owned(),
                    joint: name.clone(),
                    joints: list(dataset.joints.iter().map(|j| j.name.as_str())),
                });
            };
            let at = |key: &str| format!("[noise.{name}] {key}");
            let part = |key: &str, value: Option<f64>| -> Result<Option<f64>, AssumptionsError> {
                value.map(|value| positive(at(key), value)).transpose()
            };
            let position = part("position", table.position)?;
            let resolution = part("resolution", table.resolution)?;
            if position.is_some() || resolution.is_some() {
                // A rounded reading is off by a uniform error of variance δ²/12.
                let square =
                    position.unwrap_or(0.0).powi(2) + resolution.unwrap_or(0.0).powi(2) / 12.0;
                noise[j] = Some(square.sqrt());
            }
            noise[nq + j] = part("velocity", table.velocity)?;
        }
        let mut priors = Vec::new();
        let mut values = Vec::new();
        for (name, table) in &read.prior {
            let j = find(file, &format!("[prior.{name}]"), name, params)?;
            let info = &params[j];
            let mean = within(
                file,
                format!("[prior.{name}] value"),
                table.value.unwrap_or(info.nominal),
                info,
            )?;
            let widths = [
                table.deviation,
                // Uniform within ± tolerance has this deviation.
                table.tolerance.map(|t| t / 3.0_f64.sqrt()),
                table
                    .relative_tolerance
                    .map(|t| t * mean.abs() / 3.0_f64.sqrt()),
            ];
            let stated: Vec<f64> = widths.iter().flatten().copied().collect();
            let [deviation] = stated.as_slice() else {
                return Err(AssumptionsError::PriorWidth {
                    file: file.to_owned(),
                    name: name.clone(),
                    count: stated.len(),
                });
            };
            priors.push(Prior {
                parameter: j,
                mean,
                deviation: positive(format!("[prior.{name}] width"), *deviation)?,
            });
            values.push((j, mean));
        }
        let mut hold = Vec::new();
        for (name, value) in &read.hold {
            let j = find(file, "[hold]", name, params)?;
            values.push((
                j,
                within(file, format!("[hold] {name}"), *value, &params[j])?,
            ));
            hold.push(j);
        }
        Ok(Self {
            likelihood: Likelihood {
                noise,
                loss,
                priors,
            },
            hold,
            values,
        })
    }
}

fn within(
    file: &str,
    place: String,
    value: f64,
    info: &ParamInfo,
) -> Result<f64, AssumptionsError> {
    if (info.lower..=info.upper).contains(&value) {
        Ok(value)
    } else {
        Err(AssumptionsError::Value {
            file: file.to_owned(),
            place,
            value,
            demand: "a value within the parameter's bounds in the model is needed",
        })
    }
}

fn find(
    file: &str,
    place: &str,
    name: &str,
    params: &[ParamInfo],
) -> Result<usize, AssumptionsError> {
    params
        .iter()
        .position(|p| p.name == name)
        .ok_or_else(|| AssumptionsError::UnknownParameter {
            file: file.to_owned(),
            place: place.to_owned(),
            name: name.to_owned(),
            parameters: list(params.iter().map(|p| p.name.as_ref())),
        })
}

fn list<'a>(names: impl Iterator<Item = &'a str>) -> String {
    names.collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Recipe, records};
    use pid_models::ServoPendulum;

    fn read(text: &str) -> Result<Assumptions, AssumptionsError> {
        let recipe = Recipe {
            records: 1,
            seconds: 0.1,
            step: 0.01,
            amplitude: vec![0.1],
            highest: 20.0,
            start: vec![0.0],
            noise: vec![0.0, 0.0],
            outliers: (0.0, 1.0),
        };
        let nominal: Vec<f64> = ServoPendulum.params().iter().map(|p| p.nominal).collect();
        let dataset = records(&ServoPendulum, &nominal, &recipe, 0).expect("simulates");
        Assumptions::parse("a.toml", text, &ServoPendulum, &dataset)
    }

    #[test]
    fn a_file_is_read() {
        let text = "loss = \"huber\"\n[noise.shaft]\nposition = 3e-4\nresolution = 1.2e-3\n\
                    [prior.m]\nrelative_tolerance = 0.05\n[prior.l]\nvalue = 0.11\ndeviation = 0.002\n\
                    [hold]\ngain_shaft = 0.35\n";
        let found = read(text).expect("readable");
        let likelihood = &found.likelihood;
        assert_eq!(likelihood.loss, Loss::Huber { threshold: 1.345 });
        let expected = f64::sqrt(9e-8 + 1.44e-6 / 12.0);
        assert!((likelihood.noise[0].unwrap() - expected).abs() < 1e-15);
        assert_eq!(likelihood.noise[1], None);
        assert_eq!(likelihood.priors[0].mean, 0.11);
        let of_mass = likelihood.priors[1];
        assert_eq!((of_mass.parameter, of_mass.mean), (0, 0.49));
        assert!((of_mass.deviation - 0.0245 / 3.0_f64.sqrt()).abs() < 1e-15);
        assert_eq!((found.hold[0], found.values.len()), (2, 3));
    }

    #[test]
    fn mistakes_name_file_place_and_mend() {
        for (text, parts) in [
            ("los = 1", ["a.toml", "unknown field `los`"]),
            (
                "[noise.shft]\nposition = 1",
                ["[noise.shft]", "its joints are shaft"],
            ),
            (
                "[noise.shaft]\nposition = -1",
                ["[noise.shaft] position = -1", "above zero"],
            ),
            (
                "[prior.mass]\ntolerance = 1",
                ["[prior.mass]", "m, l, gain_shaft"],
            ),
            ("[prior.m]\nvalue = 0.5", ["states 0 of", "exactly one"]),
            (
                "[prior.m]\ntolerance = 1\ndeviation = 1",
                ["states 2 of", "exactly one"],
            ),
            (
                "[prior.m]\nvalue = 9\ndeviation = 1",
                ["[prior.m] value = 9", "bounds"],
            ),
            (
                "loss = \"huber\"\nthreshold = 0",
                ["threshold = 0", "above zero"],
            ),
        ] {
            let message = read(text).unwrap_err().to_string();
            assert!(
                parts.iter().all(|p| message.contains(p)),
                "{text}: {message}"
            );
        }
    }
}
