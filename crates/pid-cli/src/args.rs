//! Arguments of the command line.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use pid_data::{Horizon, ParseHorizonError};
use pid_fit::regress::unknowns::Payload;
use pid_fit::transcribe::{Loss, Scheme};

use crate::with::With;

/// Identify the parameters of a robot from its records, and show where model and robot differ.
///
/// Without arguments, the two-link robot is identified from embedded records of a robot that has
/// one effect more than its model, and the report is written to `simtrue-report`.
#[derive(Debug, Parser)]
#[command(name = "simtrue", version, args_conflicts_with_subcommands = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Option<Command>,
    #[command(flatten)]
    pub(crate) identify: IdentifyArgs,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Identify a model on a data folder and write fit.json and report.html.
    Identify(IdentifyArgs),
    /// Compare a model that has given parameters with a data folder; nothing is identified.
    Simulate(SimulateArgs),
    /// Regress the equations of motion on records filtered without phase shift: base parameters
    /// with deviations, friction laws beyond the model, checks on test records, physically
    /// consistent values.
    Regress(RegressArgs),
    /// Name the physical effect that the model in a data folder lacks, its joint, and how far it
    /// shrinks the gap.
    Diagnose(crate::diagnose::DiagnoseArgs),
    /// List the models.
    Models,
    /// Make the embedded demonstration data anew.
    DemoData(DemoArgs),
    /// Show what `robot!` makes of the declarations in a Rust source file.
    Dump(DumpArgs),
    /// Find the motion from which a record tells most: optimal excitation within limits.
    Excite(crate::excite::ExciteArgs),
    /// A study of the project, which is run from the source tree.
    #[command(hide = true, alias = "coverage", alias = "paper")]
    Study(StudyArgs),
}

/// Arguments of a study; they are not read here.
#[derive(Debug, Clone, Args)]
pub(crate) struct StudyArgs {
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    words: Vec<String>,
}

/// Arguments of `simtrue dump`.
#[derive(Debug, Clone, Args)]
pub(crate) struct DumpArgs {
    /// Rust source file with `robot! { … }`.
    pub(crate) file: PathBuf,
    /// Show this robot only.
    #[arg(long, value_name = "NAME")]
    pub(crate) robot: Option<String>,
    #[command(flatten)]
    pub(crate) parts: DumpParts,
}

/// Parts to show; without any: equations as text, and counts.
#[derive(Debug, Clone, Args)]
pub(crate) struct DumpParts {
    /// Generated code, formatted.
    #[arg(long)]
    pub(crate) code: bool,
    /// Equations of motion as text.
    #[arg(long)]
    pub(crate) text: bool,
    /// Equations of motion as LaTeX (amsmath).
    #[arg(long)]
    pub(crate) latex: bool,
    /// Operations of every function.
    #[arg(long)]
    pub(crate) counts: bool,
}

/// Model, data and place of the results.
#[derive(Debug, Clone, Args)]
pub(crate) struct Source {
    /// Model, as `simtrue models` lists them; left out with --urdf.
    pub(crate) model: Option<String>,
    /// Folder with dataset.toml and CSV files (docs/data-format.md).
    pub(crate) folder: Option<PathBuf>,
    /// Robot from a URDF instead of a model: joints and links of the file, input torque or force at
    /// each joint. Identified values are written back to identified.urdf.
    #[arg(long, value_name = "FILE")]
    pub(crate) urdf: Option<PathBuf>,
    /// Robot from a nominal description (docs/nominal-format.md) instead of a model; in
    /// identifications its tolerances are bounds and priors, its stated noise that of the channels.
    #[arg(long, value_name = "FILE", conflicts_with = "urdf")]
    pub(crate) nominal: Option<PathBuf>,
    /// With --urdf: masses and inertias are identified, or held as written.
    #[arg(long, value_enum, default_value_t, requires = "urdf")]
    pub(crate) inertias: InertiasArg,
    /// With --urdf: a rotor inertia per joint is identified.
    #[arg(long, requires = "urdf")]
    pub(crate) armature: bool,
    /// Effect of the library (as `simtrue diagnose` names them) that the model lacks, at every
    /// joint (`stribeck`) or one joint (`stribeck:elbow`); may be repeated. Regressions take its
    /// linear form. Or a force law that is linear in a coefficient, at a joint or a motor of two
    /// joints (`viscous:j5+j6`). Laws: armature, offset, viscous, coulomb, asymmetric (viscous
    /// friction that differs between the directions), stribeck, saturating, load (friction with the
    /// drive's torque), quadratic, presliding (friction that builds up over a displacement;
    /// regressions only).
    #[arg(long = "with", value_name = "TERM", conflicts_with_all = ["urdf", "nominal"])]
    pub(crate) terms: Vec<With>,
    /// Factors from the input columns to the torque or force at the joints (N·m/A for currents),
    /// one per joint, separated by commas; the columns then count as torques or forces.
    #[arg(long, value_name = "K1,K2,…", value_delimiter = ',', value_parser = finite)]
    pub(crate) input_gain: Vec<f64>,
    /// Kind of the input columns, whatever the data set says: readings at the sample times
    /// (linear), or commands held from one sample to the next (zero-order).
    #[arg(long, value_enum, value_name = "HOLD")]
    pub(crate) input_hold: Option<HoldArg>,
    /// The measured torques of the records (columns tau1 …) are the inputs instead of the commands.
    #[arg(long, conflicts_with_all = ["input_gain", "controller"])]
    pub(crate) measured_torque: bool,
    /// Controllers of the records (docs/controller-format.md): the commanded positions are the
    /// input, and the loop is part of the model.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["urdf", "nominal"])]
    pub(crate) controller: Option<PathBuf>,
    /// Parameter of which every training record has its own value, such as an offset that is set
    /// anew; may be repeated. Test records take the mean. In regressions `*` stands for any
    /// characters.
    #[arg(long, value_name = "NAME", conflicts_with_all = ["urdf", "nominal"])]
    pub(crate) private: Vec<String>,
    /// Joint whose recorded velocity lags behind (`all` for every joint), by a time constant that
    /// is estimated; may be repeated.
    #[arg(long, value_name = "JOINT", conflicts_with_all = ["urdf", "nominal"])]
    pub(crate) velocity_lag: Vec<String>,
    /// Further folder with records of the same robot; may be repeated.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) also: Vec<PathBuf>,
    /// Folder for the results; made if needed.
    #[arg(long, short, value_name = "FOLDER", default_value = "simtrue-report")]
    pub(crate) out: PathBuf,
}

impl Source {
    /// Whether no model and no data are named: the embedded ones are used.
    pub(crate) fn embedded(&self) -> bool {
        self.model.is_none()
            && self.folder.is_none()
            && self.urdf.is_none()
            && self.nominal.is_none()
    }
}

/// Kinds of input columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum HoldArg {
    /// Commands.
    ZeroOrder,
    /// Readings.
    Linear,
}

/// Masses and inertias of a URDF.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum InertiasArg {
    /// Ten standard parameters per moving body, from the values of the file.
    #[default]
    Free,
    /// The numbers of the file.
    Fixed,
}

/// When links are kept bodies of positive density.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ConsistentArg {
    /// One more fit in log-Cholesky coordinates.
    After,
    /// At every iterate of one fit.
    Throughout,
}

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
    #[arg(long, value_name = "LOSS", value_parser = crate::assume::loss)]
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
    /// Print the iterations.
    #[arg(long, short)]
    pub(crate) verbose: bool,
}

/// Arguments of `simtrue simulate`.
#[derive(Debug, Clone, Args)]
pub(crate) struct SimulateArgs {
    #[command(flatten)]
    pub(crate) source: Source,
    /// Parameters: a fit.json, or a TOML file of lines `name = value`; nominal ones if absent.
    #[arg(long, value_name = "FILE")]
    pub(crate) parameters: Option<PathBuf>,
}

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
    #[arg(long, value_name = "LOSS", value_parser = crate::assume::loss)]
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

/// Arguments of `simtrue demo-data`.
#[derive(Debug, Clone, Args)]
pub(crate) struct DemoArgs {
    /// Folder for the data; made if needed.
    #[arg(long, short, value_name = "FOLDER")]
    pub(crate) out: PathBuf,
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

fn at_least_one(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(n) if n > 0 => Ok(n),
        _ => Err(format!("`{text}` is not a whole number above zero")),
    }
}

pub(crate) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && x > 0.0 => Ok(x),
        _ => Err(format!("`{text}` is not a number above zero, such as 1e-8")),
    }
}

fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && x >= 0.0 => Ok(x),
        _ => Err(format!("`{text}` is not a number of at least zero")),
    }
}

fn finite(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(x) if x.is_finite() && x != 0.0 => Ok(x),
        _ => Err(format!("`{text}` is not a number other than zero")),
    }
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

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_definition_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn no_arguments_mean_identification_of_the_embedded_data() {
        let cli = Cli::try_parse_from(["simtrue"]).unwrap();
        assert!(cli.command.is_none());
        assert!(cli.identify.source.model.is_none() && cli.identify.source.folder.is_none());
        assert_eq!(cli.identify.horizon, None);
    }

    #[test]
    fn options_are_read_and_refused() {
        let read = |a: &str| Cli::try_parse_from(a.split(' '));
        let cli = read("simtrue identify emps data --method equation-error --scheme euler --hessian gauss-newton --horizon 1s --starts 20 --tol 1e-6").unwrap();
        let Some(Command::Identify(a)) = cli.command else {
            panic!("{cli:?}")
        };
        assert_eq!(
            (a.method, a.scheme),
            (MethodArg::EquationError, Scheme::ExplicitEuler)
        );
        assert_eq!(
            (a.hessian, a.horizon),
            (
                HessianArg::GaussNewton,
                Some(HorizonArg::Stated(Horizon::Seconds(1.0)))
            )
        );
        assert_eq!((a.starts, a.tol), (Some(20), 1e-6));
        for bad in [
            "identify emps d --armature",
            "identify emps d --inertias fixed",
            "identify emps d --horizon soon",
            "--starts 0",
            "--tol -1",
            "identify emps d --scheme rk5",
            "identify emps d --substeps 0",
        ] {
            assert!(read(&format!("simtrue {bad}")).is_err(), "{bad}");
        }
    }
}
