//! Identification from one request: the horizon, the fit, values of positive density, intervals.
//!
//! [`identify`] does in turn what a [`Request`] asks for. [`crate::ident::identify`] is the fit
//! alone.

mod consistent;
mod horizon;
mod request;

use std::time::Instant;

use pid_data::Dataset;
use pid_runtime::dynamics::Hessian;

use crate::ident::bootstrap::bootstrap;
use crate::ident::{
    self, IdentError, Identification, Method, Profile, Profiler, Progress, Settings,
};
pub use horizon::by_rule;
pub use request::{Consistency, HorizonChoice, Identified, IdentifyError, News, Request, Tell};

/// Identifies a model on the training records of a data set.
///
/// # Errors
/// [`IdentifyError`]: data that do not fit the model, no training record, a request whose parts
/// exclude each other.
pub fn identify(
    model: &dyn Hessian,
    dataset: &Dataset,
    request: &Request,
    tell: &Tell<'_>,
) -> Result<Identified, IdentifyError> {
    if request.consistent_after && (request.draws > 0 || !request.profiled.is_empty()) {
        return Err(IdentifyError::IntervalsAfter);
    }
    if request.consistent_after && !request.settings.constraints.is_empty() {
        return Err(IdentifyError::ConstraintsAfter);
    }
    let started = Instant::now();
    let mut settings = request.settings.clone();
    let start = request.start.as_deref();
    let mut horizon = None;
    if request.choose_horizon && settings.method != Method::EquationError {
        let found = horizon::chosen(model, dataset, &settings, start, tell)?;
        settings.horizon = found.horizon;
        horizon = Some(found);
    }
    let mut identification = ident::identify(model, dataset, &settings, start, &mut |i| {
        tell(&News::Fit(i))
    })?;
    let mut consistency = None;
    if request.consistent_after {
        let (found, cost) = consistent::refit(model, dataset, &settings, &identification, tell)?;
        (identification, consistency) = (found, Some(cost));
    }
    let mut drawn = None;
    if request.draws > 0 {
        // Told before the first draw ends.
        let _ = tell(&News::Bootstrap);
        drawn = Some(bootstrap(
            model,
            dataset,
            &settings,
            &identification,
            (request.draws, settings.seed),
            &|| tell(&News::Bootstrap),
        )?);
    }
    let profiles = profiles(model, dataset, &settings, &identification, (request, tell))?;
    Ok(Identified {
        identification,
        settings,
        horizon,
        consistency,
        bootstrap: drawn,
        profiles,
        seconds: started.elapsed().as_secs_f64(),
    })
}

/// Intervals of the parameters that are asked for.
fn profiles(
    model: &dyn Hessian,
    dataset: &Dataset,
    settings: &Settings,
    found: &Identification,
    (request, tell): (&Request, &Tell<'_>),
) -> Result<Vec<(usize, Profile)>, IdentError> {
    if request.profiled.is_empty() {
        return Ok(Vec::new());
    }
    let mut all = |_: &Progress<'_>| tell(&News::Profile(None));
    let profiler = Profiler::new(model, dataset, settings, found, &mut all)?;
    let each = request.profiled.iter().map(|&j| {
        let mut own = |_: &Progress<'_>| tell(&News::Profile(Some(j)));
        Ok((j, profiler.interval(j, &mut own)?))
    });
    each.collect()
}
