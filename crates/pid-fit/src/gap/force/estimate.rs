//! A missing force as it was estimated.

use std::fmt;

use pid_data::signal::SignalError;

/// Missing force of one experiment, at the middle of each of its N − 1 intervals; (N − 1) × nq, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct MissingForceEstimate {
    /// Times, s; N − 1.
    pub t: Vec<f64>,
    /// Positions, rad or m.
    pub q: Vec<f64>,
    /// Velocities, rad/s or m/s.
    pub v: Vec<f64>,
    /// Missing force w, N·m or N.
    pub w: Vec<f64>,
    /// Two standard deviations of w, given the record.
    pub band: Vec<f64>,
    /// Total generalised force of drives and friction, f_L + w = M a + b.
    pub total: Vec<f64>,
    /// The noise levels behind it.
    pub noise: NoiseLevels,
    /// Whether the noise levels settled. If not, w belongs to the last ones.
    pub settled: bool,
}

/// Standard deviations found by expectation maximisation, one per joint.
#[derive(Debug, Clone, PartialEq)]
pub struct NoiseLevels {
    /// Of the position channel, rad or m.
    pub position: Vec<f64>,
    /// Of the velocity channel, rad/s or m/s; NaN where there is none of its own.
    pub velocity: Vec<f64>,
    /// Change of the missing force within one second, N·m or N.
    pub drift: Vec<f64>,
}

/// Why a missing force cannot be estimated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MissingForceError {
    /// No states to start from.
    #[error(transparent)]
    Signal(#[from] SignalError),
    /// The model cannot be evaluated along the record.
    #[error(
        "experiment `{experiment}`, t = {time} s: the model has no finite value, or no regular mass matrix, at q = {q}, v = {v}\n  help: check the parameters, and whether the record leaves the range the model is meant for"
    )]
    Model {
        /// The experiment.
        experiment: String,
        /// Time, s.
        time: f64,
        /// Positions there.
        q: Values,
        /// Velocities there.
        v: Values,
    },
}

/// Formats numbers for a message.
#[derive(Debug, Clone, PartialEq)]
pub struct Values(pub Vec<f64>);

impl fmt::Display for Values {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("[")?;
        for (i, x) in self.0.iter().enumerate() {
            write!(f, "{}{x:.6}", if i > 0 { ", " } else { "" })?;
        }
        f.write_str("]")
    }
}
