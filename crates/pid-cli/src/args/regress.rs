//! Arguments of `simtrue regress`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use pid_fit::regress::unknowns::Payload;
use pid_fit::transcribe::Loss;

use super::parse::{at_least_one, loss, not_negative, positive};
use super::source::Source;

/// Arguments of `simtrue regress`.
#[derive(Debug, Clone, Args)]
pub(crate) struct RegressArgs {
    #[command(flatten)]
    pub(crate) source: Source,
    /// Parameter that is held at its start; may be repeated.
    #[arg(long, value_name = "NAME")]
    pub(crate) hold: Vec<String>,
    /// Cut-off of the zero-phase filter, Hz; found from the noise of the data if absent, chosen by
    /// left-out training records with `auto`.
    #[arg(long, value_name = "HZ")]
    pub(crate) cutoff: Option<CutoffArg>,
    /// Keep every n-th sample; four per period of the cut-off if absent.
    #[arg(long, value_name = "N", value_parser = at_least_one)]
    pub(crate) decimate: Option<usize>,
    /// A joint rests if it is slower than so many transition velocities (0.02 rad/s, 1 mm/s): its
    /// rows are left out of the fit, not of the judgement. 0 keeps all. Default 2, or 0 with
    /// `--with presliding`, which explains joints at rest.
    #[arg(long, value_name = "X", value_parser = not_negative)]
    pub(crate) rest: Option<f64>,
    /// Training records to fit on, separated by commas; all of them if absent. Those left out are
    /// neither fitted nor judged.
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    pub(crate) train: Vec<String>,
    /// Estimator. Instrumental variables simulate the closed loop of --controller without noise (IDIM-IV).
    #[arg(long, value_enum, default_value_t)]
    pub(crate) method: RegressMethodArg,
    /// A body fixed to a link in some records, LINK=RECORDS (`wrist_3=*_load`): its ten parameters
    /// are estimated with those of the robot in one fit over records with and without it.
    #[arg(long, value_name = "LINK=RECORDS")]
    pub(crate) payload: Option<Payload>,
    /// Standard deviations of the input gains as shares of them (0.1: known to 10 %), one per
    /// joint, separated by commas. No record shows an error that all records share, so it enters
    /// the deviations of the values.
    #[arg(long, value_name = "S1,S2,…", value_delimiter = ',', value_parser = not_negative)]
    pub(crate) gain_deviation: Vec<f64>,
    /// Parameters whose residuals are printed beside those of the fit, through the same filters: a
    /// fit.json, or a TOML file of lines `name = value`; may be repeated.
    #[arg(long, value_name = "FILE")]
    pub(crate) judge: Vec<PathBuf>,
    /// Weights of the joints: each by its own residual variance, or all alike.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) weights: JointWeightsArg,
    /// Priors, held values and loss (docs/assumptions-format.md); stated noise of channels is not used.
    #[arg(long, value_name = "FILE")]
    pub(crate) assume: Option<PathBuf>,
    /// Loss of residuals in units of their own deviation: square, huber=THRESHOLD,
    /// student-t=FREEDOM.
    #[arg(long, value_name = "LOSS", value_parser = loss)]
    pub(crate) loss: Option<Loss>,
    /// Hold shape parameters of force terms (Stribeck velocities) instead of seeking them.
    #[arg(long)]
    pub(crate) hold_shapes: bool,
    /// Leave out the physically consistent values.
    #[arg(long)]
    pub(crate) no_consistent: bool,
    /// Random poses in which the mass matrix is checked.
    #[arg(long, default_value_t = 10_000, value_name = "N", value_parser = at_least_one)]
    pub(crate) poses: usize,
    /// Draws of the block bootstrap; none if 0.
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub(crate) bootstrap: usize,
    /// Seed of poses and bootstrap.
    #[arg(long, default_value_t = 0, value_name = "S")]
    pub(crate) seed: u64,
    /// Parameters to start from: a fit.json, or a TOML file of lines `name = value`.
    #[arg(long, value_name = "FILE")]
    pub(crate) start: Option<PathBuf>,
}

/// Weights of the joints in `simtrue regress`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum JointWeightsArg {
    /// One over the residual variance of each.
    #[default]
    Variance,
    /// All alike: the residual of all joints together is the least.
    Common,
}

/// Estimators of `simtrue regress`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum RegressMethodArg {
    /// Weighted least squares (IDIM-LS).
    #[default]
    LeastSquares,
    /// Instrumental variables (IDIM-IV).
    #[value(alias = "iv")]
    InstrumentalVariables,
}

/// A cut-off, stated or to be chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum CutoffArg {
    /// By left-out training records.
    Auto,
    /// As stated, Hz.
    Stated(f64),
}

impl std::str::FromStr for CutoffArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "auto" => Ok(Self::Auto),
            number => positive(number)
                .map(Self::Stated)
                .map_err(|e| format!("{e}, or `auto`")),
        }
    }
}
