//! `simtrue export`: a robot with its effects as files of a simulator or as firmware.

use std::path::{Path, PathBuf};

use pid_firmware::{Precision, Target as Language};
use pid_interpret::nominal::Nominal;
use pid_simulators::{Options, Results, Target, export};

use crate::args::export::{ExportArgs, PrecisionArg, TargetArg};
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
    let nominal = read_robot(&args.robot, &args.open())?.nominal;
    let files = files(&nominal, args)?;
    make_folder(&args.out)?;
    for (name, text) in files {
        let path = args.out.join(name);
        if let Some(folder) = path.parent() {
            make_folder(folder)?;
        }
        write(&path, &text)?;
        output::print(&format!("{}\n", path.display()));
    }
    Ok(0)
}

/// Names and texts of the files.
fn files(nominal: &Nominal, args: &ExportArgs) -> Result<Vec<(String, String)>, CliError> {
    let target = match args.to {
        TargetArg::Mujoco => Target::Mujoco,
        TargetArg::Urdf => Target::Urdf,
        TargetArg::IsaacLab => Target::IsaacLab,
        TargetArg::Newton => Target::Newton,
        TargetArg::Bam => Target::Bam,
        TargetArg::Rust => return firmware(nominal, Language::Rust, args.precision),
        TargetArg::C => return firmware(nominal, Language::C, args.precision),
    };
    let (diagnosis, fit) = (read(args.diagnosis.as_ref())?, read(args.fit.as_ref())?);
    let mut options = Options::default();
    options.timestep = args.timestep;
    options.diagnosis = results(&diagnosis);
    options.fit = results(&fit);
    let files = export(nominal, target, &options)?.into_iter();
    Ok(files.map(|f| (f.name.into_owned(), f.text)).collect())
}

/// The same of firmware.
fn firmware(
    nominal: &Nominal,
    language: Language,
    precision: PrecisionArg,
) -> Result<Vec<(String, String)>, CliError> {
    let mut options = pid_firmware::Options::default();
    options.precision = match precision {
        PrecisionArg::F32 => Precision::F32,
        PrecisionArg::F64 => Precision::F64,
    };
    let files = pid_firmware::export(nominal, language, &options)?.into_iter();
    Ok(files.map(|f| (f.name, f.text)).collect())
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

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::run;
    use crate::args::{Cli, Command};

    const CART: &str = r#"<robot name="cart"><link name="rail"/><link name="cart"><inertial><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1"/></inertial></link><joint name="x" type="prismatic"><parent link="rail"/>
<child link="cart"/><axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="80" velocity="2"/></joint></robot>"#;

    fn exported(folder: &std::path::Path, robot: &str, target: &str) -> Result<u8, String> {
        let path = |name: &str| folder.join(name).display().to_string();
        let words = [
            "simtrue",
            "export",
            &path(robot),
            "--to",
            target,
            "--out",
            &path(target),
        ];
        let cli = Cli::try_parse_from(words).map_err(|e| e.to_string())?;
        let Some(Command::Export(args)) = cli.command else {
            return Err("another command".to_owned());
        };
        run(&args).map_err(|e| e.to_string())
    }

    #[test]
    fn a_urdf_becomes_files_of_every_simulator() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("cart.urdf"), CART).expect("written");
        for (target, files) in [
            (
                "mujoco",
                &["robot.xml", "robot_effects.py", "robot_effects.json"][..],
            ),
            ("urdf", &["robot.urdf"]),
            (
                "isaaclab",
                &["robot.urdf", "robot_drives.json", "isaaclab_actuators.py"],
            ),
            (
                "newton",
                &["robot.urdf", "robot_drives.json", "newton_drives.py"],
            ),
            ("bam", &[]),
        ] {
            assert_eq!(exported(folder.path(), "cart.urdf", target), Ok(0));
            for name in files.iter().chain(&["not_expressed.md", "ranges.json"]) {
                let path = folder.path().join(target).join(name);
                assert!(path.is_file(), "{}", path.display());
            }
        }
    }

    #[test]
    fn a_urdf_becomes_firmware() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("cart.urdf"), CART).expect("written");
        for (target, files) in [
            ("rust", &["Cargo.toml", "src/lib.rs", "include/cart.h"][..]),
            ("c", &["cart.h", "cart.c"]),
        ] {
            assert_eq!(exported(folder.path(), "cart.urdf", target), Ok(0));
            for name in files.iter().chain(&["not_expressed.md"]) {
                let path = folder.path().join(target).join(name);
                assert!(path.is_file(), "{}", path.display());
            }
        }
        let source = std::fs::read_to_string(folder.path().join("c/cart.c")).expect("text");
        assert!(source.contains("const float"), "{source}");
    }

    #[test]
    fn what_is_no_robot_file_is_told() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("a.csv"), "t,q\n").expect("written");
        let message = exported(folder.path(), "a.csv", "urdf").expect_err("a log is no robot");
        assert!(message.contains("a.csv: no robot file"), "{message}");
        assert!(exported(folder.path(), "a.urdf", "gazebo").is_err());
    }
}
