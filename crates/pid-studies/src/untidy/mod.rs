//! `pid-studies untidy`: drawn cases with several effects on untidy records, diagnosed blind, then
//! scored by the share that each effect has of the gap.

mod score;
mod tables;

use std::path::PathBuf;

use clap::Args;
use pid_cli::output;
use pid_cli::progress::Progress;
use pid_diagnose::search::Settings;
use pid_fleet::Slice;
use pid_withheld::UntidyPlan;

pub use score::{Effect, Row, row};
pub(crate) use tables::LEAST;
pub use tables::{Tier, tiers, to_text};

use crate::withheld::diagnose_some;
use crate::{Failure, write};

/// Arguments of `pid-studies untidy`.
#[derive(Debug, Clone, Args)]
pub struct UntidyArgs {
    /// Number of cases.
    #[arg(long, default_value_t = 24)]
    cases: usize,
    /// Seed of robots, causes, magnitudes, motions, noise and untidiness.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Most joints of a robot.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u8).range(1..=6))]
    joints: u8,
    /// Only the K-th of N parts of the cases, K from 1.
    #[arg(long, value_name = "K/N", default_value = "1/1")]
    slice: Slice,
    /// Folder for cases, causes, diagnoses and scores; results that are there already are kept.
    #[arg(long, short, value_name = "FOLDER", default_value = "simtrue-untidy")]
    out: PathBuf,
}

/// Runs or continues the study, prints a table and a line per case, and writes rows.json.
///
/// # Errors
/// What stops it.
pub fn run(args: &UntidyArgs) -> Result<u8, Failure> {
    let plan = UntidyPlan {
        seed: args.seed,
        cases: args.cases,
        joints: usize::from(args.joints),
    };
    let wanted: Vec<usize> = args.slice.of(args.cases).collect();
    let progress = Progress::start("drawing cases");
    let settings = Settings::default();
    let outcomes = diagnose_some(&plan, &wanted, &settings, &args.out, &|done, of| {
        progress.step(format!("{done} of {of} cases"));
    })?;
    drop(progress);
    let rows: Vec<Row> = outcomes.iter().map(row).collect();
    let json = serde_json::to_string_pretty(&rows).unwrap_or_default();
    let name = match args.slice {
        Slice { of: 1, .. } => "rows.json".to_owned(),
        Slice { part, of } => format!("rows-{part}-of-{of}.json"),
    };
    write(&args.out.join(name), &json)?;
    output::print(&to_text(&rows));
    Ok(0)
}
