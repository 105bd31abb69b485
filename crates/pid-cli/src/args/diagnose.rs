//! Arguments of `simtrue diagnose`.

use std::path::PathBuf;

use clap::Args;
use pid_diagnose::search::Settings;

use super::open::OpenArgs;
use super::parse::positive;

/// Arguments of `simtrue diagnose`.
#[derive(Debug, Clone, Args)]
pub(crate) struct DiagnoseArgs {
    /// Robot file (URDF, MJCF or nominal.toml) and its logs (docs/logs.md), or folders with
    /// dataset.toml, nominal.toml and CSV files.
    #[arg(required = true, value_name = "ROBOT LOG|FOLDER")]
    pub(crate) paths: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) open: OpenArgs,
    /// Go on although the records contradict the robot (`simtrue check` says how).
    #[arg(long)]
    pub(crate) anyway: bool,
    /// Nominal description of the robot, in place of the nominal.toml of each folder.
    #[arg(long, value_name = "FILE", conflicts_with = "model")]
    pub(crate) nominal: Option<PathBuf>,
    /// Folder for the results: diagnosis.json, or one folder per data folder if several are given.
    #[arg(
        long,
        short,
        value_name = "FOLDER",
        default_value = "simtrue-diagnosis"
    )]
    pub(crate) out: PathBuf,
    /// Print the diagnoses as JSON, those of several folders as a list, in place of a summary.
    #[arg(long)]
    pub(crate) json: bool,
    /// Print nothing but errors.
    #[arg(long, conflicts_with = "json")]
    pub(crate) quiet: bool,
    /// End with a code that says the verdict: 0 none, 10 one cause or several, 11 partly unknown, 12
    /// unknown; of several folders the largest.
    #[arg(long)]
    pub(crate) exit_code: bool,
    /// Diagnose again where a result is already there.
    #[arg(long)]
    pub(crate) again: bool,
    /// Declared model in place of nominal.toml: nominal values and tolerances are those of its
    /// parameters. A measurement.toml in the folder may state how the robot is measured.
    #[arg(long, value_name = "MODEL")]
    pub(crate) model: Option<String>,
    /// Look for the motion that separates the first two candidates even where the records do so already.
    #[arg(long)]
    pub(crate) next: bool,
    /// Refit every candidate to its end instead of the best ones of the screening. Slow; use it to
    /// judge the screening.
    #[arg(long)]
    pub(crate) refit_all: bool,
    /// Length of the train records that is fitted, seconds times the number of joints; of longer
    /// records it takes the parts that decide. Gaps use the whole test records.
    #[arg(long, value_name = "SECONDS", default_value_t = Settings::default().joint_seconds, value_parser = positive)]
    pub(crate) joint_seconds: f64,
}
