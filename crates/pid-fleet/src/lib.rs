//! Thousands of logs of many units of one robot: which units differ, in what, since when; the spread between units as
//! prior for the next one; what drifts in all of them.
//!
//! ```text
//! a few logs -> plan (filter, quantities, causes)                        `design`, `plan`
//! log + plan -> quantities with deviations, one file per log             `measure`, `run`
//! all files -> spread between units, units that stand out, drifts        `collect`
//! ```
//!
//! Distribution over machines is left to whoever runs `run` on slices of the jobs: each log is one file that is
//! written whole, and what is done is not done again.

mod blame;
pub mod collect;
pub mod design;
pub mod drift;
mod frame;
pub mod logs;
pub mod measure;
mod page;
pub mod plan;
mod prior;
pub mod robust;
pub mod run;
pub mod standing_out;
mod text;

use std::io;
use std::path::{Path, PathBuf};

use pid_data::signal::SignalError;
use pid_toml::Mistake;

pub use blame::Suspect;
pub use collect::{Summary, collect};
pub use measure::{Estimator, MeasureError, Measured};
pub use plan::{Fleet, Job, Plan, Reading, Slice};
pub use prior::prior;
pub use run::{Done, run};

/// What ends a command on a fleet.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FleetError {
    /// No plan.
    #[error("{}: cannot be read: {error}\n  help: `simtrue fleet plan ROBOT LOGS --out FOLDER` makes the folder of a fleet", path.display())]
    NoFleet {
        /// The file.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// A file of another form.
    #[error("{}: {reason}\n  help: plan the fleet again", path.display())]
    Form {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A plan of another form.
    #[error("{0}\n  help: plan the fleet again")]
    Plan(Mistake),
    /// A file that cannot be written.
    #[error("{}: cannot be written: {error}\n  help: see that the folder is there and that it is yours", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// A log that no filter takes.
    #[error(transparent)]
    Signal(#[from] Box<SignalError>),
    /// Logs that tell nothing.
    #[error(
        "the logs determine no parameter of the robot\n  help: log motions of all joints, and see `simtrue check ROBOT LOG`"
    )]
    NothingDetermined,
    /// The plan is of another robot.
    #[error(transparent)]
    Measure(#[from] MeasureError),
    /// A manifest with a mistake.
    #[error("{}:{line}: {reason}\n  help: a manifest has the columns unit, time and log; time is a date (2026-01-31, 2026-01-31T08:30) or a number, of one kind in all lines", path.display())]
    Manifest {
        /// The manifest.
        path: PathBuf,
        /// Its line, from 1.
        line: u64,
        /// What is wrong.
        reason: String,
    },
    /// A log whose time nobody states.
    #[error("{}: no date stands in the name of the log or of its folders\n  help: write it as 2026-01-31 or 20260131, or give a manifest in place of the folder: a CSV file with the columns unit, time and log", path.display())]
    NoDate {
        /// The log.
        path: PathBuf,
    },
    /// A place without logs.
    #[error("{}: no logs of units are there\n  help: give a folder with a folder per unit, or a CSV file with the columns unit, time and log", path.display())]
    NoLogs {
        /// The place.
        path: PathBuf,
    },
    /// Effects that the regression of a fleet does not take.
    #[error(
        "the description has effects with states (delays, gears, loops, lags), which the regression of a fleet does not take\n  help: leave them out of the description; a late input is measured without them"
    )]
    States,
    /// Too little to compare.
    #[error(
        "{units} units have results, and a fleet has three at least\n  help: run the jobs that are missing: `simtrue fleet run FOLDER`"
    )]
    TooFew {
        /// Units with results.
        units: usize,
    },
}

/// Writes a file whole or not at all; the part is the process's own, so that two processes that write the same file
/// never mix it.
pub(crate) fn write_whole(fleet: &Path, path: &Path, text: &str) -> Result<(), FleetError> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let part = fleet
        .join("part")
        .join(format!("{name}.{}", std::process::id()));
    let fail = |error| FleetError::Write {
        path: path.to_owned(),
        error,
    };
    std::fs::write(&part, text).map_err(fail)?;
    std::fs::rename(&part, path).map_err(fail)
}
