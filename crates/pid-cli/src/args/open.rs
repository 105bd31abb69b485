//! Arguments of commands that open a robot file and logs.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use pid_data::{GainRule, InputHold};
use pid_interpret::nominal::{Provenance, ServoLaw};
use pid_logs::Entry;

use super::parse::{finite, positive};

/// How a robot file and logs are read.
#[derive(Debug, Clone, Default, Args)]
pub struct OpenArgs {
    /// Column of the log by hand: `KIND:JOINT=COLUMN[UNIT]`, such as `q:elbow=/js/elbow/pos[deg]`,
    /// `q=[deg]` for a unit alone; may be repeated (docs/logs.md).
    #[arg(long, value_name = "ENTRY", value_parser = entry)]
    pub map: Vec<Entry>,
    /// TOML file of such entries.
    #[arg(long, value_name = "FILE")]
    pub map_file: Option<PathBuf>,
    /// What the inputs of the log are, where their names and units do not say it.
    #[arg(long, value_enum, value_name = "QUANTITY")]
    pub input: Option<InputArg>,
    /// Factors from the inputs to the torque or force at the joints, one per joint (N·m/A for
    /// currents); the inputs then count as torques or forces.
    #[arg(long, visible_alias = "input-gain", value_name = "K1,K2,…", value_delimiter = ',', value_parser = finite)]
    pub gain: Vec<f64>,
    /// What the inputs do between samples, whatever the data say: readings run straight (linear), commands
    /// keep their value (zero-order). By default measured inputs run straight and all others keep theirs.
    #[arg(long, value_enum, value_name = "HOLD")]
    pub input_hold: Option<HoldArg>,
    /// The commanded positions are the inputs, behind the position loops of the drives: recorded inputs of the motors
    /// are left out. `simtrue diagnose` does so wherever a drive has a loop.
    #[arg(long)]
    pub targets: bool,
    /// How many times a gain of the position loops acts in some records: `RECORD=GAIN:FACTOR`, such as
    /// `*_kp400=kp:4`; `*` stands for any characters, several factors are one per joint. `drop_*=off`: the drives are
    /// off in these records. May be repeated.
    #[arg(long, value_name = "RULE")]
    pub gain_factor: Vec<GainRule>,
    /// No joint is driven: the inputs are zero.
    #[arg(long)]
    pub passive: bool,
    /// Law of the loops by which the drives of a robot file follow the commanded positions of a log without an
    /// input. By default that of the robot file, or `pd`; the gains that it does not state are unknown.
    #[arg(long, value_enum, value_name = "LAW")]
    pub drive: Option<DriveArg>,
    /// Log to judge with; may be repeated. By default the last quarter of several logs, or the last
    /// third of a single one.
    #[arg(long, value_name = "NAME")]
    pub test: Vec<String>,
    /// Step of logs without times, s.
    #[arg(long, value_name = "SECONDS", value_parser = positive)]
    pub sample_time: Option<f64>,
    /// Where masses and inertias of the robot file come from; says how far they are trusted.
    #[arg(long, value_enum, default_value_t, value_name = "CLASS")]
    pub class: ClassArg,
    /// Joints of the robot file that move; the others are held at zero. By default all.
    #[arg(long, value_name = "J1,J2,…", value_delimiter = ',')]
    pub joints: Vec<String>,
    /// Masses and inertias that a URDF lacks are guessed from its geometry.
    #[arg(long)]
    pub guess_inertias: bool,
    /// Inertias that no body can have end the run instead of being mended.
    #[arg(long)]
    pub strict: bool,
    /// A single log is not parted into one to fit on and one to judge with.
    #[arg(skip)]
    pub whole: bool,
}

impl OpenArgs {
    /// The first option that is stated; all of them say how a robot file or logs are read.
    pub(crate) fn stated(&self) -> Option<&'static str> {
        let gain = (!self.gain.is_empty()).then_some("--gain");
        let hold = self.input_hold.is_some().then_some("--input-hold");
        self.stated_of_logs().or(gain).or(hold)
    }

    /// The same without what inputs of declared models have too: gains, and what they do between samples.
    pub(crate) fn stated_of_logs(&self) -> Option<&'static str> {
        let all = [
            ("--map", !self.map.is_empty()),
            ("--map-file", self.map_file.is_some()),
            ("--input", self.input.is_some()),
            ("--passive", self.passive),
            ("--drive", self.drive.is_some()),
            ("--targets", self.targets),
            ("--gain-factor", !self.gain_factor.is_empty()),
            ("--test", !self.test.is_empty()),
            ("--sample-time", self.sample_time.is_some()),
            ("--class", self.class != ClassArg::default()),
            ("--joints", !self.joints.is_empty()),
            ("--guess-inertias", self.guess_inertias),
            ("--strict", self.strict),
        ];
        all.iter().find(|(_, is)| *is).map(|(option, _)| *option)
    }
}

fn entry(text: &str) -> Result<Entry, String> {
    Entry::parse(text).map_err(|e| e.to_string())
}

/// Quantities of inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum InputArg {
    /// Torque at the joint, N·m; force where it slides.
    Torque,
    /// Current, A.
    Current,
    /// Voltage, V.
    Voltage,
}

/// What inputs do between samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum HoldArg {
    /// They keep their value, as commands do.
    ZeroOrder,
    /// They run straight, as readings do.
    Linear,
}

impl From<HoldArg> for InputHold {
    fn from(hold: HoldArg) -> Self {
        match hold {
            HoldArg::ZeroOrder => InputHold::ZeroOrder,
            HoldArg::Linear => InputHold::Linear,
        }
    }
}

/// Laws of position loops.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum DriveArg {
    /// Proportional.
    P,
    /// Proportional, with damping by the velocity.
    Pd,
    /// The same with an integral of the error.
    Pid,
    /// A loop of the position around one of the velocity.
    Cascade,
    /// No loop: the drives are off.
    None,
}

impl DriveArg {
    /// The law; `None` without a loop.
    pub(crate) fn law(self) -> Option<ServoLaw> {
        match self {
            DriveArg::P => Some(ServoLaw::P),
            DriveArg::Pd => Some(ServoLaw::Pd),
            DriveArg::Pid => Some(ServoLaw::Pid),
            DriveArg::Cascade => Some(ServoLaw::Cascade),
            DriveArg::None => None,
        }
    }
}

/// Origins of masses and inertias.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum ClassArg {
    /// A CAD model: mass within 5 %.
    #[default]
    Cad,
    /// A data sheet: mass within 20 %.
    DataSheet,
    /// A guess: mass within a factor of two.
    Guessed,
}

impl From<ClassArg> for Provenance {
    fn from(class: ClassArg) -> Self {
        match class {
            ClassArg::Cad => Provenance::Cad,
            ClassArg::DataSheet => Provenance::DataSheet,
            ClassArg::Guessed => Provenance::Guessed,
        }
    }
}

/// Arguments of `simtrue check`.
#[derive(Debug, Clone, Args)]
pub(crate) struct CheckArgs {
    /// Robot file (URDF, MJCF or nominal.toml) and its logs, or folders with dataset.toml and
    /// nominal.toml.
    #[arg(required = true, value_name = "ROBOT LOG")]
    pub(crate) paths: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) open: OpenArgs,
    /// Write the records with what can be mended safely mended into this folder.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) fix: Option<PathBuf>,
    /// Print the findings as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Arguments of `simtrue convert`.
#[derive(Debug, Clone, Args)]
pub(crate) struct ConvertArgs {
    /// Robot file (URDF, MJCF or nominal.toml) and its logs.
    #[arg(required = true, num_args = 2.., value_name = "ROBOT LOG")]
    pub(crate) paths: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) open: OpenArgs,
    /// Folder for dataset.toml, nominal.toml and the records as CSV files.
    #[arg(long, short, value_name = "FOLDER")]
    pub(crate) out: PathBuf,
}
