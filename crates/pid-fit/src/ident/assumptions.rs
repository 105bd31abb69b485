//! Files of assumptions: noise, priors, losses and held parameters (`docs/assumptions-format.md`).

use std::collections::BTreeMap;

use crate::ident::Likelihood;
use crate::transcribe::{Loss, Prior};
use pid_data::Dataset;
use pid_runtime::dynamics::{Dynamics, ParamInfo};
use pid_toml::{Place, Source, Spanned};
use serde::Deserialize;

/// Priors, and the values that parameters start from.
type PriorsAndStarts = (Vec<Prior>, Vec<(usize, f64)>);

/// A file of assumptions that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AssumptionsError {
    /// Not TOML of this format.
    #[error("{0}\n  the keys: docs/assumptions-format.md")]
    Toml(#[from] pid_toml::Mistake),
    /// A joint that the data set does not have.
    #[error(
        "{place}: [noise.{joint}]: the data set has no joint `{joint}`; its joints are {joints}\n  help: {mend}"
    )]
    UnknownJoint {
        /// Where the name stands.
        place: Place,
        /// The name.
        joint: String,
        /// The joints there are.
        joints: String,
        /// What to write instead.
        mend: String,
    },
    /// A parameter that the model does not have.
    #[error(
        "{place}: {table}: the model has no parameter `{name}`; its parameters are {parameters}\n  help: {mend}"
    )]
    UnknownParameter {
        /// Where the name stands.
        place: Place,
        /// The table.
        table: String,
        /// The name.
        name: String,
        /// The parameters there are.
        parameters: String,
        /// What to write instead.
        mend: String,
    },
    /// A number that is not allowed there.
    #[error("{place}: {key} = {value}: {demand}")]
    Value {
        /// Where the value stands.
        place: Place,
        /// Table and key.
        key: String,
        /// The number.
        value: f64,
        /// The requirement.
        demand: &'static str,
    },
    /// Width of a prior said twice, or not at all.
    #[error(
        "{place}: [prior.{name}] states {count} of `deviation`, `tolerance` and `relative_tolerance`\n  help: state exactly one"
    )]
    PriorWidth {
        /// Where the prior stands.
        place: Place,
        /// The parameter.
        name: String,
        /// How many are stated.
        count: usize,
    },
}

/// The content of a file, checked against model and data.
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
    threshold: Option<Number>,
    freedom: Option<Number>,
    #[serde(default)]
    noise: BTreeMap<Spanned<String>, Noise>,
    #[serde(default)]
    prior: BTreeMap<Spanned<String>, PriorTable>,
    #[serde(default)]
    hold: BTreeMap<Spanned<String>, Number>,
}

/// A number and its place.
type Number = Spanned<f64>;

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
    position: Option<Number>,
    resolution: Option<Number>,
    velocity: Option<Number>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PriorTable {
    value: Option<Number>,
    deviation: Option<Number>,
    tolerance: Option<Number>,
    relative_tolerance: Option<Number>,
}

/// Threshold of Huber's loss if none is stated: 95 % efficiency for normal errors.
const THRESHOLD: f64 = 1.345;
/// Degrees of freedom of Student's t if none are stated.
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
        let reader = Reader {
            source: Source::new(file, text),
            params: model.params(),
        };
        let read: File = reader.source.parse()?;
        let (priors, mut values) = reader.priors(&read.prior)?;
        let mut hold = Vec::new();
        for (name, value) in &read.hold {
            let j = reader.find("[hold]", name)?;
            let key = format!("[hold] {}", name.as_ref());
            values.push((j, reader.within(key, value, j)?));
            hold.push(j);
        }
        Ok(Self {
            likelihood: Likelihood {
                noise: reader.noise(&read.noise, dataset)?,
                loss: reader.loss(&read)?,
                priors,
            },
            hold,
            values,
        })
    }
}

/// The file and the parameters it may name.
struct Reader<'a> {
    source: Source<'a>,
    params: &'a [ParamInfo],
}

impl Reader<'_> {
    fn loss(&self, read: &File) -> Result<Loss, AssumptionsError> {
        let number = |key: &str, value: &Option<Number>, absent: f64| match value {
            Some(value) => self.positive(key.to_owned(), value, *value.as_ref()),
            None => Ok(absent),
        };
        Ok(match read.loss {
            LossName::Square => Loss::Square,
            LossName::Huber => Loss::Huber {
                threshold: number("threshold", &read.threshold, THRESHOLD)?,
            },
            LossName::StudentT => Loss::StudentT {
                freedom: number("freedom", &read.freedom, FREEDOM)?,
            },
        })
    }

    /// Standard deviations of the positions, then of the velocities; `None` where the file says nothing.
    fn noise(
        &self,
        tables: &BTreeMap<Spanned<String>, Noise>,
        dataset: &Dataset,
    ) -> Result<Vec<Option<f64>>, AssumptionsError> {
        let nq = dataset.nq();
        let mut noise = vec![None; 2 * nq];
        for (at, table) in tables {
            let name = at.as_ref();
            let joints = || dataset.joints.iter().map(|j| j.name.as_str());
            let Some(j) = joints().position(|j| j == name) else {
                return Err(AssumptionsError::UnknownJoint {
                    place: self.source.place_of(at),
                    joint: name.clone(),
                    joints: pid_toml::list(joints()),
                    mend: pid_toml::one_of(name, joints()),
                });
            };
            let part = |key: &str, value: &Option<Number>| {
                let read = |value: &Number| {
                    self.positive(format!("[noise.{name}] {key}"), value, *value.as_ref())
                };
                value.as_ref().map(read).transpose()
            };
            let position = part("position", &table.position)?;
            let resolution = part("resolution", &table.resolution)?;
            if position.is_some() || resolution.is_some() {
                // A rounded reading is off by a uniform error of variance δ²/12.
                let square =
                    position.unwrap_or(0.0).powi(2) + resolution.unwrap_or(0.0).powi(2) / 12.0;
                noise[j] = Some(square.sqrt());
            }
            noise[nq + j] = part("velocity", &table.velocity)?;
        }
        Ok(noise)
    }

    /// Priors, and the values they start from.
    fn priors(
        &self,
        tables: &BTreeMap<Spanned<String>, PriorTable>,
    ) -> Result<PriorsAndStarts, AssumptionsError> {
        let mut priors = Vec::new();
        let mut values = Vec::new();
        for (at, table) in tables {
            let name = at.as_ref();
            let j = self.find(&format!("[prior.{name}]"), at)?;
            let mean = match &table.value {
                Some(value) => self.within(format!("[prior.{name}] value"), value, j)?,
                None => self.params[j].nominal,
            };
            // Uniform within ± tolerance has the deviation tolerance/√3.
            let uniform = 3.0_f64.sqrt();
            let widths = [
                (&table.deviation, 1.0, 1.0),
                (&table.tolerance, 1.0, uniform),
                (&table.relative_tolerance, mean.abs(), uniform),
            ];
            let stated: Vec<(&Number, f64, f64)> = widths
                .iter()
                .filter_map(|(width, factor, divisor)| Some((width.as_ref()?, *factor, *divisor)))
                .collect();
            let [(width, factor, divisor)] = stated.as_slice() else {
                return Err(AssumptionsError::PriorWidth {
                    place: self.source.place_of(at),
                    name: name.clone(),
                    count: stated.len(),
                });
            };
            let deviation = *width.as_ref() * factor / divisor;
            priors.push(Prior {
                parameter: j,
                mean,
                deviation: self.positive(format!("[prior.{name}] width"), width, deviation)?,
            });
            values.push((j, mean));
        }
        Ok((priors, values))
    }

    /// `value`, which the file states at `at`, if it is finite and above zero.
    fn positive(&self, key: String, at: &Number, value: f64) -> Result<f64, AssumptionsError> {
        if value.is_finite() && value > 0.0 {
            return Ok(value);
        }
        Err(AssumptionsError::Value {
            place: self.source.place_of(at),
            key,
            value,
            demand: "a number above zero is needed",
        })
    }

    /// A value within the bounds of parameter `j`.
    fn within(&self, key: String, value: &Number, j: usize) -> Result<f64, AssumptionsError> {
        let info = &self.params[j];
        let x = *value.as_ref();
        if (info.lower..=info.upper).contains(&x) {
            return Ok(x);
        }
        Err(AssumptionsError::Value {
            place: self.source.place_of(value),
            key,
            value: x,
            demand: "a value within the parameter's bounds in the model is needed",
        })
    }

    /// Position of a parameter by its name.
    fn find(&self, table: &str, name: &Spanned<String>) -> Result<usize, AssumptionsError> {
        let names = || self.params.iter().map(|p| p.name.as_ref());
        let found = names().position(|p| p == name.as_ref());
        found.ok_or_else(|| AssumptionsError::UnknownParameter {
            place: self.source.place_of(name),
            table: table.to_owned(),
            name: name.as_ref().clone(),
            parameters: pid_toml::list(names()),
            mend: pid_toml::one_of(name.as_ref(), names()),
        })
    }
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
            (
                "los = 1",
                ["a.toml:1:1: unknown field `los`", "did you mean `loss`?"],
            ),
            ("loss = \"hubr\"", ["a.toml:1:8: ", "did you mean `huber`?"]),
            (
                "[prior.m]\nvalue = \"1\"",
                ["a.toml:2:9: ", "write a number"],
            ),
            (
                "[noise.shft]\nposition = 1",
                [
                    "a.toml:1:8: [noise.shft]",
                    "its joints are shaft\n  help: did you mean `shaft`?",
                ],
            ),
            (
                "[noise.shaft]\nposition = -1",
                ["a.toml:2:12: [noise.shaft] position = -1", "above zero"],
            ),
            (
                "[prior.mass]\ntolerance = 1",
                ["a.toml:1:8: [prior.mass]", "m, l, gain_shaft"],
            ),
            ("[prior.m]\nvalue = 0.5", ["states 0 of", "exactly one"]),
            (
                "[prior.m]\ntolerance = 1\ndeviation = 1",
                ["states 2 of", "exactly one"],
            ),
            (
                "[prior.m]\nvalue = 9\ndeviation = 1",
                ["a.toml:2:9: [prior.m] value = 9", "bounds"],
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
