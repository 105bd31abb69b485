//! Identification from one request: the horizon, the fit, values of positive density, intervals.
//!
//! [`identify`] does in turn what a [`Request`] asks for. [`crate::ident::identify`] is the fit
//! alone.

mod consistent;
mod horizon;

use std::ops::ControlFlow;
use std::time::Instant;

use pid_data::Dataset;
use pid_runtime::dynamics::Hessian;

use crate::ident::bootstrap::{Bootstrap, BootstrapError, bootstrap};
use crate::ident::{
    self, CrossValidationError, IdentError, Identification, Method, Profile, Profiler, Progress,
    Settings,
};
pub use consistent::Consistency;
pub use horizon::{HorizonChoice, by_rule};

/// What an identification consists of.
#[derive(Debug, Clone, Default)]
pub struct Request {
    /// The fit.
    pub settings: Settings,
    /// Parameters to start from, in the model's order and units; nominal ones if absent.
    pub start: Option<Vec<f64>>,
    /// Whether the horizon is chosen by cross validation over the training records, in place of
    /// that of the settings. The equation error has none.
    pub choose_horizon: bool,
    /// Whether one more fit follows in log-Cholesky coordinates, which keeps links whose ten
    /// inertial parameters the model has bodies of positive density.
    pub consistent_after: bool,
    /// Draws of the block bootstrap; 0: none.
    pub draws: usize,
    /// Positions of the parameters that get an interval by their profile likelihood.
    pub profiled: Vec<usize>,
}

/// What is known at the end.
#[derive(Debug, Clone)]
pub struct Identified {
    /// The fit.
    pub identification: Identification,
    /// The settings as they were used.
    pub settings: Settings,
    /// How the horizon was chosen, if it was.
    pub horizon: Option<HorizonChoice>,
    /// What positive densities cost, if the links were fitted once more.
    pub consistency: Option<Consistency>,
    /// The draws of the bootstrap.
    pub bootstrap: Option<Bootstrap>,
    /// Intervals by profile likelihood, with the position of their parameter.
    pub profiles: Vec<(usize, Profile)>,
    /// Time, s.
    pub seconds: f64,
}

/// News of a running identification.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub enum News<'a> {
    /// An iteration while the horizon is chosen.
    Horizon(&'a Progress<'a>),
    /// An iteration of the fit.
    Fit(&'a Progress<'a>),
    /// An iteration of the fit with positive densities.
    Consistent(&'a Progress<'a>),
    /// The bootstrap goes on.
    Bootstrap,
    /// The profile of a parameter goes on; `None`: what all profiles need.
    Profile(Option<usize>),
}

/// Receives [`News`], from several threads; `Break` ends the identification and keeps the results
/// so far.
pub type Tell<'a> = dyn Fn(&News<'_>) -> ControlFlow<()> + Sync + 'a;

/// Why an identification cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IdentifyError {
    /// Fit or profile.
    #[error(transparent)]
    Fit(#[from] IdentError),
    /// Choice of the horizon.
    #[error(transparent)]
    Horizon(#[from] CrossValidationError),
    /// Draws.
    #[error(transparent)]
    Bootstrap(#[from] BootstrapError),
    /// No link has all its inertial parameters.
    #[error(
        "--consistent: the model has no link whose ten inertial parameters are all free\n  help: declare links with `inertial: free`, or hold none of their parameters"
    )]
    NoLinks,
    /// Intervals of parameters that the last fit does not have.
    #[error(
        "--consistent fits once more in other coordinates, which have neither profiles nor a bootstrap\n  help: keep links consistent in every fit by --consistent=throughout"
    )]
    IntervalsAfter,
    /// Constraints on parameters that the last fit does not have.
    #[error(
        "--constrain speaks of the model's parameters, --consistent=after fits others\n  help: --consistent=throughout fits the model's own"
    )]
    ConstraintsAfter,
}

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
