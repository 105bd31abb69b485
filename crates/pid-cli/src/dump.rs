//! `simtrue dump`: what `robot!` makes of the declarations in a file.

use pid_codegen::show::Dump;

use crate::args::DumpArgs;
use crate::error::CliError;
use crate::output;

/// Prints the requested parts.
pub(crate) fn run(args: &DumpArgs) -> Result<u8, CliError> {
    let path = &args.file;
    let source = std::fs::read_to_string(path).map_err(|error| CliError::Read {
        path: path.clone(),
        error,
    })?;
    let failed = |error| CliError::Dump {
        path: path.clone(),
        error,
    };
    let mut robots = pid_codegen::show::robots(&source).map_err(failed)?;
    if let Some(name) = &args.robot {
        let all: Vec<String> = robots.iter().map(|r| format!("`{}`", r.name())).collect();
        robots.retain(|robot| robot.name() == name);
        if robots.is_empty() {
            return Err(CliError::NoSuchRobot {
                path: path.clone(),
                name: name.clone(),
                found: all.join(", "),
            });
        }
    }
    let parts = &args.parts;
    let nothing = !(parts.code || parts.text || parts.latex || parts.counts);
    type Part = fn(&Dump) -> Result<String, pid_codegen::show::Error>;
    let shown: [(bool, Part); 4] = [
        (parts.text || nothing, Dump::text),
        (parts.latex, Dump::latex),
        (parts.counts || nothing, Dump::counts),
        (parts.code, Dump::code),
    ];
    for robot in &robots {
        for (_, part) in shown.iter().filter(|(asked, _)| *asked) {
            output::print(&format!("{}\n", part(robot).map_err(failed)?));
        }
    }
    Ok(0)
}
