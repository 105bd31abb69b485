//! Data sets made of data sets: other inputs, further records, fewer records.

use std::borrow::Cow;

use crate::{Dataset, Experiment, InputHold, InputQuantity, Role};

/// A data set that cannot be changed so.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ChangeError {
    /// Factors of inputs that are not one per joint.
    #[error(
        "--input-gain has {found} factors, the data set {joints} joints\n  help: give one per joint, separated by commas"
    )]
    InputGains {
        /// How many were given.
        found: usize,
        /// Joints of the data set.
        joints: usize,
    },
    /// A record without measured torques.
    #[error(
        "record `{record}` has no measured torques (columns tau1 …)\n  help: leave --measured-torque out"
    )]
    NoTorque {
        /// Its name.
        record: String,
    },
    /// Records of different robots.
    #[error(
        "the records of `{second}` are not like those of `{first}`: joints, input units, velocity channels and the hold of inputs must agree\n  help: units and hold of inputs do not count where the drives are off (--gain-factor 'RECORD=off'), units not with --controller"
    )]
    OtherRobot {
        /// The first data set.
        first: String,
        /// The one that differs from it.
        second: String,
    },
    /// A record without commanded positions.
    #[error(
        "record `{record}` has no commanded positions (columns qref1 …)\n  help: leave --targets out"
    )]
    NoTargets {
        /// Its name.
        record: String,
    },
    /// Gains by record that no record has.
    #[error(
        "gain factors `{rule}`: {why}\n  help: RECORD=GAIN:FACTOR, such as `*_kp400=kp:4`, or RECORD=off, where `*` stands for any characters"
    )]
    GainFactors {
        /// The rule.
        rule: String,
        /// What is wrong.
        why: String,
    },
    /// A training record that does not exist.
    #[error("--train: no training record named `{name}`; they are {records}")]
    NoSuchRecord {
        /// Its name.
        name: String,
        /// The names there are.
        records: String,
    },
}

impl Dataset {
    /// The records of several data sets of one robot as one. Inputs of drives that are off do not count: their kind is
    /// that of the others.
    ///
    /// # Errors
    /// [`ChangeError::OtherRobot`].
    pub fn merged(mut self, also: Vec<Dataset>) -> Result<Self, ChangeError> {
        for mut other in also {
            let off = [&self, &other].map(|own| own.experiments.iter().all(Experiment::is_off));
            let free = off.contains(&true);
            let alike = other.joints.len() == self.joints.len()
                && (free || other.input_hold == self.input_hold)
                && self.joints.iter().zip(&other.joints).all(|(a, b)| {
                    (a.prismatic, a.velocity) == (b.prismatic, b.velocity)
                        && (free || a.input_unit == b.input_unit)
                });
            if !alike {
                return Err(ChangeError::OtherRobot {
                    first: self.name,
                    second: other.name,
                });
            }
            match off {
                [_, true] => other.without_inputs(),
                [true, false] => {
                    self.without_inputs();
                    (self.joints, self.input_hold) = (other.joints, other.input_hold);
                }
                [false, false] => {}
            }
            self.name = format!("{} and {}", self.name, other.name);
            self.experiments.extend(other.experiments);
            self.warnings.extend(other.warnings);
        }
        Ok(self)
    }

    /// The data with the measured torques as inputs.
    ///
    /// # Errors
    /// [`ChangeError::NoTorque`].
    pub fn with_measured_torques(mut self) -> Result<Self, ChangeError> {
        self.take_inputs(|e| e.tau.clone())
            .map_err(|record| ChangeError::NoTorque { record })?;
        self.inputs_are_forces();
        self.input_hold = InputHold::Linear;
        Ok(self)
    }

    /// The data with the commanded positions as inputs, which position loops of the drives follow.
    ///
    /// # Errors
    /// [`ChangeError::NoTargets`].
    pub fn with_targets(mut self) -> Result<Self, ChangeError> {
        self.take_inputs(|e| e.targets().map(Cow::into_owned))
            .map_err(|record| ChangeError::NoTargets { record })?;
        for joint in &mut self.joints {
            joint.input = InputQuantity::Position;
            joint.input_unit = joint.unit().to_owned();
        }
        Ok(self)
    }

    /// The data with every input column multiplied by its factor (one per joint, N·m or N per unit
    /// of the column), as torques or forces at the joints.
    ///
    /// # Errors
    /// [`ChangeError::InputGains`].
    pub fn with_input_gains(mut self, gains: &[f64]) -> Result<Self, ChangeError> {
        let nq = self.nq();
        if gains.len() != nq {
            return Err(ChangeError::InputGains {
                found: gains.len(),
                joints: nq,
            });
        }
        self.inputs_are_forces();
        for experiment in &mut self.experiments {
            for row in experiment.u.chunks_exact_mut(nq) {
                row.iter_mut().zip(gains).for_each(|(u, k)| *u *= k);
            }
        }
        Ok(self)
    }

    /// The data without the training records that are not named; all of them if none is.
    ///
    /// # Errors
    /// [`ChangeError::NoSuchRecord`].
    pub fn keeping(mut self, names: &[String]) -> Result<Self, ChangeError> {
        let known = |e: &Experiment| e.role == Role::Train;
        let there = |name: &String| self.experiments.iter().any(|e| known(e) && e.name == *name);
        if let Some(name) = names.iter().find(|name| !there(name)) {
            let records = self.with_role(Role::Train);
            let records: Vec<&str> = records.map(|e| e.name.as_str()).collect();
            return Err(ChangeError::NoSuchRecord {
                name: name.clone(),
                records: records.join(", "),
            });
        }
        if !names.is_empty() {
            self.experiments
                .retain(|e| !known(e) || names.contains(&e.name));
        }
        Ok(self)
    }

    /// Puts another channel in place of the inputs; the name of the first record that has none.
    fn take_inputs(
        &mut self,
        channel: impl Fn(&Experiment) -> Option<Vec<f64>>,
    ) -> Result<(), String> {
        for experiment in &mut self.experiments {
            experiment.u = channel(experiment).ok_or_else(|| experiment.name.clone())?;
        }
        Ok(())
    }

    /// Sets all inputs to zero.
    fn without_inputs(&mut self) {
        let inputs = self.experiments.iter_mut().flat_map(|e| &mut e.u);
        inputs.for_each(|u| *u = 0.0);
    }

    fn inputs_are_forces(&mut self) {
        for joint in &mut self.joints {
            joint.input = match joint.prismatic {
                true => InputQuantity::Force,
                false => InputQuantity::Torque,
            };
            joint.input_unit = joint.force_unit().to_owned();
        }
    }
}
