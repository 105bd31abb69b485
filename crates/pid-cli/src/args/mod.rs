//! Arguments of the command line.

pub(crate) mod diagnose;
pub(crate) mod excite;
pub(crate) mod export;
pub(crate) mod fleet;
pub(crate) mod identify;
pub(crate) mod new;
pub(crate) mod open;
pub(crate) mod parse;
pub(crate) mod regress;
pub(crate) mod robot;
pub(crate) mod source;
#[cfg(test)]
mod tests;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

use diagnose::DiagnoseArgs;
use excite::ExciteArgs;
use export::ExportArgs;
use fleet::FleetArgs;
use identify::IdentifyArgs;
use new::NewArgs;
use open::{CheckArgs, ConvertArgs};
use regress::RegressArgs;
use source::Source;

/// What the codes say at the end of a command.
const EXIT_CODES: &str = "Exit codes:
  0    done; with `diagnose --exit-code`: nothing is missing
  1    an error in the input; `check`: the records contradict the robot
  2    a mistake in the arguments
  3    `identify`: finished, but the result must not be used; `fleet collect`: logs are missing
  10   `diagnose --exit-code`: one cause or several are named; `fleet collect --exit-code`: a unit stands out
  11   `diagnose --exit-code`: a part of the gap has no name
  12   `diagnose --exit-code`: something is missing that has no name
  130  interrupted; what was reached is written";

/// Identify the parameters of a robot from its records, and show where model and robot differ.
///
/// Without arguments, the two-link robot is identified from embedded records of a robot that has
/// one effect more than its model, and the report is written to `simtrue-report`.
#[derive(Debug, Parser)]
#[command(
    name = "simtrue",
    version,
    args_conflicts_with_subcommands = true,
    after_help = EXIT_CODES
)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Option<Command>,
    #[command(flatten)]
    pub(crate) identify: IdentifyArgs,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Make a crate with a declared robot, or with --from a data folder from a robot file and its logs.
    New(NewArgs),
    /// Identify a robot file on its logs, or a model on a data folder; write fit.json and report.html.
    Identify(IdentifyArgs),
    /// Compare a robot with given parameters with its logs or a data folder; nothing is identified.
    Simulate(SimulateArgs),
    /// Regress the equations of motion on records filtered without phase shift: base parameters
    /// with deviations, friction laws beyond the model, checks on test records, physically
    /// consistent values.
    Regress(RegressArgs),
    /// Name the physical effect that the model of a robot lacks, its joint, and how far it shrinks the
    /// gap.
    Diagnose(DiagnoseArgs),
    /// Check records against a robot before anything is fitted: order and sign of the joints, units,
    /// gravity, clocks, channels that stand still, what the motion can tell.
    Check(CheckArgs),
    /// Write a robot file and its logs as a data folder: dataset.toml, nominal.toml, CSV files.
    Convert(ConvertArgs),
    /// Write an identified robot with its effects as files of a simulator (docs/simulators.md).
    Export(ExportArgs),
    /// Compare thousands of logs of many units: which differ, in what, since when (docs/fleet.md).
    Fleet(FleetArgs),
    /// List the models.
    Models,
    /// Write the completions of a shell to standard output.
    Completions(CompletionArgs),
    /// Make the embedded demonstration data anew.
    DemoData(DemoArgs),
    /// Show what `robot!` makes of the declarations in a Rust source file.
    Dump(DumpArgs),
    /// Find the motion from which a record tells most: optimal excitation within limits.
    Excite(ExciteArgs),
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

/// Arguments of `simtrue completions`.
#[derive(Debug, Clone, Args)]
pub(crate) struct CompletionArgs {
    /// The shell.
    #[arg(value_enum)]
    pub(crate) shell: clap_complete::Shell,
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

/// Arguments of `simtrue simulate`.
#[derive(Debug, Clone, Args)]
pub(crate) struct SimulateArgs {
    #[command(flatten)]
    pub(crate) source: Source,
    /// Parameters: a fit.json, or a TOML file of lines `name = value`; nominal ones if absent.
    #[arg(long, value_name = "FILE")]
    pub(crate) parameters: Option<PathBuf>,
}

/// Arguments of `simtrue demo-data`.
#[derive(Debug, Clone, Args)]
pub(crate) struct DemoArgs {
    /// Folder for the data; made if needed.
    #[arg(long, short, value_name = "FOLDER")]
    pub(crate) out: PathBuf,
}
