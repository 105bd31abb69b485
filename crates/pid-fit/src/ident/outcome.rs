//! What an identification tells while it runs, and what it found.

use std::ops::ControlFlow;

use pid_data::Role;
use pid_nlp::PointCheck;
use pid_nlp::solver::{Iteration, Status};
use serde::{Deserialize, Serialize};

use super::uncertainty::{Covariance, OpenDirection};

/// Progress of a running identification.
#[derive(Debug, Clone, Copy)]
pub struct Progress<'a> {
    /// Start at work, from 0.
    pub start: usize,
    /// Number of starts.
    pub starts: usize,
    /// Name of the phase.
    pub phase: &'static str,
    /// The iteration that was finished.
    pub iteration: &'a Iteration,
}

/// Receives [`Progress`]; `Break` ends the identification and keeps the results so far.
pub type Callback<'a> = dyn FnMut(&Progress<'_>) -> ControlFlow<()> + 'a;

/// The outcome of one start.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Its number, from 0.
    pub index: usize,
    /// Parameters it started from.
    pub start: Vec<f64>,
    /// Parameters it reached.
    pub parameters: Vec<f64>,
    /// Objective J there; NaN if it could not be evaluated.
    pub objective: f64,
    /// Why it stopped.
    pub status: Status,
    /// Iterations, those of the preparing fit included.
    pub iterations: usize,
    /// Seconds.
    pub seconds: f64,
    /// Independent check of the point.
    pub check: PointCheck,
    /// The log.
    pub log: Vec<Iteration>,
}

/// A finished identification.
#[derive(Debug, Clone, PartialEq)]
pub struct Identification {
    /// All starts, in order.
    pub runs: Vec<Run>,
    /// Position of the best one: converged first, then the lowest objective.
    pub best: usize,
    /// The local optima that the starts reached, the lowest objective first; empty for the equation error.
    pub optima: Vec<Optimum>,
    /// Its fitted states (q, v) at the samples, windows one after another; empty for the equation error.
    pub motion: Vec<f64>,
    /// Standard deviations of its parameters; `None` where the data do not determine a parameter by
    /// itself, where it lies at a bound and where it is held.
    pub deviations: Vec<Option<f64>>,
    /// Number of directions in parameter space that the data do not determine.
    pub undetermined: usize,
    /// The undetermined directions.
    pub open: Vec<OpenDirection>,
    /// Joint covariance of the parameters that are neither held nor at a bound.
    pub covariance: Option<Covariance>,
    /// Whether deviations and covariance are of the sandwich form ([`super::Settings::sandwich`]).
    pub sandwich: bool,
    /// Standard deviation of each channel's residuals (positions of all joints, then velocities) as
    /// its loss measures it; the estimated noise level where it is not stated. `None` for channels
    /// that are not fitted, and without [`super::Settings::likelihood`].
    pub noise: Vec<Option<f64>>,
    /// Factor on the variances for residuals that are correlated in time (1 for white ones).
    pub correlation_factor: f64,
    /// Dispersion of the residuals under the loss ρ: `½ Σρ'²/Σρ''` over the degrees of freedom. For
    /// squares it is their variance. A difference of objectives divided by it is χ² distributed (J.
    /// T. Kent, Biometrika 69, 1982).
    pub dispersion: f64,
    /// Held parameters.
    pub fixed: Vec<bool>,
    /// Bounds in force.
    pub lower: Vec<f64>,
    /// Upper bounds.
    pub upper: Vec<f64>,
    /// Size of the program: variables and constraints.
    pub size: (usize, usize),
    /// Number of windows and of samples in them.
    pub windows: (usize, usize),
    /// Relative force error ‖r‖/‖f_u‖ per joint and role, where the drive acts: RMS of the residual
    /// over RMS of the force of the drive. Filled by the equation error only.
    pub force_error: Vec<ForceError>,
    /// Remarks in words.
    pub notes: Vec<String>,
}

impl Identification {
    /// The best run.
    pub fn best(&self) -> &Run {
        &self.runs[self.best]
    }
}

/// A local optimum that one or more starts reached.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Optimum {
    /// The lowest objective of its runs.
    pub objective: f64,
    /// Positions of its runs among all runs, the lowest objective first.
    pub runs: Vec<usize>,
    /// Share of all starts.
    pub share: f64,
}

/// Residual force of one joint over the experiments of a role.
#[derive(Debug, Clone, PartialEq)]
pub struct ForceError {
    /// Name of the joint.
    pub joint: String,
    /// Role of the experiments.
    pub role: Role,
    /// RMS of the residual, N·m or N.
    pub rms: f64,
    /// The same over the RMS of the drive's force; `None` where the drive does not act.
    pub relative: Option<f64>,
}

/// Position of the best run: converged before not converged, then the lower objective.
pub(super) fn best_of(runs: &[Run]) -> usize {
    let key = |r: &Run| {
        (
            !r.status.converged(),
            if r.objective.is_nan() {
                f64::INFINITY
            } else {
                r.objective
            },
        )
    };
    (0..runs.len())
        .min_by(|&a, &b| {
            let (a, b) = (key(&runs[a]), key(&runs[b]));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        })
        .unwrap_or(0)
}
