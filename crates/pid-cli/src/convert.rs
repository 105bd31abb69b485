//! `simtrue convert`: a robot file and its logs as a data folder.

use crate::args::open::ConvertArgs;
use crate::error::CliError;
use crate::open::{open, robot_and_logs};

/// Writes the folder.
pub(crate) fn run(args: &ConvertArgs) -> Result<u8, CliError> {
    let Some((robot, logs)) = robot_and_logs(&args.paths) else {
        return Err(CliError::NoRobot {
            path: args.paths[0].clone(),
        });
    };
    open(robot, logs, &args.open)?.write(&args.out)?;
    Ok(0)
}
