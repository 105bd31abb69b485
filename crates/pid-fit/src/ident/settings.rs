//! Settings of an identification.

use super::starts::Sampling;
use crate::transcribe::{Adaptive, Constraint, Curvature, Loss, Prior, Scheme};
use pid_data::Horizon;
use pid_nlp::solver;
use serde::{Deserialize, Serialize};

/// The estimator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Method {
    /// States and parameters together, the scheme's steps as constraints.
    FullDiscretization,
    /// States at few nodes and parameters; the motion between the nodes is integrated.
    Shooting,
    /// Least squares on the residual with states estimated from the records.
    EquationError,
}

/// Initial state of each window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum InitialState {
    /// An unknown of the fit.
    Free,
    /// Held at what the record says: the measured positions, the velocities of
    /// [`pid_data::signal::state_from_data`].
    Measured,
}

/// Weights of the channels in the objective `J = 1/N Σ w_c (x_c − x_c^d)²`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Weighting {
    /// 1 for every measured channel: the paper's objective, in mixed units.
    Unit,
    /// One over the variance of the channel over all training windows: every channel counts by the
    /// share of its own motion.
    Spread,
    /// Positions only, each by one over its variance in its own record: records of small motion
    /// count as much as those of large motion.
    Record,
    /// 1 for positions, 0 for velocities.
    Position,
}

/// Steps before the iterations with the exact Hessian.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Prepare {
    /// None: the start is used as it is, states at the data.
    Nothing,
    /// Gauss-Newton iterations until the constraints nearly hold, from parameters that are trusted.
    /// Single shooting has no constraints and skips them.
    Motion,
    /// The parameters are first fitted with the states held at the data, which forgets a bad start.
    /// [`Prepare::Motion`] follows.
    #[default]
    Everything,
}

/// Assumptions about noise and parameters.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Likelihood {
    /// Standard deviation of the noise of each channel, positions of all joints, then velocities;
    /// `None` where it is estimated, infinite for values that start a state and are no readings. If
    /// empty, all are estimated.
    pub noise: Vec<Option<f64>>,
    /// Loss of deviations.
    pub loss: Loss,
    /// Prior knowledge of parameters.
    pub priors: Vec<Prior>,
}

/// Settings of an identification.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The estimator.
    pub method: Method,
    /// One-step scheme of the full discretization.
    pub scheme: Scheme,
    /// Steps of the scheme per sampling interval, at least 1.
    pub substeps: usize,
    /// Nodes of each window in shooting: 1 is single shooting; more than samples means one per sample.
    pub nodes: usize,
    /// Whether shooting starts from the solution of the same problem with a node at every sample
    /// (equal steps only), where bad starts matter little. `None`: yes if `prepare` is
    /// [`Prepare::Everything`].
    pub lift: Option<bool>,
    /// Shooting with controlled Dormand-Prince steps; `None` for equal steps of `scheme`.
    pub adaptive: Option<Adaptive>,
    /// Second derivatives for the solver.
    pub curvature: Curvature,
    /// Damped BFGS from this many last steps in place of `curvature`. 6 to 20 is usual for limited
    /// memory; the number of iterations makes it the full BFGS matrix.
    pub quasi_newton: Option<usize>,
    /// The solver's method.
    pub algorithm: solver::Algorithm,
    /// Length of the restart windows.
    pub horizon: Horizon,
    /// Initial states of the windows.
    pub initial_state: InitialState,
    /// Weights of the channels.
    pub weighting: Weighting,
    /// Noise levels, losses and priors; takes the place of `weighting`. The equation error, which
    /// has no measured channels, does not read it.
    pub likelihood: Option<Likelihood>,
    /// Positions of parameters that are held at their start beside those marked `fixed`.
    pub hold: Vec<usize>,
    /// Constraints on parameters and on states, beside the parameters' bounds. Nodes are the ends
    /// of all steps in full discretization (every sample with one step per interval) and the nodes
    /// of shooting, counted over all windows. Shooting does not look at the motion between its
    /// nodes. Not for the equation error.
    pub constraints: Vec<Constraint>,
    /// Whether links all of whose ten inertial parameters the model has stay bodies of positive
    /// density during the fit ([`crate::transcribe::Body`]). Every iterate then has a positive
    /// definite mass matrix, parameters that the data do not determine stay near the start, states
    /// start from the filtered record, and the preparing fit holds parameters that multiply inputs.
    /// Full discretization and shooting.
    pub consistent: bool,
    /// Whether the covariance is of the sandwich form, from the scatter of the windows' gradients.
    /// It needs twice as many windows as free parameters; with fewer, the covariance of the Hessian
    /// is used.
    pub sandwich: bool,
    /// Number of starts; the first is the given one.
    pub starts: usize,
    /// Where further starts are drawn.
    pub sampling: Sampling,
    /// Seed of the drawn starts.
    pub seed: u64,
    /// Steps before the exact Hessian.
    pub prepare: Prepare,
    /// Cut-off of the zero-phase filter behind derived velocities and the equation error, Hz;
    /// `None` for the data's own.
    pub cutoff: Option<f64>,
    /// The equation error keeps every n-th sample; `None` for four samples per period of the cut-off.
    pub decimate: Option<usize>,
    /// The solver.
    pub solver: solver::Settings,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            method: Method::FullDiscretization,
            scheme: Scheme::ImplicitMidpoint,
            substeps: 1,
            nodes: 1,
            lift: None,
            adaptive: None,
            curvature: Curvature::Exact,
            quasi_newton: None,
            algorithm: solver::Algorithm::InteriorPoint,
            horizon: Horizon::Record,
            initial_state: InitialState::Free,
            weighting: Weighting::Spread,
            likelihood: None,
            hold: Vec::new(),
            constraints: Vec::new(),
            consistent: false,
            sandwich: false,
            starts: 1,
            sampling: Sampling::Around,
            seed: 0,
            prepare: Prepare::Everything,
            cutoff: None,
            decimate: None,
            solver: solver::Settings {
                mu_start: 1e-2,
                // The rows are changes of state already, so they are not scaled. On the two-link
                // study watchdog and soft restoration led one start to a worse optimum.
                scale_constraints: false,
                watchdog: 0,
                soft_restoration: 0,
                ..solver::Settings::default()
            },
        }
    }
}
