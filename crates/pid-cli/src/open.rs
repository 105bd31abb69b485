//! A robot file and its logs as a description and a data set.

use std::path::{Path, PathBuf};

use pid_data::{Dataset, InputQuantity, VelocityKind};
use pid_derive::model::JointKind;
use pid_interpret::nominal::{Nominal, Velocity};
use pid_logs::{Found, Joint, Settings};
use pid_mjcf::Mjcf;
use pid_urdf::{Description, Guess, Missing, Reading};

use crate::args::open::{InputArg, OpenArgs};
use crate::error::{CliError, make_folder, write};
use crate::output;

/// Standard gravity, m/s²; a URDF does not state it.
const GRAVITY: [f64; 3] = [0.0, 0.0, -9.81];

/// A robot with its records.
pub(crate) struct Opened {
    pub(crate) nominal: Nominal,
    pub(crate) dataset: Dataset,
}

/// Paths of a command line as a robot file and its logs, or as folders that hold both.
pub(crate) fn robot_and_logs(paths: &[PathBuf]) -> Option<(&Path, &[PathBuf])> {
    let (first, rest) = paths.split_first()?;
    let robot = ["urdf", "xml", "mjcf", "toml"];
    let kind = first.extension()?.to_str()?.to_ascii_lowercase();
    (first.is_file() && robot.contains(&kind.as_str())).then_some((first, rest))
}

/// Reads a robot file and logs; says what was assumed.
pub(crate) fn open(robot: &Path, logs: &[PathBuf], args: &OpenArgs) -> Result<Opened, CliError> {
    if logs.is_empty() {
        return Err(CliError::NoLog {
            robot: robot.to_owned(),
        });
    }
    let nominal = read_robot(robot, args)?;
    let dataset = match logs {
        [folder] if folder.join("dataset.toml").is_file() => Dataset::read(folder)?,
        _ => from_logs(&nominal, logs, args)?.dataset,
    };
    let dataset = match args.gain.as_slice() {
        [] => dataset,
        gains => dataset.with_input_gains(gains)?,
    };
    let velocities: Vec<Velocity> = dataset
        .joints
        .iter()
        .map(|j| velocity(j.velocity))
        .collect();
    Ok(Opened {
        nominal: match is_description(robot) {
            true => nominal,
            false => nominal.with_velocities(&velocities),
        },
        dataset,
    })
}

fn velocity(kind: VelocityKind) -> Velocity {
    match kind {
        VelocityKind::Measured => Velocity::Measured { noise: None },
        VelocityKind::Derived => Velocity::Derived { filter_hz: None },
        VelocityKind::Absent => Velocity::Absent,
    }
}

fn is_description(robot: &Path) -> bool {
    robot
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("toml"))
}

/// A URDF, an MJCF or a nominal description.
fn read_robot(robot: &Path, args: &OpenArgs) -> Result<Nominal, CliError> {
    if is_description(robot) {
        return Ok(Nominal::read(robot)?);
    }
    let text = std::fs::read_to_string(robot).map_err(|error| CliError::Read {
        path: robot.to_owned(),
        error,
    })?;
    let (mechanism, warnings) = if text.contains("<mujoco") {
        let model = Mjcf::parse(robot, &text)?;
        (model.mechanism, model.warnings)
    } else {
        let mut reading = Reading::default();
        reading.strict = args.strict;
        if args.guess_inertias {
            reading.missing = Missing::Guess(Guess::default());
        }
        if !args.joints.is_empty() {
            reading.moving = Some(args.joints.clone());
        }
        let description = Description::parse_with(robot, &text, &reading)?;
        (description.mechanism(GRAVITY), description.warnings)
    };
    let described = Nominal::of_mechanism(&mechanism, args.class.into())?;
    for warning in &warnings {
        output::message(&format!("warning: {warning}"));
    }
    for assumption in &described.assumptions {
        output::message(&format!("assumed: {assumption}"));
    }
    Ok(described.nominal)
}

/// Logs as records of the joints of a robot.
fn from_logs(nominal: &Nominal, logs: &[PathBuf], args: &OpenArgs) -> Result<Found, CliError> {
    let robot = nominal.robot();
    let prismatic = |name: &str| {
        robot
            .joints
            .iter()
            .find(|j| j.name == name)
            .is_some_and(|j| matches!(j.kind, JointKind::Prismatic(_)))
    };
    let joints: Vec<Joint> = nominal
        .measurement()
        .channels
        .iter()
        .map(|channel| match prismatic(&channel.name) {
            true => Joint::prismatic(&channel.name),
            false => Joint::revolute(&channel.name),
        })
        .collect();
    let mut map = match &args.map_file {
        Some(file) => pid_logs::read_map(file)?,
        None => Vec::new(),
    };
    map.extend(args.map.iter().cloned());
    let settings = Settings {
        map,
        input: args.input.map(|input| match input {
            InputArg::Torque => InputQuantity::Torque,
            InputArg::Current => InputQuantity::Current,
            InputArg::Voltage => InputQuantity::Voltage,
        }),
        passive: args.passive,
        sample_time: args.step,
        test: args.test.clone(),
        ..Settings::default()
    };
    let found = pid_logs::read(logs, &joints, &settings)?;
    for assumption in &found.assumptions {
        output::message(&format!("assumed: {assumption}"));
    }
    for warning in &found.warnings {
        output::message(&format!("warning: {warning}"));
    }
    Ok(found)
}

impl Opened {
    /// Writes dataset.toml, nominal.toml and the records; the folder repeats the run.
    pub(crate) fn write(&self, folder: &Path) -> Result<(), CliError> {
        make_folder(folder)?;
        let found = Found {
            dataset: self.dataset.clone(),
            assumptions: Vec::new(),
            warnings: Vec::new(),
        };
        pid_logs::write_folder(&found, folder)?;
        match self.nominal.to_toml() {
            Some(text) => write(&folder.join("nominal.toml"), &text)?,
            None => output::message(
                "no nominal.toml: it cannot state joints that follow others; name the robot file again",
            ),
        }
        output::message(&format!("written: {}", folder.display()));
        Ok(())
    }
}
