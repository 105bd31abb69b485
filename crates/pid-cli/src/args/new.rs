//! Arguments of `simtrue new`.

use std::path::PathBuf;

use clap::Args;

use super::open::OpenArgs;

/// Arguments of `simtrue new`.
#[derive(Debug, Clone, Args)]
pub(crate) struct NewArgs {
    /// Folder to make; its last part is the name of the crate and of the robot in it.
    #[arg(value_name = "NAME")]
    pub(crate) path: PathBuf,
    /// Robot file (URDF, MJCF or nominal.toml) and its logs: the folder gets nominal.toml, dataset.toml
    /// and the records, for `identify` and `diagnose`. Without it: a crate with a declared robot.
    #[arg(long, num_args = 2.., value_name = "ROBOT LOG")]
    pub(crate) from: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) open: OpenArgs,
    /// Go on although the logs contradict the robot (`simtrue check` says how).
    #[arg(long, requires = "from")]
    pub(crate) anyway: bool,
    /// Folder of the crate `simtrue`, for the new crate; by default that of the source tree of this
    /// program, or the registry where there is none.
    #[arg(long, value_name = "FOLDER", conflicts_with = "from")]
    pub(crate) simtrue: Option<PathBuf>,
}
