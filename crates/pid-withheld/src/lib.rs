//! Cases whose cause is known and withheld: drawn robots with a physical effect that their nominal
//! description lacks, as folders of records.
//!
//! The physics is written here a second time and shares nothing with the mechanics by which records
//! are judged: rigid bodies ([`linkage`]), integration (symplectic Euler at 0.1 ms), friction
//! (impulses), gears, channels and every cause. [`Plan`] draws one cause on clean records,
//! [`UntidyPlan`] several on untidy ones, with the share that each has of the gap, [`ServoPlan`] one behind
//! position loops. A test of
//! `pid-diagnose` holds both mechanics against each other. A case is
//! `cases/ID/{dataset.toml, nominal.toml, *.csv}`, its cause `truth/ID.json`. What is there already is
//! not made again. [`fleet`] draws logs of many units of one arm.

mod causes;
mod controller;
mod family;
pub mod fleet;
mod gaps;
mod like;
pub mod linkage;
mod magnitudes;
mod mess;
mod motion;
mod plan;
pub mod plant;
mod position_loop;
mod record;
mod refit;
mod replay;
pub mod rigid;
mod robot;
mod sensors;
mod servo;
mod setup;
mod spoil;
mod text;
mod untidy;
mod world;

use std::path::{Path, PathBuf};

use pid_interpret::nominal::NominalError;

pub use causes::{Cause, Kind};
pub use gaps::{Gaps, Part};
pub use mess::{Current, Mess};
pub use plan::{Drawing, Plan, Truth};
pub use position_loop::{Law, Loop};
pub use servo::{ServoPlan, ServoTruth, Servos, Stated};
pub use untidy::{Recording, UntidyPlan, UntidyTruth};

/// File names and contents.
pub type Files = Vec<(String, String)>;

/// Cases that are drawn from a seed.
pub trait Study: Sync {
    /// What is hidden in a case.
    type Truth: serde::Serialize + serde::de::DeserializeOwned + Send;

    /// Name of the `i`-th case.
    fn id(&self, i: usize) -> String;

    /// Number of cases.
    fn cases(&self) -> usize;

    /// Description and records of the `i`-th case, and what is hidden in it.
    ///
    /// # Errors
    /// If the drawn robot is not one; none is known.
    fn make(&self, i: usize) -> Result<(Files, Self::Truth), NominalError>;
}

/// A case that cannot be laid out.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WithheldError {
    /// A file or folder.
    #[error("cannot write or read {path}: {source}")]
    File {
        /// The place.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file of an earlier run.
    #[error("{path} is not of this program's making: {source}; remove it or choose another folder")]
    Stale {
        /// The file.
        path: PathBuf,
        /// Where and what.
        source: serde_json::Error,
    },
    /// A drawn robot.
    #[error("case {id}: {source}")]
    Robot {
        /// The case.
        id: String,
        /// Why.
        source: Box<NominalError>,
    },
}

fn file<T>(path: &Path, result: std::io::Result<T>) -> Result<T, WithheldError> {
    result.map_err(|source| WithheldError::File {
        path: path.to_owned(),
        source,
    })
}

/// Makes a folder and those above it.
///
/// # Errors
/// With the folder, if it cannot be made.
pub fn folder(path: PathBuf) -> Result<PathBuf, WithheldError> {
    file(&path, std::fs::create_dir_all(&path))?;
    Ok(path)
}

/// Writes a file.
///
/// # Errors
/// With the file, if it cannot be written.
pub fn write(path: &Path, text: &str) -> Result<(), WithheldError> {
    file(path, std::fs::write(path, text))
}

/// What an earlier run left in a file; `None` where there is none.
///
/// # Errors
/// If the file cannot be read or is of another making.
pub fn read<T: serde::de::DeserializeOwned>(path: &Path) -> Result<Option<T>, WithheldError> {
    let text = match std::fs::read_to_string(path) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        other => file(path, other)?,
    };
    serde_json::from_str(&text)
        .map(Some)
        .map_err(|source| WithheldError::Stale {
            path: path.to_owned(),
            source,
        })
}

/// Writes the records of the `i`-th case of a plan to `cases/ID` below a folder and its cause to
/// `truth/ID.json`, unless they are there. Returns the folder of the records.
///
/// # Errors
/// If a file cannot be written, or the cause is not of this program's making.
pub fn lay_out<S: Study>(plan: &S, i: usize, out: &Path) -> Result<PathBuf, WithheldError> {
    let id = plan.id(i);
    let here = out.join("cases").join(&id);
    let truth_path = folder(out.join("truth"))?.join(format!("{id}.json"));
    if read::<S::Truth>(&truth_path)?.is_none() {
        let (files, truth) = plan.make(i).map_err(|e| WithheldError::Robot {
            id,
            source: Box::new(e),
        })?;
        folder(here.clone())?;
        for (name, text) in files {
            write(&here.join(name), &text)?;
        }
        // Last, so that a case is complete when its cause is there.
        let text = serde_json::to_string_pretty(&truth).unwrap_or_default();
        write(&truth_path, &text)?;
    }
    Ok(here)
}
