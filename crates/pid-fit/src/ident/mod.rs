//! Identification: from a model and records to parameters with their uncertainty.
//!
//! Three estimators stand behind one call, [`identify`]:
//!
//! * **full discretization** ([`crate::transcribe::FullDiscretization`]): states and parameters
//!   together, the scheme's steps as constraints, over restart windows of the stated horizon
//!   (output error);
//! * **shooting** ([`crate::transcribe::Shooting`]): states at few nodes, the motion between them integrated;
//! * **equation error**: least squares on the residual with states estimated from the records (a
//!   horizon of one sample).
//!
//! Settings reproduce the paper's problem (K. Schäfer et al., Section V-A: explicit Euler, unit
//! weights, one window) exactly. The defaults serve measured records.

mod approach;
mod assemble;
pub mod assumptions;
pub mod bootstrap;
mod cross_validation;
mod equation_error;
mod error;
mod full;
mod likelihood;
mod motions;
mod profile;
mod settings;
mod shooting;
mod spread;
pub mod starts;
mod trajectory;
mod uncertainty;

pub use cross_validation::{CandidateScore, CrossValidationError, cross_validate};
pub use error::IdentError;
pub use likelihood::Likelihood;
pub use profile::{Profile, Profiler};
pub use settings::{InitialState, Method, Prepare, Settings, Weighting};
pub use starts::{Optimum, Sampling};
pub use uncertainty::{Covariance, OpenDirection};

use pid_data::{Dataset, Role};
use pid_nlp::PointCheck;
use pid_nlp::solver::{Iteration, Status};
use pid_runtime::dynamics::Hessian;
use std::ops::ControlFlow;

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
    /// Whether deviations and covariance are of the sandwich form ([`Settings::sandwich`]).
    pub sandwich: bool,
    /// Standard deviation of each channel's residuals (positions of all joints, then velocities) as
    /// its loss measures it; the estimated noise level where it is not stated. `None` for channels
    /// that are not fitted, and without [`Settings::likelihood`].
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

/// Identifies a model on the training experiments of a data set.
///
/// `start`: parameters in the model's order, within their bounds; nominal values if `None`.
///
/// # Errors
/// [`IdentError`]: data that do not fit the model, no training experiment, a start outside its
/// bounds, a mass matrix that is singular at the start. A solver that stops early is not an error;
/// see [`Run::status`].
pub fn identify(
    model: &dyn Hessian,
    dataset: &Dataset,
    settings: &Settings,
    start: Option<&[f64]>,
    callback: &mut Callback<'_>,
) -> Result<Identification, IdentError> {
    dataset.check_model(model)?;
    if dataset.with_role(Role::Train).next().is_none() {
        return Err(IdentError::NoTraining {
            dataset: dataset.name.clone(),
        });
    }
    let infos = model.params();
    let nominal: Vec<f64> = infos.iter().map(|i| i.nominal).collect();
    let start = start.unwrap_or(&nominal);
    if start.len() != infos.len() {
        return Err(IdentError::StartLength {
            expected: infos.len(),
            found: start.len(),
        });
    }
    for (info, &value) in infos.iter().zip(start) {
        if !(info.lower..=info.upper).contains(&value) {
            return Err(IdentError::StartOutsideBounds {
                parameter: info.name.to_string(),
                value,
                lower: info.lower,
                upper: info.upper,
                unit: info.unit.to_string(),
            });
        }
    }
    if settings.method == Method::EquationError && model.dims().nu != dataset.nq() {
        return Err(IdentError::Controller {
            model: model.name().to_owned(),
        });
    }
    if let (Method::EquationError, Some(first)) = (settings.method, settings.constraints.first()) {
        return Err(IdentError::ConstrainedEquationError {
            name: first.name.clone(),
        });
    }
    for &j in &settings.hold {
        if j >= infos.len() {
            return Err(IdentError::NoParameter {
                position: j,
                parameters: infos.len(),
            });
        }
    }
    match &settings.likelihood {
        Some(likelihood) if settings.method != Method::EquationError => {
            likelihood::identify(model, dataset, settings, likelihood, start, callback)
        }
        _ => once(model, dataset, settings, start, callback),
    }
}

/// One identification with fixed noise levels.
fn once(
    model: &dyn Hessian,
    dataset: &Dataset,
    settings: &Settings,
    start: &[f64],
    callback: &mut Callback<'_>,
) -> Result<Identification, IdentError> {
    match settings.method {
        Method::FullDiscretization => full::identify(model, dataset, settings, start, callback),
        Method::Shooting => shooting::identify(model, dataset, settings, start, callback),
        Method::EquationError => {
            equation_error::identify(model, dataset, settings, start, callback)
        }
    }
}

/// Bounds of a model's parameters; held ones (marked `fixed`, or in `hold`) have their start as both bounds.
fn bounds(model: &dyn Hessian, start: &[f64], hold: &[usize]) -> (Vec<f64>, Vec<f64>, Vec<bool>) {
    let infos = model.params();
    let fixed = |k: usize| infos[k].fixed || hold.contains(&k);
    let held = |k: usize, bound: f64| if fixed(k) { start[k] } else { bound };
    let lower = infos
        .iter()
        .enumerate()
        .map(|(k, i)| held(k, i.lower))
        .collect();
    let upper = infos
        .iter()
        .enumerate()
        .map(|(k, i)| held(k, i.upper))
        .collect();
    (lower, upper, (0..infos.len()).map(fixed).collect())
}

/// Typical size of each parameter: the nominal value, a sixth of the range around zero, 1 without either.
fn scales(model: &dyn Hessian) -> Vec<f64> {
    model
        .params()
        .iter()
        .map(|i| {
            let width = i.upper - i.lower;
            if i.nominal != 0.0 && !(i.lower < 0.0 && i.nominal.abs() < 0.01 * width) {
                i.nominal.abs()
            } else if width.is_finite() && width > 0.0 {
                width / 6.0
            } else {
                1.0
            }
        })
        .collect()
}

/// Position of the best run: converged before not converged, then the lower objective.
fn best_of(runs: &[Run]) -> usize {
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
