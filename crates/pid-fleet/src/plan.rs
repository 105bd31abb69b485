//! What is measured of every log of a fleet, and the list of its logs.
//!
//! A fleet is a folder: `fleet.toml` (this plan), `nominal.toml` (the robot), `jobs.csv` (one log per line), and
//! `results/` with one file per log.

use std::fs;
use std::path::{Path, PathBuf};

use pid_toml::Source;
use serde::{Deserialize, Serialize};

use crate::{FleetError, write_whole};

/// Version of the form of plans and results.
pub const SCHEMA: u32 = 1;

/// The plan of a fleet.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// [`SCHEMA`].
    pub schema: u32,
    /// Name of the robot.
    pub robot: String,
    /// How logs are read; kept for whoever opens them.
    pub reading: Reading,
    /// Whether times are days since 1970-01-01, or numbers of an unknown kind.
    pub dates: bool,
    /// Cut-off of the zero-phase filter of all logs, Hz.
    pub cutoff: f64,
    /// Parameters that are held, and where.
    pub held: Vec<Held>,
    /// What is measured of every log.
    pub quantities: Vec<Quantity>,
    /// What may be the matter with a unit beside a single quantity.
    pub causes: Vec<Cause>,
}

impl Plan {
    /// Whether a name is that of a residual.
    pub(crate) fn is_residual(&self, name: &str) -> bool {
        let mut all = self.quantities.iter();
        all.any(|q| q.name == name && matches!(q.kind, Kind::Residual { .. }))
    }
}

/// How logs are read: what a user said of them, as the options of the command line say it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Reading {
    /// Entries of `--map`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub map: Vec<String>,
    /// `torque`, `current` or `voltage`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub input: Option<String>,
    /// Factors from inputs to torques or forces.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub gain: Vec<f64>,
    /// What inputs do between samples: `zero-order` or `linear`; as the rules for logs say if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub input_hold: Option<String>,
    /// Step of logs without times, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sample_time: Option<f64>,
}

/// A parameter at a value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Held {
    /// Its name.
    pub name: String,
    /// Where it is held.
    pub value: f64,
}

/// One thing that is measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Quantity {
    /// Name: that of a parameter, `offset_JOINT`, `delay_JOINT`, `residual_JOINT`.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// What it is in words: for a parameter the combination that motions determine.
    pub formula: String,
    /// Value of the description.
    pub nominal: f64,
    /// Its kind.
    pub kind: Kind,
}

/// Kinds of quantities.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "is", rename_all = "snake_case")]
pub enum Kind {
    /// A parameter of the robot, with what no motion tells from it.
    Parameter,
    /// A constant force at a joint.
    Offset {
        /// The joint.
        joint: String,
    },
    /// How late the input of a joint acts.
    Delay {
        /// The joint.
        joint: String,
    },
    /// Logarithm of what is left of the force of a joint's drive: what has no other name.
    Residual {
        /// The joint.
        joint: String,
    },
}

/// Something that moves several quantities at once.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cause {
    /// Name: a parameter that is held, or `payload`.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// By how much a unit of it moves each quantity.
    pub moves: Vec<f64>,
}

/// One log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Job {
    /// The unit that it is of.
    pub unit: String,
    /// When: days since 1970-01-01 where dates are given, else a number as given.
    pub time: f64,
    /// The log: a file, or a folder with `dataset.toml`.
    pub log: PathBuf,
}

/// A plan with its logs in a folder.
#[derive(Debug, Clone, PartialEq)]
pub struct Fleet {
    /// The folder.
    pub folder: PathBuf,
    /// What is measured.
    pub plan: Plan,
    /// The logs.
    pub jobs: Vec<Job>,
}

impl Fleet {
    /// Writes plan, robot and logs into the folder.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(&self, robot: &str) -> Result<(), FleetError> {
        let make = |path: PathBuf| {
            fs::create_dir_all(&path).map_err(|error| FleetError::Write { path, error })
        };
        make(self.folder.join("results"))?;
        make(self.folder.join("part"))?;
        let plan = toml::to_string(&self.plan).map_err(|error| FleetError::Form {
            path: self.folder.join("fleet.toml"),
            reason: error.to_string(),
        })?;
        self.put("nominal.toml", robot)?;
        let mut rows = csv::Writer::from_writer(Vec::new());
        let written = self.jobs.iter().try_for_each(|job| rows.serialize(job));
        let bytes = written.map_err(Into::into).and_then(|()| {
            rows.into_inner()
                .map_err(|e| std::io::Error::other(e.to_string()))
        });
        let jobs = bytes.map_err(|error| FleetError::Write {
            path: self.folder.join("jobs.csv"),
            error,
        })?;
        self.put("jobs.csv", &String::from_utf8_lossy(&jobs))?;
        // Last: a folder with a plan is complete.
        self.put("fleet.toml", &plan)
    }

    fn put(&self, name: &str, text: &str) -> Result<(), FleetError> {
        write_whole(&self.folder, &self.folder.join(name), text)
    }

    /// Reads a folder that [`write`](Self::write) wrote.
    ///
    /// # Errors
    /// A file that is missing or of another form.
    pub fn read(folder: &Path) -> Result<Self, FleetError> {
        let text = |name: &str| {
            let path = folder.join(name);
            fs::read_to_string(&path).map_err(|error| FleetError::NoFleet { path, error })
        };
        let form = |name: &str, reason: String| FleetError::Form {
            path: folder.join(name),
            reason,
        };
        let written = text("fleet.toml")?;
        let name = folder.join("fleet.toml").display().to_string();
        let plan: Plan = (Source::new(&name, &written).parse()).map_err(FleetError::Plan)?;
        if plan.schema != SCHEMA {
            let reason = format!("schema {} where {SCHEMA} is read", plan.schema);
            return Err(form("fleet.toml", reason));
        }
        let jobs = text("jobs.csv")?;
        let jobs: Result<Vec<Job>, csv::Error> = csv::Reader::from_reader(jobs.as_bytes())
            .deserialize()
            .collect();
        Ok(Self {
            folder: folder.to_owned(),
            plan,
            jobs: jobs.map_err(|e| form("jobs.csv", e.to_string()))?,
        })
    }

    /// Where the result of a job is.
    pub fn result(&self, job: usize) -> PathBuf {
        self.folder.join("results").join(format!("{job:06}.json"))
    }
}

/// A part of the jobs: every `of`-th from the `part`-th on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slice {
    /// From 1.
    pub part: usize,
    /// How many parts there are.
    pub of: usize,
}

impl Slice {
    /// All jobs.
    pub const ALL: Self = Self { part: 1, of: 1 };

    /// The jobs of this part, from 0.
    pub fn of(self, jobs: usize) -> impl Iterator<Item = usize> {
        (self.part - 1..jobs).step_by(self.of)
    }
}

impl std::str::FromStr for Slice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(part, of)| {
            let (part, of) = (part.parse().ok()?, of.parse().ok()?);
            (1 <= part && part <= of).then_some(Self { part, of })
        });
        numbers.ok_or_else(|| "write K/N with 1 ≤ K ≤ N, like 1/40".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_share_all_jobs() {
        let mut all: Vec<usize> = (1..=7)
            .flat_map(|part| Slice { part, of: 7 }.of(100))
            .collect();
        all.sort_unstable();
        assert_eq!(all, (0..100).collect::<Vec<_>>());
        assert_eq!("3/40".parse(), Ok(Slice { part: 3, of: 40 }));
        for wrong in ["0/4", "5/4", "1", "a/2", "1/0"] {
            assert!(wrong.parse::<Slice>().is_err(), "{wrong}");
        }
    }
}
