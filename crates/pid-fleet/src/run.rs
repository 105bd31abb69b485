//! Logs to result files, one each: whole or not there, and not made again while plan and log are the same.

use std::fs;
use std::hash::Hasher;
use std::io;
use std::path::Path;
use std::time::{Duration, Instant};

use pid_data::Dataset;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use twox_hash::XxHash64;

use crate::measure::{Estimator, Measured};
use crate::plan::{Fleet, SCHEMA};
use crate::{FleetError, write_whole};

/// The result of a log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// [`SCHEMA`].
    pub schema: u32,
    /// Number of the job.
    pub job: usize,
    /// Digest of plan and robot.
    pub plan: String,
    /// Digest of the log.
    pub log: String,
    /// What it tells.
    pub measured: Option<Measured>,
    /// Why it tells nothing.
    pub error: Option<String>,
}

impl Entry {
    /// Reads a result.
    ///
    /// # Errors
    /// Why it is none.
    pub fn read(path: &Path) -> Result<Self, String> {
        let text = fs::read_to_string(path).map_err(|e| e.to_string())?;
        let entry: Self = serde_json::from_str(&text).map_err(|e| e.to_string())?;
        match entry.schema == SCHEMA && entry.measured.is_some() != entry.error.is_some() {
            true => Ok(entry),
            false => Err("it is of another version".to_owned()),
        }
    }
}

/// What a run did.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Done {
    /// Logs that were measured.
    pub measured: usize,
    /// Results that were there already.
    pub kept: usize,
    /// Jobs whose log tells nothing, with the reason.
    pub failed: Vec<(usize, String)>,
    /// Time spent with logs, in all threads together.
    pub busy: Duration,
}

impl Done {
    fn and(mut self, other: Self) -> Self {
        self.measured += other.measured;
        self.kept += other.kept;
        self.failed.extend(other.failed);
        self.busy += other.busy;
        self
    }
}

/// Digest of a fleet's plan and robot.
///
/// # Errors
/// Files that cannot be read.
pub fn plan_digest(folder: &Path) -> Result<String, FleetError> {
    let mut hasher = XxHash64::with_seed(0);
    for name in ["fleet.toml", "nominal.toml"] {
        let path = folder.join(name);
        let bytes = fs::read(&path).map_err(|error| FleetError::NoFleet { path, error })?;
        hasher.write_usize(bytes.len());
        hasher.write(&bytes);
    }
    Ok(format!("{:016x}", hasher.finish()))
}

/// Digest of a log: of the file, or of the files of a folder in the order of their names.
fn log_digest(path: &Path) -> io::Result<String> {
    let mut hasher = XxHash64::with_seed(0);
    let mut files = vec![path.to_owned()];
    if path.is_dir() {
        files = fs::read_dir(path)?
            .map(|entry| entry.map(|e| e.path()))
            .collect::<io::Result<_>>()?;
        files.retain(|file| file.is_file());
        files.sort();
    }
    for file in &files {
        let bytes = fs::read(file)?;
        hasher.write(file.file_name().unwrap_or_default().as_encoded_bytes());
        hasher.write_usize(bytes.len());
        hasher.write(&bytes);
    }
    Ok(format!("{:016x}", hasher.finish()))
}

/// Measures the logs of some jobs with `open` as their reader; `watch` hears how many are done, and stops the run by
/// `false`. Uses the threads of the caller's pool.
///
/// # Errors
/// If the plan cannot be read or a result cannot be written. A log that cannot be read is a result, not an error.
pub fn run(
    fleet: &Fleet,
    estimator: &Estimator<'_>,
    jobs: &[usize],
    open: &(dyn Fn(&Path) -> Result<Dataset, String> + Sync),
    watch: &(dyn Fn(usize) -> bool + Sync),
) -> Result<Done, FleetError> {
    let plan = plan_digest(&fleet.folder)?;
    let counted = std::sync::atomic::AtomicUsize::new(0);
    jobs.par_iter()
        .map(|&job| {
            let done = counted.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            match watch(done) {
                true => one(fleet, estimator, job, &plan, open),
                false => Ok(Done::default()),
            }
        })
        .try_reduce(Done::default, |a, b| Ok(a.and(b)))
}

fn one(
    fleet: &Fleet,
    estimator: &Estimator<'_>,
    job: usize,
    plan: &str,
    open: &(dyn Fn(&Path) -> Result<Dataset, String> + Sync),
) -> Result<Done, FleetError> {
    let started = Instant::now();
    let Some(task) = fleet.jobs.get(job) else {
        return Ok(Done::default());
    };
    let path = fleet.result(job);
    let log = log_digest(&task.log);
    let digest = log.as_ref().cloned().unwrap_or_default();
    if let Ok(entry) = Entry::read(&path)
        && entry.plan == plan
        && entry.log == digest
    {
        return Ok(Done {
            kept: 1,
            failed: entry.error.map(|e| (job, e)).into_iter().collect(),
            busy: started.elapsed(),
            ..Done::default()
        });
    }
    let measured = match log {
        Ok(_) => open(&task.log).and_then(|log| estimator.measure(&log).map_err(|e| e.to_string())),
        Err(error) => Err(format!("{}: cannot be read: {error}", task.log.display())),
    };
    let entry = Entry {
        schema: SCHEMA,
        job,
        plan: plan.to_owned(),
        log: digest,
        error: measured.as_ref().err().cloned(),
        measured: measured.ok(),
    };
    let text = serde_json::to_string(&entry).map_err(|e| FleetError::Form {
        path: path.clone(),
        reason: e.to_string(),
    })?;
    write_whole(&fleet.folder, &path, &text)?;
    Ok(Done {
        measured: 1,
        kept: 0,
        failed: entry.error.map(|e| (job, e)).into_iter().collect(),
        busy: started.elapsed(),
    })
}
