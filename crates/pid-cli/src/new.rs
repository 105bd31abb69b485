//! `simtrue new`: a crate with a declared robot, or a data folder from a robot file and its logs.

use std::path::{Path, PathBuf};

use crate::args::new::NewArgs;
use crate::check::refuse_wrong;
use crate::error::{CliError, make_folder, write};
use crate::open::{open, robot_and_logs};
use crate::output;

/// The source of the crate; the names in it stand for those of the robot.
const MAIN: &str = include_str!("../templates/main.rs");
/// Names in the source.
const TEMPLATE: Names<'static> = Names {
    model: "new_robot",
    robot: "NewRobot",
};

/// Where the crate `simtrue` lies beside this one in a source tree.
const LIBRARY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../simtrue");

/// Writes the crate or the folder and says what comes next.
pub(crate) fn run(args: &NewArgs) -> Result<u8, CliError> {
    let folder = &args.path;
    if folder
        .read_dir()
        .is_ok_and(|mut items| items.next().is_some())
    {
        return Err(CliError::NotEmpty {
            path: folder.clone(),
        });
    }
    match args.from.as_slice() {
        [] => robot_crate(folder, args.simtrue.as_deref()),
        paths => data_folder(folder, paths, args),
    }
}

/// The model's name and that of its type.
struct Names<'n> {
    model: &'n str,
    robot: &'n str,
}

/// A crate with a declaration.
fn robot_crate(folder: &Path, library: Option<&Path>) -> Result<u8, CliError> {
    let name = folder.file_name().and_then(|name| name.to_str());
    let name = name.unwrap_or_default();
    let (model, robot) = (name.replace('-', "_"), type_name(name));
    let plain = name
        .chars()
        .all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    if !plain || syn::parse_str::<syn::Ident>(&model).is_err() || robot.is_empty() {
        return Err(CliError::CrateName {
            name: name.to_owned(),
        });
    }
    let names = Names {
        model: &model,
        robot: &robot,
    };
    make_folder(&folder.join("src"))?;
    write(&folder.join("Cargo.toml"), &manifest(name, library)?)?;
    write(&folder.join(".gitignore"), "/target\n/simtrue-report\n")?;
    write(&folder.join("src/main.rs"), &source(&names))?;
    output::print(&format!(
        "{0}: a crate with the robot `{1}`\nnext:\n  cd {0}\n  cargo run --release -- models\n  cargo run --release -- excite {2} --out motion\n",
        folder.display(),
        names.robot,
        names.model
    ));
    Ok(0)
}

/// The declaration under the names of the robot.
fn source(names: &Names<'_>) -> String {
    MAIN.replace(TEMPLATE.model, names.model)
        .replace(TEMPLATE.robot, names.robot)
}

/// `my-arm_2` as `MyArm2`.
fn type_name(name: &str) -> String {
    let words = name.split(['-', '_']);
    let capital = |word: &str| -> String {
        let (first, rest) = word.split_at(word.len().min(1));
        first.to_ascii_uppercase() + rest
    };
    words.map(capital).collect()
}

/// The manifest; `simtrue` comes from a source tree where there is one, else from the registry.
fn manifest(name: &str, library: Option<&Path>) -> Result<String, CliError> {
    let library = match library {
        Some(path) => Some(path.to_owned()),
        None => Some(PathBuf::from(LIBRARY)).filter(|path| path.join("Cargo.toml").is_file()),
    };
    let version = env!("CARGO_PKG_VERSION");
    let from = match library {
        None => format!("\"{version}\""),
        Some(path) => {
            let whole = path.canonicalize();
            let whole = whole.map_err(|error| CliError::Read { path, error })?;
            // A JSON text is a TOML text, whatever characters the path has.
            let text = serde_json::to_string(&whole).map_err(CliError::Json)?;
            format!("{{ path = {text} }}")
        }
    };
    Ok(format!(
        "[package]\nname = \"{name}\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n[dependencies]\nsimtrue = {from}\n\n[workspace]\n"
    ))
}

/// A data folder with the description of the robot.
fn data_folder(folder: &Path, paths: &[PathBuf], args: &NewArgs) -> Result<u8, CliError> {
    let Some((robot, logs)) = robot_and_logs(paths) else {
        return Err(CliError::NoRobot {
            path: paths[0].clone(),
        });
    };
    let opened = open(robot, logs, &args.open)?;
    refuse_wrong(&opened, args.anyway)?;
    opened.write(folder)?;
    output::print(&format!(
        "next:\n  simtrue identify {0} --out {0}/identified\n  simtrue diagnose {0} --out {0}/diagnosis\n",
        folder.display()
    ));
    Ok(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_source_has_the_names_of_the_robot_and_no_others() {
        assert_eq!(type_name("my-arm_2"), "MyArm2");
        let text = source(&Names {
            model: "my_arm",
            robot: "MyArm",
        });
        assert!(text.contains("pub robot MyArm {") && text.contains("\"my_arm\","));
        assert!(!text.contains(TEMPLATE.model) && !text.contains(TEMPLATE.robot));
    }
}
