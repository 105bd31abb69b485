//! The withheld-effect study: cases whose cause is known are diagnosed blind, then the causes are
//! opened and the verdicts scored.
//!
//! The generator shares no physics with the diagnosis: rigid bodies ([`linkage`]), integration
//! (symplectic Euler at 0.1 ms), friction (impulses), gears, channels and every cause are written a
//! second time here; a test compares the rigid bodies. A case is
//! `cases/ID/{dataset.toml, nominal.toml, *.csv}`, its cause `truth/ID.json`, its diagnosis
//! `results/ID.json`. What is there already is not made again, so that an interrupted study goes on
//! where it stopped.

mod causes;
mod draw;
pub mod linkage;
mod motion;
mod page;
pub mod plant;
pub mod rigid;
mod score;
mod world;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use causes::{Cause, Kind};
pub use draw::{Plan, Truth};
pub use score::{Bin, Interval, Share, Summary, summary};

use crate::case::{Case, CaseError};
use crate::diagnosis::Diagnosis;
use crate::search::{Settings, diagnose};

/// A study that cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StudyError {
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
    /// A generated case.
    #[error("case {id}: {source}")]
    Case {
        /// The case.
        id: String,
        /// Why.
        source: Box<CaseError>,
    },
}

/// One case with its cause and its diagnosis.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Outcome {
    /// The case.
    pub id: String,
    /// What was hidden.
    pub truth: Truth,
    /// What was said.
    pub diagnosis: Diagnosis,
}

fn file<T>(path: &Path, result: std::io::Result<T>) -> Result<T, StudyError> {
    result.map_err(|source| StudyError::File {
        path: path.to_owned(),
        source,
    })
}

fn folder(path: PathBuf) -> Result<PathBuf, StudyError> {
    file(&path, std::fs::create_dir_all(&path))?;
    Ok(path)
}

fn read<T: serde::de::DeserializeOwned>(path: &Path) -> Result<Option<T>, StudyError> {
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(source) => {
            return Err(StudyError::File {
                path: path.to_owned(),
                source,
            });
        }
    };
    serde_json::from_str(&text)
        .map(Some)
        .map_err(|source| StudyError::Stale {
            path: path.to_owned(),
            source,
        })
}

/// Writes the records of the `i`-th case of a plan to `cases/ID` below a folder and its cause to
/// `truth/ID.json`, unless they are there. Returns the folder of the records.
///
/// # Errors
/// If a file cannot be written, or the cause is not of this program's making.
pub fn lay_out(plan: &Plan, i: usize, out: &Path) -> Result<PathBuf, StudyError> {
    let id = plan.id(i);
    let here = out.join("cases").join(&id);
    let truth_path = folder(out.join("truth"))?.join(format!("{id}.json"));
    if read::<Truth>(&truth_path)?.is_none() {
        let (files, truth) = plan.make(i).map_err(|e| StudyError::Case {
            id,
            source: Box::new(e.into()),
        })?;
        folder(here.clone())?;
        for (name, text) in files {
            let path = here.join(name);
            file(&path, std::fs::write(&path, text))?;
        }
        // Last, so that a case is complete when its cause is there.
        let text = serde_json::to_string_pretty(&truth).unwrap_or_default();
        file(&truth_path, std::fs::write(&truth_path, text))?;
    }
    Ok(here)
}

/// Makes the cases of a plan, diagnoses them and opens the causes; `progress` is told how many are
/// done, of how many.
///
/// # Errors
/// If a file cannot be written, or one of an earlier run cannot be read.
pub fn run(
    plan: &Plan,
    settings: &Settings,
    out: &Path,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Vec<Outcome>, StudyError> {
    let truths = out.join("truth");
    let results = folder(out.join("results"))?;
    let done = AtomicUsize::new(0);
    let mut outcomes: Vec<Outcome> = (0..plan.cases)
        .into_par_iter()
        .map(|i| {
            let id = plan.id(i);
            let result_path = results.join(format!("{id}.json"));
            let here = lay_out(plan, i, out)?;
            if read::<Diagnosis>(&result_path)?.is_none() {
                let case = Case::read(&here).map_err(|source| StudyError::Case {
                    id: id.clone(),
                    source: Box::new(source),
                })?;
                let said = diagnose(&case, settings);
                file(&result_path, std::fs::write(&result_path, said.to_json()))?;
            }
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, plan.cases);
            Ok(id)
        })
        .collect::<Result<Vec<String>, StudyError>>()?
        .into_iter()
        .map(|id| {
            let missing = |path: &Path| StudyError::File {
                path: path.to_owned(),
                source: std::io::ErrorKind::NotFound.into(),
            };
            let (t, r) = (
                truths.join(format!("{id}.json")),
                results.join(format!("{id}.json")),
            );
            Ok(Outcome {
                truth: read(&t)?.ok_or_else(|| missing(&t))?,
                diagnosis: read(&r)?.ok_or_else(|| missing(&r))?,
                id,
            })
        })
        .collect::<Result<Vec<Outcome>, StudyError>>()?;
    outcomes.sort_by(|a, b| a.id.cmp(&b.id));
    Ok(outcomes)
}

/// The report as a page.
pub fn to_html(summary: &Summary, outcomes: &[Outcome]) -> String {
    page::page(summary, outcomes)
}
