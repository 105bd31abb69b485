//! Arguments of `simtrue export`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::open::{ClassArg, OpenArgs};
use super::parse::positive;
use super::robot::RobotArgs;

/// Arguments of `simtrue export`.
#[derive(Debug, Clone, Args)]
pub(crate) struct ExportArgs {
    /// Robot: an extended.toml that `simtrue diagnose` wrote, a nominal.toml, a URDF or an MJCF.
    #[arg(value_name = "ROBOT")]
    pub(crate) robot: PathBuf,
    /// The simulator, or the language of a feed-forward for firmware.
    #[arg(long, value_enum, value_name = "TARGET")]
    pub(crate) to: TargetArg,
    /// Folder for the files; made if needed.
    #[arg(long, short, value_name = "FOLDER")]
    pub(crate) out: PathBuf,
    /// Step of the simulation, s. By default 5e-4, with position loops 1e-4.
    #[arg(long, value_name = "SECONDS", value_parser = positive)]
    pub(crate) timestep: Option<f64>,
    /// Numbers of `rust` and `c`.
    #[arg(long, value_enum, default_value_t, value_name = "BITS")]
    pub(crate) precision: PrecisionArg,
    /// A diagnosis.json; its magnitudes with deviations go into ranges.json.
    #[arg(long, value_name = "FILE")]
    pub(crate) diagnosis: Option<PathBuf>,
    /// A fit.json; its values with deviations go into ranges.json.
    #[arg(long, value_name = "FILE")]
    pub(crate) fit: Option<PathBuf>,
    /// Where masses and inertias of a robot file come from; says how wide ranges.json is.
    #[arg(long, value_enum, default_value_t, value_name = "CLASS")]
    class: ClassArg,
    #[command(flatten)]
    read: RobotArgs,
}

impl ExportArgs {
    /// How a robot file is read.
    pub(crate) fn open(&self) -> OpenArgs {
        OpenArgs {
            class: self.class,
            ..self.read.open()
        }
    }
}

/// Numbers of firmware.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum PrecisionArg {
    /// 32 bits, as a Cortex-M4F has.
    #[default]
    F32,
    /// 64 bits.
    F64,
}

/// Simulators and firmware.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum TargetArg {
    /// MuJoCo: robot.xml, and a wrapper in Python for what MJCF cannot express.
    Mujoco,
    /// URDF: robot.urdf.
    Urdf,
    /// Isaac Lab: robot.urdf and configurations of its actuators.
    #[value(name = "isaaclab")]
    IsaacLab,
    /// Newton: robot.urdf and its drives.
    Newton,
    /// Better Actuator Models: a file of friction and motor for each turning joint.
    Bam,
    /// Feed-forward in Rust: a crate without std, allocation and panics, a static library with a header.
    Rust,
    /// Feed-forward in C99: a header and a source.
    C,
}
