//! Files of controllers (`docs/controller-format.md`): gains and limits of the loop of each record.

use pid_data::{Dataset, Experiment, InputQuantity, matches};
use pid_toml::{Place, Source, Spanned};
use serde::Deserialize;

use pid_runtime::control::{INPUTS, NotOnePerJoint, UNLIMITED};

/// A controller that does not fit the model or the records.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ControlError {
    /// The model's inputs are not one per joint.
    #[error(transparent)]
    Inputs(#[from] NotOnePerJoint),
    /// Not TOML of this format.
    #[error("{0}\n  the keys: docs/controller-format.md")]
    Toml(#[from] pid_toml::Mistake),
    /// Numbers for more or fewer joints than there are.
    #[error("{place}: record `{record}`: {key} has {found} values, the model has {joints} joints")]
    Length {
        /// Where the list stands; the record, where it has none.
        place: Place,
        /// Pattern of the record.
        record: String,
        /// The key.
        key: &'static str,
        /// Values given.
        found: usize,
        /// Joints.
        joints: usize,
    },
    /// A record that no entry names.
    #[error(
        "{file}: no [[record]] matches the record `{record}`\n  help: add one; `name = \"*\"` matches every record"
    )]
    NoEntry {
        /// The file.
        file: String,
        /// The record.
        record: String,
    },
    /// A record without commanded positions.
    #[error(
        "record `{record}` has no commanded positions (columns qref1 …), which its controller would follow\n  help: say `off = true` for it in the controller's file, or leave it out"
    )]
    NoReference {
        /// The record.
        record: String,
    },
    /// A number that is not allowed there.
    #[error("{place}: record `{record}`: {key} = {value}: {demand}")]
    Value {
        /// Where the list with the value stands.
        place: Place,
        /// Pattern of the record.
        record: String,
        /// The key.
        key: &'static str,
        /// The value.
        value: f64,
        /// The requirement.
        demand: &'static str,
    },
}

/// Controllers of the records of a data set (`docs/controller-format.md`).
#[derive(Debug, Clone, PartialEq)]
pub struct Controllers {
    file: String,
    entries: Vec<Entry>,
}

#[derive(Debug, Clone, PartialEq)]
struct Entry {
    name: String,
    p: Vec<f64>,
    d: Vec<f64>,
    limit: Vec<f64>,
    off: bool,
}

/// An entry as written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawEntry {
    name: Spanned<String>,
    p: Option<Spanned<Vec<f64>>>,
    d: Option<Spanned<Vec<f64>>>,
    limit: Option<Spanned<Vec<f64>>>,
    #[serde(default)]
    off: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    record: Vec<RawEntry>,
}

impl RawEntry {
    fn check(self, source: &Source<'_>, joints: usize) -> Result<Entry, ControlError> {
        let list = |key, list: Option<Spanned<Vec<f64>>>| {
            let needed = key == "p" && !self.off;
            let place = || match &list {
                Some(list) => source.place_of(list),
                None => source.place_of(&self.name),
            };
            let values = list.as_ref().map_or(&[][..], |list| list.as_ref());
            if values.len() != joints && (needed || !values.is_empty()) {
                return Err(ControlError::Length {
                    place: place(),
                    record: self.name.as_ref().clone(),
                    key,
                    found: values.len(),
                    joints,
                });
            }
            let bad = |x: &&f64| !x.is_finite() || key == "limit" && **x <= 0.0;
            match values.iter().find(bad) {
                Some(value) => Err(ControlError::Value {
                    place: place(),
                    record: self.name.as_ref().clone(),
                    key,
                    value: *value,
                    demand: "a finite number, for a limit above zero, is needed",
                }),
                None => Ok(values.to_vec()),
            }
        };
        Ok(Entry {
            p: list("p", self.p)?,
            d: list("d", self.d)?,
            limit: list("limit", self.limit)?,
            off: self.off,
            name: self.name.into_inner(),
        })
    }
}

impl Controllers {
    /// Reads a text; `file` is its name in messages.
    ///
    /// # Errors
    /// [`ControlError`].
    pub fn parse(file: &str, text: &str, joints: usize) -> Result<Self, ControlError> {
        let source = Source::new(file, text);
        let read: File = source.parse()?;
        let entries = read.record.into_iter();
        Ok(Self {
            file: file.to_owned(),
            entries: entries
                .map(|entry| entry.check(&source, joints))
                .collect::<Result<_, _>>()?,
        })
    }

    /// The records with the controllers' inputs in place of the recorded ones.
    ///
    /// # Errors
    /// [`ControlError::NoEntry`], [`ControlError::NoReference`].
    pub fn close(&self, mut dataset: Dataset) -> Result<Dataset, ControlError> {
        let nq = dataset.nq();
        for experiment in &mut dataset.experiments {
            let entry = self
                .entries
                .iter()
                .find(|e| matches(&e.name, &experiment.name))
                .ok_or_else(|| ControlError::NoEntry {
                    file: self.file.clone(),
                    record: experiment.name.clone(),
                })?;
            experiment.u = inputs(entry, experiment, nq)?;
        }
        for joint in &mut dataset.joints {
            joint.input = InputQuantity::Position;
            joint.input_unit = joint.unit().to_owned();
        }
        Ok(dataset)
    }
}

fn inputs(entry: &Entry, experiment: &Experiment, nq: usize) -> Result<Vec<f64>, ControlError> {
    if !entry.off && experiment.qref.is_none() {
        return Err(ControlError::NoReference {
            record: experiment.name.clone(),
        });
    }
    let constant = |list: &[f64], j: usize, absent: f64| list.get(j).copied().unwrap_or(absent);
    let mut u = Vec::with_capacity(experiment.len() * nq * INPUTS);
    for k in 0..experiment.len() {
        match (&experiment.qref, entry.off) {
            (Some(qref), false) => u.extend_from_slice(&qref[k * nq..(k + 1) * nq]),
            _ => u.extend(std::iter::repeat_n(0.0, nq)),
        }
        u.extend((0..nq).map(|j| constant(&entry.p, j, 0.0)));
        u.extend((0..nq).map(|j| constant(&entry.d, j, 0.0)));
        u.extend((0..nq).map(|j| constant(&entry.limit, j, UNLIMITED)));
        u.extend(std::iter::repeat_n(f64::from(u8::from(!entry.off)), nq));
    }
    Ok(u)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mistakes_are_named() {
        for (text, part) in [
            (
                "[[record]]\nname = \"*\"\np = [1.0, 2.0]",
                "c.toml:3:5: record `*`: p has 2 values, the model has 1",
            ),
            (
                "[[record]]\nname = \"*\"",
                "c.toml:2:8: record `*`: p has 0 values",
            ),
            (
                "[[record]]\nname = \"*\"\np = [1.0]\nlimit = [0.0]",
                "c.toml:4:9: record `*`: limit = 0",
            ),
            ("[[record]]\nname = \"*\"\nkp = [1.0]", "unknown field `kp`"),
        ] {
            let message = Controllers::parse("c.toml", text, 1)
                .unwrap_err()
                .to_string();
            assert!(
                message.contains(part) && message.contains("c.toml"),
                "{message}"
            );
        }
    }
}
