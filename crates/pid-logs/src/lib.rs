//! Logs of robots as data sets: from the file a robot wrote to a [`Dataset`].
//!
//! ```text
//! CSV, MCAP, .db3, Parquet, LeRobot, NPZ, MAT -> Log (channels over clocks)
//! Log + joints of the robot + Settings -> Found { dataset, assumptions, … } -> dataset.toml + CSV
//! ```
//!
//! The format is found by content. Columns are found by their names and the names of the joints;
//! units are converted to SI. What the log does not say is decided by a stated rule and listed as an
//! [`Assumption`], or refused with the candidates and the mend: a channel is never guessed.
//! `docs/logs.md` lists formats and rules.
//!
//! ```
//! use pid_logs::{Joint, Settings, read, write_folder};
//!
//! let folder = tempfile::tempdir()?;
//! let log = folder.path().join("swing.csv");
//! let rows: String = (0..30).map(|i| format!("{},{},0,0.5,1.5\n", 10 * i, i)).collect();
//! std::fs::write(&log, format!("time_ms,shoulder_pos [deg],elbow_pos [deg],shoulder_torque,elbow_torque\n{rows}"))?;
//!
//! let joints = [Joint::revolute("shoulder"), Joint::revolute("elbow")];
//! let found = read(&[log], &joints, &Settings::default())?;
//! let train = &found.dataset.experiments[0];
//! assert_eq!(train.t[1], 0.01);
//! assert_eq!(train.q[2 * 2], 2.0_f64.to_radians());
//! assert!(found.assumptions.iter().any(|a| a.to_string().contains("unit deg, as stated there")));
//!
//! let data = folder.path().join("data");
//! write_folder(&found, &data)?;
//! let again = pid_data::Dataset::read(&data)?;
//! assert_eq!(again.experiments, found.dataset.experiments);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod assign;
#[cfg(any(
    feature = "mcap",
    feature = "bag",
    feature = "parquet",
    feature = "npz",
    feature = "mat"
))]
mod budget;
mod error;
mod format;
mod log;
mod map;
mod meaning;
mod names;
mod record;
mod settings;
mod split;
mod units;
mod write;

use std::path::{Path, PathBuf};

use pid_data::{
    Dataset, Experiment, InputHold, InputQuantity, JointChannels, Kind as Origin, Role,
    VelocityKind,
};

pub use error::LogError;
pub use format::{open, parse};
pub use log::{Channel, Clock, Hint, Log, RowWord};
pub use map::{Entry, Kind, read_map};
pub use settings::{Assumption, Joint, Settings};

use assign::{assign, present};
use record::Record;
use settings::Sentences;

/// A data set from logs, and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// The records, in SI units, joints base to tip.
    pub dataset: Dataset,
    /// What the logs do not say, and the rule by which it was decided.
    pub assumptions: Vec<Assumption>,
    /// What is odd or was left out.
    pub warnings: Vec<String>,
    /// Whether there are commanded positions and no input: the robot needs drives that follow them.
    pub targets_alone: bool,
}

/// Reads logs of one robot as one data set. Logs may be of different formats; those of several
/// episodes give several records. `joints` are those of the robot, base to tip.
///
/// # Errors
/// The first thing that is wrong or may mean two things, with file, channel, row and mend; see
/// [`LogError`].
pub fn read(paths: &[PathBuf], joints: &[Joint], settings: &Settings) -> Result<Found, LogError> {
    let mut logs = Vec::new();
    for path in paths {
        logs.extend(open(path)?);
    }
    from_logs(&logs, joints, settings)
}

/// As [`read`], from logs that are open.
///
/// # Errors
/// As [`read`].
pub fn from_logs(logs: &[Log], joints: &[Joint], settings: &Settings) -> Result<Found, LogError> {
    if logs.is_empty() || joints.is_empty() {
        return Err(LogError::Empty {
            file: "logs".to_owned(),
            what: format!("{} logs and {} joints", logs.len(), joints.len()),
            mend: "give at least one log, and a robot with a joint that moves".to_owned(),
        });
    }
    let mut said = Sentences::default();
    let mut odd = Sentences::default();
    let mut records = Vec::new();
    let some = |entry: &&Entry| logs.iter().any(|log| present(log, joints, entry));
    let elsewhere: Vec<Entry> = settings.map.iter().filter(some).cloned().collect();
    let mut quantities: Option<(String, Vec<InputQuantity>)> = None;
    let (mut measured, mut without_input) = (true, Vec::new());
    for log in logs {
        log.notes.iter().for_each(|note| said.say(&log.file, note));
        log.warnings
            .iter()
            .for_each(|warning| odd.say(&log.file, warning));
        let assigned = assign(log, joints, settings, &elsewhere, &mut said)?;
        let record = record::build(log, &assigned, settings, &mut said)?;
        implausible(&record, joints, &mut odd);
        if assigned.no_input {
            without_input.push(&log.file);
        }
        measured &= assigned.input_measured;
        match &quantities {
            None => quantities = Some((log.file.clone(), assigned.quantity)),
            Some((first, known)) => agree(first, known, log, &assigned.quantity)?,
        }
        records.push(record);
    }
    let targets_alone = without_input.len() == logs.len();
    if !targets_alone {
        for file in without_input {
            odd.say(file, "there is no input beside the commanded positions, and other logs have one: leave it out, or name its input");
        }
    }
    let quantities = quantities.map(|(_, q)| q).unwrap_or_default();
    let velocities = velocities(&mut records, joints, &mut odd);
    let hold = hold(settings, measured, &mut said);
    let records = split::split(records, settings, &mut said)?;
    let channels =
        joints
            .iter()
            .zip(&quantities)
            .zip(&velocities)
            .map(|((joint, &input), &velocity)| JointChannels {
                name: joint.name.clone(),
                prismatic: joint.prismatic,
                input,
                input_unit: input.unit().to_owned(),
                velocity,
            });
    let name = settings.name.clone().or_else(|| Some(logs[0].name.clone()));
    let dataset = Dataset {
        name: name.unwrap_or_default(),
        title: format!("Logs of {} joints", joints.len()),
        source: format!("logs: {}", sources(logs)),
        license: "not stated".to_owned(),
        kind: settings.origin.unwrap_or(Origin::Real),
        input_hold: hold,
        joints: channels.collect(),
        experiments: records
            .into_iter()
            .map(|(r, role)| experiment(r, role))
            .collect(),
        warnings: Vec::new(),
    };
    Ok(Found {
        targets_alone,
        ..finish(dataset, said, odd)?
    })
}

/// Passes the data set through its own reader: one place says what a data set must be.
fn finish(dataset: Dataset, said: Sentences, odd: Sentences) -> Result<Found, LogError> {
    let assumptions = said.collected();
    let warnings: Vec<String> = odd.collected().iter().map(ToString::to_string).collect();
    let files = write::files(&dataset, &[], &[]);
    let texts: Vec<(&str, &str)> = files
        .iter()
        .map(|(name, text)| (name.as_str(), text.as_str()))
        .collect();
    let dataset = Dataset::from_embedded(&texts)?;
    Ok(Found {
        dataset,
        assumptions,
        warnings,
        targets_alone: false,
    })
}

/// Writes a data set as `dataset.toml`, with assumptions and warnings as comments, and one CSV file
/// for each record. `Dataset::read` gives the same numbers. The folder is made; files of the same
/// names are replaced.
///
/// # Errors
/// [`LogError::File`].
pub fn write_folder(found: &Found, folder: &Path) -> Result<(), LogError> {
    let fault = |path: &Path| {
        let file = path.display().to_string();
        move |error| LogError::File {
            file,
            action: "written",
            error,
        }
    };
    std::fs::create_dir_all(folder).map_err(fault(folder))?;
    // The manifest comes last: a folder that has it is whole.
    for (name, text) in write::files(&found.dataset, &found.assumptions, &found.warnings)
        .into_iter()
        .rev()
    {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(fault(&path))?;
    }
    Ok(())
}

/// The files of the logs, each once.
fn sources(logs: &[Log]) -> String {
    let mut files: Vec<&str> = logs.iter().map(|l| l.file.as_str()).collect();
    files.dedup();
    files.join(", ")
}

fn agree(
    first: &str,
    known: &[InputQuantity],
    log: &Log,
    found: &[InputQuantity],
) -> Result<(), LogError> {
    match known.iter().zip(found).find(|(a, b)| a != b) {
        None => Ok(()),
        Some((a, b)) => Err(LogError::Disagree {
            first: first.to_owned(),
            second: log.file.clone(),
            what: format!("inputs are a {}, not a {}", b.word(), a.word()),
            mend: "say --input, or read the logs as two data sets",
        }),
    }
}

/// Where velocities come from: measured if every log has them. Others are taken out.
fn velocities(records: &mut [Record], joints: &[Joint], odd: &mut Sentences) -> Vec<VelocityKind> {
    (0..joints.len())
        .map(|j| {
            if records.iter().all(|r| r.v[j].is_some()) {
                return VelocityKind::Measured;
            }
            for record in &mut *records {
                if record.v[j].take().is_some() {
                    let name = &joints[j].name;
                    odd.say(
                        &record.file,
                        format!(
                            "the velocity of joint `{name}` is left out, since another log has none"
                        ),
                    );
                }
            }
            VelocityKind::Absent
        })
        .collect()
}

fn hold(settings: &Settings, measured: bool, said: &mut Sentences) -> InputHold {
    if let Some(hold) = settings.input_hold {
        return hold;
    }
    if measured {
        said.say(
            "",
            "between samples inputs run straight, since they were measured; `--input-hold zero-order` says that they keep their value",
        );
        return InputHold::Linear;
    }
    said.say(
        "",
        "between samples inputs keep their value, as a sampled controller puts them out",
    );
    InputHold::ZeroOrder
}

/// Names angles that are hardly radians.
fn implausible(record: &Record, joints: &[Joint], odd: &mut Sentences) {
    /// Four turns, rad: joints of arms and legs stay below, degrees do not.
    const FAR: f64 = 8.0 * std::f64::consts::PI;
    for (joint, q) in joints.iter().zip(&record.q) {
        let far = q
            .iter()
            .copied()
            .filter(|v| v.is_finite())
            .fold(0.0, |a: f64, v| a.max(v.abs()));
        if !joint.prismatic && far > FAR {
            odd.say(
                &record.file,
                format!("joint `{}` reaches {far:.1} rad: if the log is in degrees, say --map 'q=[deg]'", joint.name),
            );
        }
    }
}

fn experiment(record: Record, role: Role) -> Experiment {
    let nq = record.q.len();
    let rows = record.t.len();
    let by_row = |channels: &[Vec<f64>]| -> Vec<f64> {
        (0..rows * nq)
            .map(|k| channels[k % nq].get(k / nq).copied().unwrap_or(f64::NAN))
            .collect()
    };
    let blank = vec![f64::NAN; rows];
    let velocities: Vec<Vec<f64>> = record
        .v
        .iter()
        .map(|v| v.clone().unwrap_or_else(|| blank.clone()))
        .collect();
    Experiment {
        name: record.name,
        role,
        note: format!("from {}", record.file),
        nq,
        q: by_row(&record.q),
        v: record
            .v
            .iter()
            .any(Option::is_some)
            .then(|| by_row(&velocities)),
        u: by_row(&record.u),
        tau: record.tau.as_deref().map(by_row),
        qref: record.qref.as_deref().map(by_row),
        t: record.t,
        missing: 0,
        gain_factors: Default::default(),
    }
}
