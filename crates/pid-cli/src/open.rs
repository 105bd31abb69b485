//! A robot file and its logs as a description and a data set, for the commands and for other front ends.

use std::path::{Path, PathBuf};

use pid_data::{Dataset, InputQuantity, VelocityKind};
use pid_derive::model::JointKind;
use pid_interpret::nominal::{Nominal, Velocity};
use pid_logs::{Found, Joint, Log, Settings};
use pid_mjcf::Mjcf;
use pid_preflight as preflight;
use pid_urdf::{Description, Guess, Missing, Reading};

pub use crate::args::open::{ClassArg, DriveArg, HoldArg, InputArg, OpenArgs};
use crate::error::{CliError, make_folder, write};
use crate::followed::{Stated, followed, targets_alone};
use crate::output;

/// Standard gravity, m/s²; a URDF does not state it.
const GRAVITY: [f64; 3] = [0.0, 0.0, -9.81];

/// What is said of targets that no drive follows.
const UNFOLLOWED: &str = "the logs have commanded positions and no input, and no drive of the robot follows them: the motion has no cause; describe the drive in [drive] of the nominal.toml";

/// What is said of a law of loops that follow nothing.
const NO_TARGETS: &str =
    "--drive is left out: the logs have inputs, or no commanded positions that a loop could follow";

/// A robot or a log that cannot be read; the message has place, value and mend.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct OpenError(Box<CliError>);

impl From<CliError> for OpenError {
    fn from(error: CliError) -> Self {
        Self(Box::new(error))
    }
}

/// A robot of a file, and what reading it told.
#[derive(Debug, Clone)]
pub struct Robot {
    /// Its description.
    pub nominal: Nominal,
    /// Whether the file says what the inputs are and how velocities come about; a URDF or an MJCF
    /// does not.
    pub stated: bool,
    /// What is odd in the file.
    pub warnings: Vec<String>,
    /// What the file does not say, and the rule by which it was decided.
    pub assumptions: Vec<String>,
    /// Loops of the drives that the file states.
    loops: Stated,
    /// The law of loops that the user states.
    law: Option<DriveArg>,
}

/// A robot with its records and what was assumed of them.
pub struct Opened {
    /// The description.
    pub nominal: Nominal,
    /// The records.
    pub records: Found,
}

/// Paths of a command line as a robot file and its logs, or as folders that hold both.
pub(crate) fn robot_and_logs(paths: &[PathBuf]) -> Option<(&Path, &[PathBuf])> {
    let (first, rest) = paths.split_first()?;
    let robot = ["urdf", "xml", "mjcf", "toml"];
    let kind = first.extension()?.to_str()?.to_ascii_lowercase();
    (!first.is_dir() && robot.contains(&kind.as_str())).then_some((first, rest))
}

/// Paths that are no robot file with logs: folders, read as they stand.
pub(crate) fn folders<'p>(
    paths: &'p [PathBuf],
    args: &OpenArgs,
) -> Result<&'p [PathBuf], CliError> {
    if let Some(path) = paths.iter().find(|path| path.is_file()) {
        let path = path.clone();
        return Err(match paths.first() == Some(&path) {
            true => CliError::NoRobot { path },
            false => CliError::NoDataFolder { path },
        });
    }
    match args.stated() {
        Some(option) => Err(CliError::OptionOfLogs { option }),
        None => Ok(paths),
    }
}

/// Reads a robot file and logs; says what was assumed.
pub(crate) fn open(robot: &Path, logs: &[PathBuf], args: &OpenArgs) -> Result<Opened, CliError> {
    if logs.is_empty() {
        return Err(CliError::NoLog {
            robot: robot.to_owned(),
        });
    }
    let robot = read_robot(robot, args)?;
    let records = match logs {
        folders if folders.iter().all(|own| own.join("dataset.toml").is_file()) => {
            with_inputs(as_stated(read_folders(folders, args)?), args)?
        }
        _ => {
            let mut read = Vec::new();
            for path in logs {
                read.extend(pid_logs::open(path)?);
            }
            from_logs(&robot, &read, args)?
        }
    };
    let opened = robot.with(records);
    tell(&opened.records);
    Ok(opened)
}

/// Folders with `dataset.toml` as one; drives that are off by a rule are so before, since their inputs do not count.
fn read_folders(folders: &[PathBuf], args: &OpenArgs) -> Result<Dataset, CliError> {
    let all = folders.iter().map(|folder| Dataset::read(folder));
    let mut all = all.collect::<Result<Vec<_>, _>>()?;
    Dataset::set_gain_factors(&mut all, &args.gain_factor)?;
    let first = all.remove(0);
    Ok(first.merged(all)?)
}

/// A data set that states everything itself.
pub(crate) fn as_stated(dataset: Dataset) -> Found {
    Found {
        targets_alone: targets_alone(&dataset),
        dataset,
        assumptions: Vec::new(),
        warnings: Vec::new(),
    }
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

/// A URDF, an MJCF or a nominal description; says what was assumed.
pub(crate) fn read_robot(file: &Path, args: &OpenArgs) -> Result<Robot, CliError> {
    let robot = robot_of(file, args)?;
    for warning in &robot.warnings {
        output::message(&format!("warning: {warning}"));
    }
    for assumption in &robot.assumptions {
        output::message(&format!("assumed: {assumption}"));
    }
    Ok(robot)
}

fn robot_of(file: &Path, args: &OpenArgs) -> Result<Robot, CliError> {
    if is_description(file) {
        return match args.drive {
            Some(_) => Err(CliError::DriveOfDescription),
            None => Ok(Robot::described(Nominal::read(file)?)),
        };
    }
    let text = std::fs::read_to_string(file).map_err(|error| CliError::Read {
        path: file.to_owned(),
        error,
    })?;
    let mut loops = Stated::default();
    let (mechanism, warnings) = if text.contains("<mujoco") {
        let model = Mjcf::parse(file, &text)?;
        loops = Stated::of(&model);
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
        let description = Description::parse_with(file, &text, &reading)?;
        (description.mechanism(GRAVITY), description.warnings)
    };
    let described = Nominal::of_mechanism(&mechanism, args.class.into())?;
    Ok(Robot {
        nominal: described.nominal,
        stated: false,
        warnings: warnings.iter().map(ToString::to_string).collect(),
        assumptions: (described.assumptions.iter())
            .map(ToString::to_string)
            .collect(),
        loops,
        law: args.drive,
    })
}

impl Robot {
    /// Reads a URDF, an MJCF or a nominal description, by the ending `.toml` and by content.
    ///
    /// # Errors
    /// [`OpenError`]: a file that cannot be read, or that is no robot.
    pub fn read(file: &Path, args: &OpenArgs) -> Result<Self, OpenError> {
        Ok(robot_of(file, args)?)
    }

    /// Of a description.
    pub fn described(nominal: Nominal) -> Self {
        Self {
            nominal,
            stated: true,
            warnings: Vec::new(),
            assumptions: Vec::new(),
            loops: Stated::default(),
            law: None,
        }
    }

    /// Its joints, base to tip, as logs name them.
    pub fn joints(&self) -> Vec<Joint> {
        let robot = self.nominal.robot();
        let of_name = |name: &str| robot.joints.iter().find(|j| j.name == name);
        let slides = |name: &str| {
            of_name(name)
                .is_some_and(|j| matches!(j.kind, JointKind::Prismatic(_) | JointKind::Length))
        };
        let channels = self.nominal.measurement().channels.iter().enumerate();
        channels
            .map(|(k, channel)| Joint {
                name: channel.name.clone(),
                prismatic: slides(&channel.name),
                // A robot file with unit gains does not say what its logs hold.
                input: match self.stated {
                    true => robot.inputs.get(k).and_then(|input| quantity(&input.unit)),
                    false => None,
                },
            })
            .collect()
    }

    /// Logs as records of its joints.
    ///
    /// # Errors
    /// [`OpenError`]: the first thing that is wrong or may mean two things.
    pub fn records(&self, logs: &[Log], args: &OpenArgs) -> Result<Found, OpenError> {
        Ok(from_logs(self, logs, args)?)
    }

    /// A folder with `dataset.toml` as records of its joints.
    ///
    /// # Errors
    /// [`OpenError`]: the first thing that is wrong.
    pub fn folder(&self, folder: &Path, args: &OpenArgs) -> Result<Found, OpenError> {
        let dataset = Dataset::read(folder).map_err(CliError::from)?;
        Ok(with_inputs(as_stated(dataset), args)?)
    }

    /// With its records; a robot file takes from them how velocities come about, and has drives that follow
    /// commanded positions where these are all that is commanded.
    pub fn with(self, mut records: Found) -> Opened {
        let velocities: Vec<Velocity> = (records.dataset)
            .joints
            .iter()
            .map(|j| velocity(j.velocity))
            .collect();
        let mut nominal = match self.stated {
            true => self.nominal,
            false => self.nominal.with_velocities(&velocities),
        };
        if !self.stated && records.targets_alone {
            let assumed;
            (nominal, assumed) = followed(nominal, &self.loops, self.law);
            records.assumptions.extend(assumed);
        }
        if self.law.is_some() && !records.targets_alone {
            records.warnings.push(NO_TARGETS.to_owned());
        }
        if records.targets_alone && !nominal.has_servos() {
            records.warnings.push(UNFOLLOWED.to_owned());
        }
        Opened { nominal, records }
    }
}

/// Records with their inputs as torques or forces, where gains are given, and between samples as is stated.
fn with_inputs(mut records: Found, args: &OpenArgs) -> Result<Found, CliError> {
    if let Some(hold) = args.input_hold {
        records.dataset.input_hold = hold.into();
    }
    if !args.gain.is_empty() {
        records.dataset = records.dataset.with_input_gains(&args.gain)?;
    }
    if args.targets {
        records.dataset = records.dataset.with_targets()?;
        records.targets_alone = true;
    }
    records.dataset = records.dataset.with_gain_factors(&args.gain_factor)?;
    Ok(records)
}

/// The quantity of an input of this unit.
fn quantity(unit: &str) -> Option<InputQuantity> {
    match unit {
        "N*m" => Some(InputQuantity::Torque),
        "N" => Some(InputQuantity::Force),
        "A" => Some(InputQuantity::Current),
        "V" => Some(InputQuantity::Voltage),
        _ => None,
    }
}

/// Logs as records of the joints of a robot.
fn from_logs(robot: &Robot, logs: &[Log], args: &OpenArgs) -> Result<Found, CliError> {
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
        input_hold: args.input_hold.map(Into::into),
        passive: args.passive,
        sample_time: args.sample_time,
        test: args.test.clone(),
        whole: args.whole,
        ..Settings::default()
    };
    with_inputs(pid_logs::from_logs(logs, &robot.joints(), &settings)?, args)
}

/// Says what was assumed of logs.
fn tell(found: &Found) {
    for assumption in &found.assumptions {
        output::message(&format!("assumed: {assumption}"));
    }
    for warning in &found.warnings {
        output::message(&format!("warning: {warning}"));
    }
}

impl Opened {
    /// Writes dataset.toml, nominal.toml and the records; the folder repeats the run.
    pub(crate) fn write(&self, folder: &Path) -> Result<(), CliError> {
        if !self.put(folder)? {
            output::message(
                "no nominal.toml: it cannot state joints that follow others; name the robot file again",
            );
        }
        output::message(&format!("written: {}", folder.display()));
        Ok(())
    }

    /// Writes dataset.toml, nominal.toml and the records. Whether nominal.toml is there: it cannot
    /// state joints that follow others.
    ///
    /// # Errors
    /// [`OpenError`]: a file that cannot be written.
    pub fn save(&self, folder: &Path) -> Result<bool, OpenError> {
        Ok(self.put(folder)?)
    }

    fn put(&self, folder: &Path) -> Result<bool, CliError> {
        make_folder(folder)?;
        pid_logs::write_folder(&self.records, folder)?;
        let text = self.nominal.to_toml();
        if let Some(text) = &text {
            write(&folder.join("nominal.toml"), text)?;
        }
        Ok(text.is_some())
    }
}

/// What contradicts the robot or itself, for a run that follows.
pub fn wrong(opened: &Opened) -> Vec<preflight::Finding> {
    let settings = preflight::Settings {
        determinable: false,
        ..preflight::Settings::default()
    };
    let mut findings = preflight::check(&opened.records.dataset, &opened.nominal, &settings);
    findings.retain(|f| f.severity == preflight::Severity::Wrong);
    findings
}

#[cfg(test)]
mod tests {
    use pid_data::InputHold;

    use super::*;
    use crate::args::open::OpenArgs;
    use crate::samples::{ARM, swing};

    #[test]
    fn a_urdf_and_a_log_become_a_folder_that_repeats_the_run() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("arm.urdf"), ARM).expect("written");
        std::fs::write(at("a.csv"), swing()).expect("written");
        std::fs::write(at("b.csv"), swing()).expect("written");
        let paths = [at("arm.urdf"), at("a.csv"), at("b.csv")];
        let (robot, logs) = robot_and_logs(&paths).expect("a robot file first");
        let opened = open(robot, logs, &OpenArgs::default()).expect("a robot with records");
        let record = &opened.records.dataset.experiments[0];
        assert!(
            (record.t[1] - record.t[0] - 1e-3).abs() < 1e-12 && (record.q[0] - 1.0).abs() < 1e-9
        );
        assert_eq!(
            opened.nominal.measurement().channels[0].velocity,
            Velocity::Absent,
            "the log has no velocity"
        );
        opened.write(&at("data")).expect("written");
        let again = Dataset::read(&at("data")).expect("a data set");
        assert_eq!(again.experiments, opened.records.dataset.experiments);
        let nominal = Nominal::read(at("data/nominal.toml")).expect("a description");
        assert_eq!(nominal.robot().params, opened.nominal.robot().params);
        assert!(wrong(&opened).is_empty());
        let text = std::fs::read_to_string(at("data/dataset.toml")).expect("a manifest");
        for assumption in &opened.records.assumptions {
            let line = assumption.to_string();
            let first = line.lines().next().unwrap_or_default();
            assert!(text.contains(first), "{first} in {text}");
        }
        assert!(!opened.records.assumptions.is_empty());
    }

    #[test]
    fn what_belongs_to_logs_or_to_folders_is_told() {
        let folder = tempfile::tempdir().expect("a folder");
        let log = folder.path().join("a.csv");
        std::fs::write(&log, "t,q\n").expect("written");
        let one = folder.path().to_owned();
        let none = OpenArgs::default();
        let told = |paths: &[PathBuf], args: &OpenArgs| {
            folders(paths, args).err().map(|error| error.to_string())
        };
        assert_eq!(told(std::slice::from_ref(&one), &none), None);
        let first = told(std::slice::from_ref(&log), &none).expect("a log is no robot");
        assert!(first.contains("no robot file"), "{first}");
        let later = told(&[one.clone(), log], &none).expect("a log is no folder");
        assert!(later.contains("no folder"), "{later}");
        let gains = OpenArgs {
            gain: vec![2.0],
            ..none
        };
        let option = told(&[one], &gains).expect("an option of logs");
        assert!(option.starts_with("--gain"), "{option}");
    }

    /// The word of the option counts for logs, and for a folder that says something else.
    #[test]
    fn what_inputs_do_between_samples_can_be_stated() {
        let folder = tempfile::tempdir().expect("a folder");
        crate::samples::written(folder.path());
        let at = |name: &str| folder.path().join(name);
        let held = |log: &str, input_hold| {
            let args = OpenArgs {
                input_hold,
                ..OpenArgs::default()
            };
            let opened = open(&at("arm.urdf"), &[at(log)], &args).expect("records");
            opened.write(&at("data")).expect("written");
            opened.records.dataset.input_hold
        };
        let (kept, straight) = (InputHold::ZeroOrder, InputHold::Linear);
        assert_eq!(held("a.csv", None), kept, "an effort may be commanded");
        assert_eq!(held("a.csv", Some(HoldArg::Linear)), straight);
        assert_eq!(held("data", None), straight, "as written");
        assert_eq!(held("data", Some(HoldArg::ZeroOrder)), kept);
    }

    #[test]
    fn folders_are_no_robot_files_and_a_robot_needs_a_log() {
        let folder = tempfile::tempdir().expect("a folder");
        let robot = folder.path().join("arm.urdf");
        std::fs::write(&robot, ARM).expect("written");
        assert!(robot_and_logs(&[folder.path().to_owned()]).is_none());
        let error = open(&robot, &[], &OpenArgs::default())
            .err()
            .expect("no log");
        assert!(error.to_string().contains("without a log"), "{error}");
    }

    /// Degrees that call themselves radians contradict the robot.
    #[test]
    fn records_that_contradict_the_robot_are_told() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("arm.urdf"), ARM).expect("written");
        let text = swing().replace("[deg]", "[rad]");
        std::fs::write(at("a.csv"), &text).expect("written");
        std::fs::write(at("b.csv"), text).expect("written");
        let logs = [at("a.csv"), at("b.csv")];
        let opened = open(&at("arm.urdf"), &logs, &OpenArgs::default()).expect("records");
        let wrong = wrong(&opened);
        assert!(wrong.iter().any(|f| f.kind.name() == "unit"), "{wrong:?}");
    }
}
