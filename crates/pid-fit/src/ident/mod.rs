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
mod estimate;
mod full;
mod likelihood;
mod motions;
mod noise;
mod outcome;
mod parameters;
mod profile;
mod samples;
mod settings;
mod shooting;
mod spread;
pub mod starts;
mod trajectory;
mod uncertainty;

pub use cross_validation::{CandidateScore, CrossValidationError, cross_validate};
pub use error::IdentError;
pub use outcome::{Callback, ForceError, Identification, Optimum, Progress, Run};
pub use profile::{Profile, Profiler};
pub use settings::{InitialState, Likelihood, Method, Prepare, Settings, Weighting};
pub use starts::Sampling;
pub use uncertainty::{Covariance, OpenDirection};

use pid_data::{Dataset, Role};
use pid_runtime::dynamics::Hessian;

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
        _ => estimate::once(model, dataset, settings, start, callback),
    }
}
