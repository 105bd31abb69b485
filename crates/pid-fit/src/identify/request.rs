//! What an identification can be asked for, what it tells, and what is known at its end.

use std::ops::ControlFlow;

use pid_data::Horizon;

use crate::ident::bootstrap::{Bootstrap, BootstrapError};
use crate::ident::{
    CandidateScore, CrossValidationError, IdentError, Identification, Profile, Progress, Settings,
};

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

/// How a horizon was chosen.
#[derive(Debug, Clone, PartialEq)]
pub struct HorizonChoice {
    /// The one with the lowest error on left-out training records.
    pub horizon: Horizon,
    /// Horizon of the free runs that judged all.
    pub judged: Horizon,
    /// The horizons with their errors.
    pub scores: Vec<(Horizon, CandidateScore)>,
}

/// What positive densities cost and bring: figures with them, and without.
#[derive(Debug, Clone, PartialEq)]
pub struct Consistency {
    /// Names of the links.
    pub links: Vec<String>,
    /// Objectives.
    pub objective: (f64, f64),
    /// Shares of the random poses in which the mass matrix is indefinite.
    pub indefinite: (f64, f64),
    /// Number of these poses.
    pub poses: usize,
    /// Priors of these links' parameters, which have no form in coordinates and were left out.
    pub lost_priors: usize,
}
