//! `simtrue export`: a robot with its effects as files of a simulator.

use std::path::{Path, PathBuf};

use pid_simulators::{Options, Results, Target, export};

use crate::args::export::{ExportArgs, TargetArg};
use crate::error::{CliError, make_folder, write};
use crate::open::{read_robot, robot_and_logs};
use crate::output;

/// Writes the files and names them.
pub(crate) fn run(args: &ExportArgs) -> Result<u8, CliError> {
    if robot_and_logs(std::slice::from_ref(&args.robot)).is_none() {
        return Err(CliError::NoRobot {
            path: args.robot.clone(),
        });
    }
    let nominal = read_robot(&args.robot, &args.open())?;
    let (diagnosis, fit) = (read(args.diagnosis.as_ref())?, read(args.fit.as_ref())?);
    let mut options = Options::default();
    options.timestep = args.timestep;
    options.diagnosis = results(&diagnosis);
    options.fit = results(&fit);
    let target = match args.to {
        TargetArg::Mujoco => Target::Mujoco,
        TargetArg::Urdf => Target::Urdf,
    };
    let files = export(&nominal, target, &options)?;
    make_folder(&args.out)?;
    for file in files {
        let path = args.out.join(file.name);
        write(&path, &file.text)?;
        output::print(&format!("{}\n", path.display()));
    }
    Ok(0)
}

/// A file's name and text, if one is given.
type Named = Option<(String, String)>;

fn read(file: Option<&PathBuf>) -> Result<Named, CliError> {
    let text = |path: &PathBuf| -> Result<(String, String), CliError> {
        let text = std::fs::read_to_string(path).map_err(|error| CliError::Read {
            path: path.clone(),
            error,
        })?;
        Ok((Path::display(path).to_string(), text))
    };
    file.map(text).transpose()
}

fn results(file: &Named) -> Option<Results<'_>> {
    file.as_ref().map(|(name, text)| Results { name, text })
}
