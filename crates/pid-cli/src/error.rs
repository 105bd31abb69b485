//! Errors that end a command.

use std::io;
use std::path::{Path, PathBuf};

use pid_data::{ChangeError, DataError};
use pid_diagnose::case::CaseError;
use pid_diagnose::report::WriteError;
use pid_diagnose::with_effects::{AssembleError, EffectError};
use pid_diagnose::write::write_whole;
use pid_fit::excite::ExciteError;
use pid_fit::ident::assumptions::AssumptionsError;
use pid_fit::identify::IdentifyError;
use pid_fit::integrate::SimulateError;
use pid_fit::regress::RegressError;
use pid_fit::wrap::controllers::ControlError;
use pid_fit::wrap::lag::LagError;
use pid_fit::wrap::private::PrivateError;
use pid_interpret::nominal::NominalError;
use pid_models::UnknownModel;
use pid_report::{JudgeError, ReportError};
use pid_runtime::extend::ExtendError;
use pid_urdf::UrdfError;

use crate::limits::LimitsError;
use crate::parameters::ParameterFileError;

/// An error of the command line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub(crate) enum CliError {
    #[error(transparent)]
    Model(#[from] UnknownModel),
    #[error(transparent)]
    Urdf(#[from] UrdfError),
    #[error(transparent)]
    Interpret(#[from] pid_interpret::Error),
    #[error(transparent)]
    Mjcf(Box<pid_mjcf::MjcfError>),
    #[error(transparent)]
    Log(Box<pid_logs::LogError>),
    #[error(
        "the records have targets of position loops and no inputs of the motors, which a regression needs\n  help: `simtrue identify` and `simtrue diagnose` take targets; a column u1 … of motor torques or currents makes a regression possible"
    )]
    OnlyTargets,
    #[error(
        "{}: the robot is given without a log\n  help: name the logs after it, or a folder with dataset.toml", robot.display()
    )]
    NoLog { robot: PathBuf },
    #[error(
        "{number} findings contradict the robot\n  help: `simtrue check ROBOT LOG --fix FOLDER` mends what can be mended safely; --anyway goes on with the records as they are"
    )]
    Contradicts { number: usize },
    #[error(
        "{}: no robot file\n  help: the first path is a URDF (.urdf), an MJCF (.xml) or a nominal.toml, those after it are logs", path.display()
    )]
    NoRobot { path: PathBuf },
    #[error(
        "{}: no folder; several paths are folders with dataset.toml and nominal.toml\n  help: a robot file (.urdf, .xml or .toml) with logs stands first", path.display()
    )]
    NoDataFolder { path: PathBuf },
    #[error(
        "{option} says how logs are read, and folders are given\n  help: leave it out, or give a robot file and its logs"
    )]
    OptionOfLogs { option: &'static str },
    #[error(
        "--drive is for robot files without loops of their drives, and a nominal.toml is given\n  help: leave it out, and state the loop in [drive] of that file"
    )]
    DriveOfDescription,
    #[error(
        "{option} belongs to folders, and a robot file with logs is given\n  help: leave it out; the robot file is the description"
    )]
    OptionOfFolders { option: &'static str },
    #[error(
        "{option} belongs to a declared model, and a robot file with logs is given\n  help: leave it out; `simtrue convert ROBOT LOG` makes a data folder for the commands with MODEL FOLDER"
    )]
    OptionOfModels { option: &'static str },
    #[error(
        "{}: a model and its data folder stand alone, and {number} paths are given\n  help: MODEL FOLDER, or ROBOT LOG… with a robot file (.urdf, .xml, .toml) first; further folders with --also", path.display()
    )]
    TooManyPaths { path: PathBuf, number: usize },
    #[error("{}: the folder is not empty\n  help: choose another name", path.display())]
    NotEmpty { path: PathBuf },
    #[error(
        "`{name}` is no name of a crate\n  help: use letters, digits, `_` and `-`, a letter first, and no keyword of Rust"
    )]
    CrateName { name: String },
    #[error("--fix writes one folder, and {number} are given\n  help: mend one folder at a time")]
    FixOfSeveral { number: usize },
    #[error(
        "there is no command `{word}`, did you mean `{nearest}`?\n  help: simtrue --help lists the commands"
    )]
    NoCommand { word: String, nearest: String },
    #[error(
        "`{model}` is given without a data folder\n  help: give the folder with dataset.toml after it"
    )]
    NoFolder { model: String },
    #[error(
        "{}: the folder has no nominal.toml, so no robot is named\n  help: name the robot file or the model before it", path.display()
    )]
    NoDescription { path: PathBuf },
    #[error(
        "model `{model}` and a description by --urdf or --nominal are given\n  help: leave one of them out"
    )]
    TwoModels { model: String },
    #[error(transparent)]
    Data(#[from] DataError),
    #[error(transparent)]
    Change(#[from] ChangeError),
    #[error(transparent)]
    Parameters(#[from] ParameterFileError),
    #[error(transparent)]
    Judge(#[from] JudgeError),
    #[error(transparent)]
    Simulate(#[from] SimulateError),
    #[error(transparent)]
    Report(#[from] ReportError),
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    #[error(transparent)]
    Extend(#[from] ExtendError),
    #[error(transparent)]
    Regress(#[from] RegressError),
    #[error(transparent)]
    Control(#[from] ControlError),
    #[error(transparent)]
    Private(#[from] PrivateError),
    #[error(transparent)]
    Lag(#[from] LagError),
    #[error(
        "--velocity-lag needs motions to be simulated\n  help: use `simtrue identify` with full discretization or shooting, or `simtrue simulate`"
    )]
    LagOfRegression,
    #[error(
        "--with {term}: friction with a memory needs a state that this command does not simulate\n  help: `simtrue regress` has it from the recorded positions; `simtrue diagnose` simulates it (`presliding_hysteresis`)"
    )]
    Memory { term: String },
    #[error(transparent)]
    Effect(#[from] EffectError),
    #[error(
        "--with {effect}: the effect is not linear in a coefficient\n  help: `simtrue identify` takes it; regressions take {laws}"
    )]
    NoLinearForm { effect: String, laws: String },
    #[error("--with {effect}:{joint}: the model has no joint `{joint}`; its joints are {joints}")]
    NoJoint {
        effect: String,
        joint: String,
        joints: String,
    },
    #[error("--velocity-lag needs one of the models that `simtrue models` lists")]
    LagOfFile,
    #[error("--private needs one of the models that `simtrue models` lists")]
    PrivateOfFile,
    #[error(
        "instrumental variables simulate the closed loop of the records\n  help: describe it in a file and give it with --controller (docs/controller-format.md)"
    )]
    NoController,
    #[error(transparent)]
    Assumptions(#[from] AssumptionsError),
    #[error(transparent)]
    Nominal(#[from] NominalError),
    #[error(
        "{option}: the model has no parameter `{name}`\n  help: the report lists the model's parameters"
    )]
    NoParameter { option: &'static str, name: String },
    #[error("--constrain \"{text}\": {reason}")]
    Constraint { text: String, reason: String },
    #[error(
        "{}: no diagnosis of this version: {error}\n  help: diagnose again with --again", path.display()
    )]
    Earlier {
        path: PathBuf,
        error: serde_json::Error,
    },
    #[error("the result cannot be written as JSON: {0}")]
    Json(serde_json::Error),
    #[error("{}: {error}", path.display())]
    Dump {
        path: PathBuf,
        error: pid_codegen::show::Error,
    },
    #[error(transparent)]
    Excite(#[from] ExciteError),
    #[error(transparent)]
    Export(#[from] pid_simulators::ExportError),
    #[error(transparent)]
    Firmware(#[from] pid_firmware::FirmwareError),
    #[error(transparent)]
    Fleet(#[from] pid_fleet::FleetError),
    #[error(
        "no nominal.toml can state this robot, and a fleet is described by one\n  help: robots with followers or drives on several joints are identified one by one: `simtrue identify`"
    )]
    FleetRobot,
    #[error("fleet.toml, reading: {0}\n  help: plan the fleet again")]
    FleetReading(String),
    #[error(
        "none of {number} logs can be read as one of the robot\n  help: `simtrue check ROBOT LOG` says what is wrong with one"
    )]
    FleetNoLog { number: usize },
    #[error(
        "--job {job}: the fleet has {jobs} logs, from 0\n  help: the lines of jobs.csv, the head left out"
    )]
    FleetJob { job: usize, jobs: usize },
    #[error(transparent)]
    Limits(#[from] LimitsError),
    #[error("{}: cannot be read: {error}\n  help: check the path; it is taken from the folder in which the command runs", path.display())]
    Read { path: PathBuf, error: io::Error },
    #[error("{}: no robot named `{name}`; the file has {found}", path.display())]
    NoSuchRobot {
        path: PathBuf,
        name: String,
        found: String,
    },
    #[error("{source}")]
    Case {
        #[from]
        source: CaseError,
    },
    #[error("{source}\n  help: choose another folder with --out")]
    Diagnosis {
        #[from]
        source: WriteError,
    },
    #[error("{}: cannot be written: {error}\n  help: choose another folder with --out", path.display())]
    Write { path: PathBuf, error: io::Error },
}

impl From<pid_mjcf::MjcfError> for CliError {
    fn from(error: pid_mjcf::MjcfError) -> Self {
        Self::Mjcf(Box::new(error))
    }
}

impl From<pid_logs::LogError> for CliError {
    fn from(error: pid_logs::LogError) -> Self {
        Self::Log(Box::new(error))
    }
}

/// Writes a file whole or not at all and names it in the error.
pub(crate) fn write(path: &Path, text: &str) -> Result<(), CliError> {
    write_whole(path, text).map_err(|error| CliError::Write {
        path: path.to_owned(),
        error,
    })
}

/// Makes a folder and names it in the error.
pub(crate) fn make_folder(path: &Path) -> Result<(), CliError> {
    std::fs::create_dir_all(path).map_err(|error| CliError::Write {
        path: path.to_owned(),
        error,
    })
}

impl From<AssembleError> for CliError {
    fn from(error: AssembleError) -> Self {
        match error {
            AssembleError::Nominal(error) => error.into(),
            AssembleError::Model(error) => error.into(),
            AssembleError::Effect(error) => error.into(),
            AssembleError::Lag(error) => error.into(),
        }
    }
}
