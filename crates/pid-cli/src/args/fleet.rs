//! Arguments of `simtrue fleet`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};
use pid_fleet::Slice;

use super::open::{ClassArg, HoldArg, InputArg, OpenArgs};
use super::parse::{at_least_one, finite, positive};

/// Arguments of `simtrue fleet`.
#[derive(Debug, Clone, Args)]
pub(crate) struct FleetArgs {
    #[command(subcommand)]
    pub(crate) command: FleetCommand,
}

/// The three steps of a fleet.
#[derive(Debug, Clone, Subcommand)]
pub(crate) enum FleetCommand {
    /// Choose from a few logs what is measured of all, list them, and print the line that starts each engine.
    Plan(PlanArgs),
    /// Measure logs, one result file each; what is done is not done again.
    Run(RunArgs),
    /// Compare the units: which differ, in what, since when; write fleet.json, report.html, prior.toml.
    Collect(CollectArgs),
}

/// Arguments of `simtrue fleet plan`.
#[derive(Debug, Clone, Args)]
pub(crate) struct PlanArgs {
    /// Robot file (URDF, MJCF or nominal.toml).
    pub(crate) robot: PathBuf,
    /// A folder with a folder of logs per unit, a date in each name; or a CSV file with the columns unit, time, log.
    #[arg(required = true, value_name = "LOGS")]
    pub(crate) logs: Vec<PathBuf>,
    /// Folder of the fleet; made if needed, shared by all machines that work on it.
    #[arg(long, short, value_name = "FOLDER")]
    pub(crate) out: PathBuf,
    /// Slices that the printed lines make; by default one per 1000 logs.
    #[arg(long, value_name = "N", value_parser = at_least_one)]
    pub(crate) slices: Option<usize>,
    /// Cut-off of the zero-phase filter of all logs, Hz; from the noise of some logs if absent.
    #[arg(long, value_name = "HZ", value_parser = positive)]
    pub(crate) cutoff: Option<f64>,
    /// Column of the logs by hand, as of `simtrue identify`; may be repeated.
    #[arg(long, value_name = "ENTRY", value_parser = entry)]
    pub(crate) map: Vec<String>,
    /// What the inputs of the logs are, where their names and units do not say it.
    #[arg(long, value_enum, value_name = "QUANTITY")]
    pub(crate) input: Option<InputArg>,
    /// Factors from the inputs to the torque or force at the joints, one per joint.
    #[arg(long, visible_alias = "input-gain", value_name = "K1,K2,…", value_delimiter = ',', value_parser = finite)]
    pub(crate) gain: Vec<f64>,
    /// What the inputs do between samples: readings run straight (linear), commands keep their value (zero-order).
    #[arg(long, value_enum, value_name = "HOLD")]
    pub(crate) input_hold: Option<HoldArg>,
    /// Step of logs without times, s.
    #[arg(long, value_name = "SECONDS", value_parser = positive)]
    pub(crate) sample_time: Option<f64>,
    /// Where masses and inertias of the robot file come from; says how far they are trusted.
    #[arg(long, value_enum, default_value_t, value_name = "CLASS")]
    pub(crate) class: ClassArg,
    /// Joints of the robot file that move; the others are held at zero. By default all.
    #[arg(long, value_name = "J1,J2,…", value_delimiter = ',')]
    pub(crate) joints: Vec<String>,
}

impl PlanArgs {
    /// How the robot file is read.
    pub(crate) fn of_robot(&self) -> OpenArgs {
        OpenArgs {
            class: self.class,
            joints: self.joints.clone(),
            ..OpenArgs::default()
        }
    }

    /// How the logs are read, as a plan keeps it.
    pub(crate) fn reading(&self) -> pid_fleet::Reading {
        pid_fleet::Reading {
            map: self.map.clone(),
            input: self.input.and_then(word),
            gain: self.gain.clone(),
            input_hold: self.input_hold.and_then(word),
            sample_time: self.sample_time,
        }
    }
}

/// The word of the command line for a value.
fn word(value: impl ValueEnum) -> Option<String> {
    let value = value.to_possible_value()?;
    Some(value.get_name().to_owned())
}

/// How a plan's logs are read.
///
/// # Errors
/// A word of the plan that is none.
pub(crate) fn of_reading(reading: &pid_fleet::Reading) -> Result<OpenArgs, String> {
    let entries = reading
        .map
        .iter()
        .map(|text| pid_logs::Entry::parse(text).map_err(|e| e.to_string()));
    let (input, hold) = (reading.input.as_ref(), reading.input_hold.as_ref());
    Ok(OpenArgs {
        map: entries.collect::<Result<_, _>>()?,
        input: input
            .map(|name| InputArg::from_str(name, false))
            .transpose()?,
        gain: reading.gain.clone(),
        input_hold: hold
            .map(|name| HoldArg::from_str(name, false))
            .transpose()?,
        sample_time: reading.sample_time,
        whole: true,
        ..OpenArgs::default()
    })
}

/// An entry that is one; kept as it is written.
fn entry(text: &str) -> Result<String, String> {
    pid_logs::Entry::parse(text)
        .map(|_| text.to_owned())
        .map_err(|e| e.to_string())
}

/// Arguments of `simtrue fleet run`.
#[derive(Debug, Clone, Args)]
pub(crate) struct RunArgs {
    /// Folder of the fleet.
    pub(crate) folder: PathBuf,
    /// Only the K-th of N parts of the logs, K from 1.
    #[arg(long, value_name = "K/N", conflicts_with = "job")]
    pub(crate) slice: Option<Slice>,
    /// Only one log: its line in jobs.csv, from 0.
    #[arg(long, value_name = "K")]
    pub(crate) job: Option<usize>,
    /// Logs at a time; 0: as many as there are cores.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub(crate) threads: usize,
}

/// Arguments of `simtrue fleet collect`.
#[derive(Debug, Clone, Args)]
pub(crate) struct CollectArgs {
    /// Folder of the fleet.
    pub(crate) folder: PathBuf,
    /// Expected share of false ones among the units that are named.
    #[arg(long, value_name = "SHARE", default_value_t = pid_fleet::collect::RATE, value_parser = share)]
    pub(crate) rate: f64,
    /// End with code 10 if a unit stands out.
    #[arg(long)]
    pub(crate) exit_code: bool,
}

fn share(text: &str) -> Result<f64, String> {
    match positive(text)? {
        x if x < 1.0 => Ok(x),
        _ => Err("write a share between 0 and 1, like 0.01".to_owned()),
    }
}
