//! Arguments of `simtrue identify`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use pid_data::{Horizon, ParseHorizonError};
use pid_fit::transcribe::{Loss, Scheme};

use super::parse::{at_least_one, loss, positive};
use super::source::Source;

/// Arguments of `simtrue identify`.
#[derive(Debug, Clone, Args)]
pub(crate) struct IdentifyArgs {
    #[command(flatten)]
    pub(crate) source: Source,
    /// How the parameters are estimated.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) method: MethodArg,
    /// One-step scheme: explicit-euler, heun, rk4, dormand-prince, trapezoidal, implicit-midpoint,
    /// hermite-simpson, gauss-legendre-S or radau-S with S stages.
    #[arg(long, default_value = "implicit-midpoint", value_name = "SCHEME")]
    pub(crate) scheme: Scheme,
    /// Steps of the scheme per sampling interval.
    #[arg(long, default_value = "1", value_name = "N", value_parser = at_least_one)]
    pub(crate) substeps: usize,
    /// Nodes of each window in shooting: 1 is single shooting.
    #[arg(long, default_value = "1", value_name = "M", value_parser = at_least_one)]
    pub(crate) nodes: usize,
    /// Shooting does not start from the solution with a node at every sample.
    #[arg(long)]
    pub(crate) no_lift: bool,
    /// Shooting with controlled Dormand-Prince steps of this relative tolerance instead of the scheme.
    #[arg(long, value_name = "RTOL", value_parser = positive)]
    pub(crate) adaptive: Option<f64>,
    /// Second derivatives of the Lagrangian.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) hessian: HessianArg,
    /// Method of the solver.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) solver: SolverArg,
    /// How far a simulation runs before it is restarted: `record`, a time (`1s`), a number of
    /// samples, or `auto`, which chooses among half a second, one and two seconds by cross
    /// validation over the training records. Without it: the whole record, or `1s` where a record
    /// is longer than 10 s.
    #[arg(long, value_name = "HORIZON")]
    pub(crate) horizon: Option<HorizonArg>,
    /// Initial state of each window.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) initial: InitialArg,
    /// Weights of the channels in the objective.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) weights: WeightsArg,
    /// Fit by maximum likelihood: the noise of every channel is estimated, or stated by --assume or
    /// --nominal.
    #[arg(long)]
    pub(crate) likelihood: bool,
    /// File with noise and prior knowledge of parameters (docs/assumptions-format.md); implies
    /// --likelihood.
    #[arg(long, value_name = "FILE")]
    pub(crate) assume: Option<PathBuf>,
    /// Loss of deviations in units of their noise: square, huber=THRESHOLD, student-t=FREEDOM;
    /// implies --likelihood.
    #[arg(long, value_name = "LOSS", value_parser = loss)]
    pub(crate) loss: Option<Loss>,
    /// Parameter that is held at its start; may be repeated.
    #[arg(long, value_name = "NAME")]
    pub(crate) hold: Vec<String>,
    /// Relation between parameters and states, such as "mass_a + mass_b <= 12.5", "viscous_left ==
    /// viscous_right" or "v_elbow <= 4": LEFT <= RIGHT, >= or ==, with + - * /, sin, cos, tan, exp,
    /// ln, sqrt, abs. With a state, q_JOINT or v_JOINT, it holds at every sample, in shooting at
    /// every node. Names that are not words stand in quotes. May be repeated.
    #[arg(long, value_name = "RELATION")]
    pub(crate) constrain: Vec<String>,
    /// Standard deviations from the scatter of the windows' gradients (sandwich form): right for
    /// noise of any correlation within a window. Needs twice as many windows as free parameters.
    #[arg(long)]
    pub(crate) sandwich: bool,
    /// Interval of 95 % of a parameter by its profile likelihood; may be repeated.
    #[arg(long, value_name = "NAME")]
    pub(crate) profile: Vec<String>,
    /// Keep links all of whose ten inertial parameters the model has bodies of positive density,
    /// with a positive definite mass matrix in every pose. `after`: one more fit in log-Cholesky
    /// coordinates, which prints its cost and its benefit. `throughout`: one fit with a barrier,
    /// for arms with all parameters open and noisy records; parameters that the data do not
    /// determine stay near the start.
    #[arg(long, value_name = "WHEN", num_args = 0..=1, require_equals = true, default_missing_value = "after")]
    pub(crate) consistent: Option<ConsistentArg>,
    /// With a robot file: the parameters of a link need not be those of a body. By default such a
    /// robot is fitted as by `--consistent=throughout`, since records hardly ever determine all ten
    /// parameters of every link.
    #[arg(long, conflicts_with = "consistent")]
    pub(crate) free_parameters: bool,
    /// Look for the effect that the model lacks as well, with the nominal values and ranges of its
    /// declaration, as `simtrue diagnose --model` does; its report goes to the folder `diagnosis`
    /// in that of the results. Done without asking on the embedded data.
    #[arg(long)]
    pub(crate) diagnose: bool,
    /// Draws of the block bootstrap over windows: intervals of 95 % by as many further fits.
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub(crate) bootstrap: usize,
    /// Start the solver from the given parameters as they are, without fitting the residual first
    /// or lifting the start of shooting.
    #[arg(long)]
    pub(crate) no_prepare: bool,
    /// Cut-off of the zero-phase filter behind derived velocities and the equation error, Hz; found
    /// from the data if absent.
    #[arg(long, value_name = "HZ", value_parser = positive)]
    pub(crate) cutoff: Option<f64>,
    /// The equation error keeps every n-th sample.
    #[arg(long, value_name = "N", value_parser = at_least_one)]
    pub(crate) decimate: Option<usize>,
    /// Number of starts; the first is the given or nominal one, the others are drawn around it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) starts: Option<u32>,
    /// Where the other starts are drawn.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) sampling: SamplingArg,
    /// Seed of the drawn starts.
    #[arg(long, default_value_t = 0, value_name = "S")]
    pub(crate) seed: u64,
    /// Most iterations per start.
    #[arg(long, default_value_t = 500, value_name = "N")]
    pub(crate) max_iter: usize,
    /// Tolerance of the first-order conditions.
    #[arg(long, default_value_t = 1e-8, value_name = "TOL", value_parser = positive)]
    pub(crate) tol: f64,
    /// Parameters to start from: a fit.json, or a TOML file of lines `name = value`.
    #[arg(long, value_name = "FILE")]
    pub(crate) start: Option<PathBuf>,
    /// Print the text of fit.json in place of a summary.
    #[arg(long)]
    pub(crate) json: bool,
    /// Print the iterations.
    #[arg(long, short)]
    pub(crate) verbose: bool,
}

/// When links are kept bodies of positive density.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ConsistentArg {
    /// One more fit in log-Cholesky coordinates.
    After,
    /// At every iterate of one fit.
    Throughout,
}

/// How the parameters are estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum MethodArg {
    /// States and parameters together, the equations of motion as constraints.
    #[default]
    FullDiscretization,
    /// States at few nodes and parameters; the motion between the nodes is integrated.
    Shooting,
    /// Least squares on the equations of motion with states estimated from the data.
    EquationError,
}

/// Second derivatives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum HessianArg {
    /// Exact.
    #[default]
    Exact,
    /// Without the second derivatives of the equations of motion.
    GaussNewton,
    /// Damped BFGS from all steps so far.
    Bfgs,
    /// Damped BFGS from the last ten steps.
    LBfgs,
}

/// Methods of the solver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum SolverArg {
    /// Interior point with a filter line search.
    #[default]
    InteriorPoint,
    /// Sequential quadratic programming with a filter line search.
    Sqp,
}

/// Where starts are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum SamplingArg {
    /// Around the first start.
    #[default]
    Around,
    /// As a Latin hypercube in the bounds.
    LatinHypercube,
    /// A scrambled Sobol sequence in the bounds: pairs of parameters are filled evenly.
    Sobol,
}

/// Initial state of each window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum InitialArg {
    /// An unknown of the fit.
    #[default]
    Free,
    /// Held at the record.
    Measured,
}

/// Weights of the channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum WeightsArg {
    /// 1 for every measured channel, in mixed units.
    Unit,
    /// One over the variance of each channel.
    #[default]
    Spread,
    /// Positions only, each by one over its variance in its own record.
    Record,
    /// Positions only.
    Position,
}

/// A horizon, stated or to be chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum HorizonArg {
    /// By cross validation.
    Auto,
    /// As stated.
    Stated(Horizon),
}

impl std::str::FromStr for HorizonArg {
    type Err = ParseHorizonError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.trim() {
            "auto" => Ok(Self::Auto),
            other => other.parse().map(Self::Stated),
        }
    }
}
