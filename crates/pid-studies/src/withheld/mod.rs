//! `pid-studies withheld`: drawn cases with a withheld effect, diagnosed blind, then scored.

pub mod criteria;
pub mod null;
mod page;
pub(crate) mod score;
mod study;

use std::path::PathBuf;

use clap::Args;
use pid_cli::output;
use pid_cli::progress::Progress;
use pid_diagnose::search::Settings;
use pid_fleet::Slice;
use pid_withheld::{Drawing, Plan};

pub use page::to_html;
pub use score::{Bin, Interval, Outcome, Share, Summary, summary};
pub(crate) use score::{right, tier};
pub use study::{diagnose_all, diagnose_some};

use crate::{Failure, write};

/// Arguments of `pid-studies withheld`.
#[derive(Debug, Clone, Args)]
pub struct WithheldArgs {
    /// Number of cases.
    #[arg(long, default_value_t = 300)]
    cases: usize,
    /// Seed of robots, causes, magnitudes, motions and noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Most joints of a robot; up to 3, robots have one or two where --fewest is below 3.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(1..=6))]
    joints: u8,
    /// Fewest joints of a robot; from 3 on all are arms of as many as --joints says.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=6))]
    fewest: u8,
    /// Only cases without a cause: the rate of false alarms.
    #[arg(long)]
    nulls: bool,
    /// Only cases with a cause outside the list: how often a law of its own describes it.
    #[arg(long, conflicts_with = "nulls")]
    outside: bool,
    /// Only the K-th of N parts of the cases, K from 1.
    #[arg(long, value_name = "K/N", default_value = "1/1")]
    slice: Slice,
    /// Folder for cases, causes, diagnoses and the report; results that are there already are kept.
    #[arg(long, short, value_name = "FOLDER", default_value = "simtrue-study")]
    out: PathBuf,
}

/// Runs or continues the study and writes summary.json and report.html.
///
/// # Errors
/// What stops it.
pub fn run(args: &WithheldArgs) -> Result<u8, Failure> {
    let (fewest, joints) = crate::joints(args.fewest, args.joints)?;
    let plan = Plan {
        seed: args.seed,
        cases: args.cases,
        fewest,
        joints,
        causes: match (args.nulls, args.outside) {
            (true, _) => Drawing::Nothing,
            (_, true) => Drawing::Outside,
            _ => Drawing::All,
        },
    };
    let progress = Progress::start("drawing cases");
    let wanted: Vec<usize> = args.slice.of(args.cases).collect();
    let settings = Settings::default();
    let outcomes = diagnose_some(&plan, &wanted, &settings, &args.out, &|done, of| {
        progress.step(format!("{done} of {of} cases"));
        progress.done(done as f64 / of as f64);
    })?;
    drop(progress);
    let figures = summary(&outcomes);
    let json = serde_json::to_string_pretty(&figures).unwrap_or_default();
    let part = match args.slice {
        Slice { of: 1, .. } => String::new(),
        Slice { part, of } => format!("-{part}-of-{of}"),
    };
    let at = |stem: &str, ending: &str| args.out.join(format!("{stem}{part}.{ending}"));
    write(&at("summary", "json"), &json)?;
    write(&at("report", "html"), &to_html(&figures, &outcomes))?;
    let mut text = format!("{} cases\n", outcomes.len());
    for (name, figures) in figures.lines() {
        text.push_str(&format!("  {name:42} {figures}\n"));
    }
    output::print(&text);
    Ok(0)
}
