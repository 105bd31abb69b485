//! Why a regression cannot be done.

use pid_data::signal::SignalError;

use crate::regress::instruments::InstrumentError;
use crate::regress::solution::RegressionError;
use crate::regress::unknowns::UnknownsError;

/// A regression that cannot be done.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RegressError {
    /// A record cannot be filtered.
    #[error(transparent)]
    Signal(#[from] SignalError),
    /// Instruments cannot be made.
    #[error(transparent)]
    Instruments(#[from] InstrumentError),
    /// The normal equations cannot be solved.
    #[error(transparent)]
    Regression(#[from] RegressionError),
    /// A parameter to hold that does not exist.
    #[error(
        "the model has no parameter `{name}` to hold\n  help: `simtrue models` lists the models, the report their parameters"
    )]
    UnknownParameter {
        /// Its name.
        name: String,
    },
    /// Prior knowledge of a parameter that the regression does not estimate.
    #[error("a prior of `{name}`, which the regression does not estimate: {reason}")]
    Prior {
        /// Its name.
        name: String,
        /// Why.
        reason: &'static str,
    },
    /// Deviations of gains that are not one per joint.
    #[error(
        "{found} deviations of gains for {joints} joints\n  help: one per joint, a share of its gain (0.1: known to 10 %), 0 where it is known"
    )]
    Gains {
        /// How many were given.
        found: usize,
        /// Joints.
        joints: usize,
    },
    /// A deviation that is none.
    #[error(
        "the gain of joint {joint} has the deviation {value}\n  help: a share of the gain, 0 or above (0.1: known to 10 %)"
    )]
    Gain {
        /// Joint from 1.
        joint: usize,
        /// What was given.
        value: f64,
    },
    /// Unknowns that do not fit.
    #[error(transparent)]
    Unknowns(#[from] UnknownsError),
    /// Instruments with what they have no form for.
    #[error(
        "instrumental variables take neither {what}\n  help: leave it out, or use least squares"
    )]
    InstrumentsAlone {
        /// What was asked for besides.
        what: &'static str,
    },
}
