//! What keeps a folder from being diagnosed.

use pid_data::{DataError, Role};

use crate::nominal::NominalError;

/// A folder that cannot be diagnosed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CaseError {
    /// The nominal description.
    #[error(transparent)]
    Nominal(#[from] NominalError),
    /// The records.
    #[error(transparent)]
    Data(#[from] DataError),
    /// A record is too short.
    #[error("record `{record}` has {samples} samples; a diagnosis needs at least {needed}")]
    Short {
        /// The record.
        record: String,
        /// Its samples.
        samples: usize,
        /// Fewest that will do.
        needed: usize,
    },
    /// Target positions without a loop that follows them.
    #[error(
        "joint `{joint}`: its input is a target position, and the description has no position loop for it\n  help: add a table [drive] (or [joint.drive]) to nominal.toml, as in law = \"pd\", kp = {{ unknown = true }}, kd = {{ unknown = true }}"
    )]
    NoDrive {
        /// The joint.
        joint: String,
    },
    /// A position loop without its targets.
    #[error(
        "record `{record}`: the drive of joint `{joint}` follows a target position, and there is no column qref{column}\n  help: record the targets, or leave [drive] out (law = \"none\" for one joint)"
    )]
    NoTarget {
        /// The record.
        record: String,
        /// The joint.
        joint: String,
        /// Its number, from 1.
        column: usize,
    },
    /// A gain that differs from record to record and that the loop does not have.
    #[error(
        "record `{record}`: gain_factors.{gain} = {value} at joint `{joint}`, whose drive has no {gain}\n  help: name a gain of its law in [drive] of the description, or leave the factor out"
    )]
    NoGain {
        /// The record.
        record: String,
        /// The gain.
        gain: &'static str,
        /// The factor.
        value: f64,
        /// The joint.
        joint: String,
    },
    /// Targets that the joint does not follow.
    #[error(
        "{place}: joint `{joint}`: no force pushes it towards its targets, so the records do not say where its unknown kp lies\n  help: check column and sign of the targets and the sign of `motor_gain`, or state kp with a tolerance"
    )]
    NoLoop {
        /// The joint.
        joint: String,
        /// Where its loop is stated.
        place: String,
    },
    /// A loop that cannot hold its joint.
    #[error(
        "{place}: joint `{joint}`: {why}, with every gain within the tolerances\n  help: check gains, `rate_hz`, `motor_gain` and the inertia; a gain of another drive's unit is often a factor off"
    )]
    Unstable {
        /// The joint.
        joint: String,
        /// Where its loop is stated.
        place: String,
        /// What makes it unstable.
        why: String,
    },
    /// There is nothing to fit on or to judge with.
    #[error("no record has the role `{role}`; mark at least one in dataset.toml")]
    NoRole {
        /// The role.
        role: Role,
    },
}
