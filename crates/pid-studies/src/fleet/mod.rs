//! `pid-studies fleet-logs` and `fleet-score`: logs of a fleet with hidden odd units, and what `simtrue fleet` found of
//! them.

mod score;

use std::path::{Path, PathBuf};

use clap::Args;
use pid_cli::output;
use pid_cli::progress::Progress;
use pid_fleet::Slice;
use pid_withheld::fleet::{DrawnFleet, FleetPlan, Odd};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use score::{Score, score};

use crate::{Failure, make_folder, write};

/// What is hidden, beside the logs.
const TRUTH: &str = "truth.json";

/// Arguments of `pid-studies fleet-logs`.
#[derive(Debug, Clone, Args)]
pub struct FleetLogsArgs {
    /// Number of units.
    #[arg(long, default_value_t = 1000)]
    units: usize,
    /// Logs of each unit.
    #[arg(long, default_value_t = 10)]
    logs: usize,
    /// Units that differ from their first log on, and as many that change over time; one in a hundred if absent.
    #[arg(long)]
    odd: Option<usize>,
    /// Seed of the robot, its units, what is the matter with some, motions and noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only the K-th of N parts of the units, K from 1.
    #[arg(long, value_name = "K/N", default_value = "1/1")]
    slice: Slice,
    /// Folder for nominal.toml, fleet.csv, truth.json and the logs.
    #[arg(long, short, value_name = "FOLDER")]
    out: PathBuf,
}

/// Arguments of `pid-studies fleet-score`.
#[derive(Debug, Clone, Args)]
pub struct FleetScoreArgs {
    /// Folder of `fleet-logs`.
    logs: PathBuf,
    /// Folder of `simtrue fleet`, after `collect`.
    fleet: PathBuf,
    /// Print every odd unit with what was said of it.
    #[arg(long)]
    verbose: bool,
}

/// What is hidden in a fleet.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Names of the joints, base to tip.
    pub joints: Vec<String>,
    /// Units with something the matter.
    pub odd: Vec<Odd>,
}

/// Name of a unit.
pub(crate) fn name(unit: usize) -> String {
    format!("u{unit:04}")
}

/// Writes the logs, their manifest and what is hidden.
///
/// # Errors
/// Files that cannot be written.
pub fn make(args: &FleetLogsArgs) -> Result<(), Failure> {
    let drawn = FleetPlan {
        seed: args.seed,
        units: args.units,
        logs: args.logs,
        odd: args.odd.unwrap_or(args.units.div_ceil(100)),
    }
    .draw()?;
    let progress = Progress::start("drawing logs");
    make_folder(&args.out.join("logs"))?;
    let wanted: Vec<usize> = args.slice.of(args.units).collect();
    let rows: Vec<String> = wanted
        .par_iter()
        .map(|&unit| unit_logs(&drawn, unit, args.logs, &args.out))
        .collect::<Result<_, _>>()?;
    drop(progress);
    let part = match args.slice {
        Slice { of: 1, .. } => "fleet.csv".to_owned(),
        Slice { part, of } => format!("fleet-{part}-of-{of}.csv"),
    };
    write(
        &args.out.join(&part),
        &format!("unit,time,log\n{}", rows.concat()),
    )?;
    write(&args.out.join("nominal.toml"), &drawn.nominal())?;
    let truth = Truth {
        joints: drawn.joints(),
        odd: drawn.odd().to_vec(),
    };
    write(
        &args.out.join(TRUTH),
        &serde_json::to_string_pretty(&truth)?,
    )?;
    let logs = wanted.len() * args.logs;
    output::print(&format!(
        "{logs} logs of {} units: {}\n",
        wanted.len(),
        args.out.join(part).display()
    ));
    Ok(())
}

/// Logs of a unit, and their lines of the manifest.
fn unit_logs(drawn: &DrawnFleet, unit: usize, logs: usize, out: &Path) -> Result<String, Failure> {
    let name = name(unit);
    let mut lines = String::new();
    for k in 0..logs {
        let (day, text) = drawn.log(unit, k);
        let file = format!("logs/{name}_{k:02}.csv");
        write(&out.join(&file), &text)?;
        lines.push_str(&format!("{name},{},{file}\n", date(day)));
    }
    Ok(lines)
}

/// A day since 1970-01-01 with its time, to the minute.
fn date(day: f64) -> String {
    let minutes = (1440.0 * day).round() as i64;
    let (hour, minute) = (minutes.rem_euclid(1440) / 60, minutes.rem_euclid(60));
    let date = pid_page::Date::of_day(minutes.div_euclid(1440));
    format!("{date}T{hour:02}:{minute:02}")
}

/// Prints what was found of what is hidden.
///
/// # Errors
/// Files that cannot be read.
pub fn judge(args: &FleetScoreArgs) -> Result<(), Failure> {
    let text = |path: PathBuf| {
        std::fs::read_to_string(&path)
            .map_err(|e| -> Failure { format!("{}: cannot be read: {e}", path.display()).into() })
    };
    let truth: Truth = serde_json::from_str(&text(args.logs.join(TRUTH))?)?;
    let summary: pid_fleet::Summary = serde_json::from_str(&text(args.fleet.join("fleet.json"))?)?;
    let score = score(&truth, &summary);
    if args.verbose {
        score.lines.iter().for_each(|line| println!("{line}"));
        println!();
    }
    print!("{}", score.in_words());
    Ok(())
}
