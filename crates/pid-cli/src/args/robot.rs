//! Arguments of commands that take a robot file without logs.

use clap::Args;

use super::open::OpenArgs;

/// How a robot file is read.
#[derive(Debug, Clone, Default, Args)]
pub(crate) struct RobotArgs {
    /// Joints of a URDF that move; the others are held at zero. By default all.
    #[arg(long, value_name = "J1,J2,…", value_delimiter = ',')]
    joints: Vec<String>,
    /// Masses and inertias that a URDF lacks are guessed from its geometry.
    #[arg(long)]
    guess_inertias: bool,
    /// Inertias that no body can have end the run instead of being mended.
    #[arg(long)]
    strict: bool,
}

impl RobotArgs {
    /// The same as options of opening a robot.
    pub(crate) fn open(&self) -> OpenArgs {
        OpenArgs {
            joints: self.joints.clone(),
            guess_inertias: self.guess_inertias,
            strict: self.strict,
            ..OpenArgs::default()
        }
    }
}
