//! One identification by the estimator that the settings name.

use pid_data::Dataset;
use pid_runtime::dynamics::Hessian;

use super::error::IdentError;
use super::outcome::{Callback, Identification};
use super::settings::{Method, Settings};
use super::{equation_error, full, shooting};

/// One identification with fixed noise levels.
pub(super) fn once(
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
