//! `pid-studies untidy`: drawn cases with several effects on untidy records, diagnosed blind, then
//! scored by the share that each effect has of the gap.

mod score;
mod tables;

use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;
use pid_cli::output;
use pid_cli::progress::Progress;
use pid_diagnose::search::Settings;
use pid_withheld::UntidyPlan;

pub use score::{Effect, Row, row};
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
    /// Only the A-th of B parts of the cases, A from 1.
    #[arg(long, value_name = "A/B", default_value = "1/1")]
    slice: Slice,
    /// Folder for cases, causes, diagnoses and scores; results that are there already are kept.
    #[arg(long, short, value_name = "FOLDER", default_value = "simtrue-untidy")]
    out: PathBuf,
}

/// A part of the cases: every `of`-th from the `part`-th on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Slice {
    /// From 1.
    part: usize,
    of: usize,
}

impl FromStr for Slice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(part, of)| {
            let (part, of) = (part.parse().ok()?, of.parse().ok()?);
            (1 <= part && part <= of).then_some(Self { part, of })
        });
        numbers.ok_or_else(|| "write A/B with 1 ≤ A ≤ B, like 1/2".to_owned())
    }
}

impl Slice {
    fn of(self, cases: usize) -> Vec<usize> {
        (self.part - 1..cases).step_by(self.of).collect()
    }
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
    let wanted = args.slice.of(args.cases);
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
