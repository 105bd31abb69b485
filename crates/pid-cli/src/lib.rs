//! The command line `simtrue`: identify a robot from its records, see where model and robot differ.
//!
//! A crate with robots of its own gets the same command line for them in one line:
//!
//! ```no_run
//! use pid_cli::Entry;
//! use pid_runtime::robot;
//!
//! robot! {
//!     /// A carriage on a rail.
//!     pub robot Carriage {
//!         gravity: [0, 0, -9.81] m/s^2;
//!         params { mass: kg = 95.0 in 80.0..=110.0; }
//!         link body { mass: mass; com: [_, _, _]; inertia at com: diag(_, _, _); }
//!         joint x: prismatic about x { base -> body; }
//!         per joint { input force: N; force = force; }
//!         emit { second_derivatives }
//!     }
//! }
//!
//! static ROBOTS: [Entry; 1] = [Entry::new("carriage", "a carriage on a rail", "drawing 12-3", &Carriage)];
//!
//! fn main() -> std::process::ExitCode {
//!     pid_cli::main(&ROBOTS)
//! }
//! ```
//!
//! `identify`, `regress`, `simulate` and `excite` take `carriage` as the name of a model, and
//! `diagnose FOLDER --model carriage` needs no `nominal.toml`.
//!
//! Exit codes: 0 done; 1 an error in the input (the message says where and how to mend it); 2 a
//! mistake in the arguments; 3 finished, but the result must not be used; 130 interrupted (the
//! results so far are written). `fleet collect` ends with 3 where logs are missing and, with `--exit-code`, with 10
//! where a unit stands out. `diagnose --exit-code` adds 10 for named causes, 11 where a part is
//! unknown and 12 where all of it is.

mod args;
mod assume;
mod cause;
mod check;
mod constrain;
mod convert;
mod course;
pub mod demo;
mod described;
mod diagnose;
mod dump;
mod error;
mod excite;
mod export;
mod fleet;
mod followed;
mod identify;
mod limits;
mod models;
mod new;
pub mod open;
pub mod output;
mod parameters;
pub mod progress;
mod regress;
#[cfg(test)]
mod samples;
mod simulate;
mod source;
mod with;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{CommandFactory, Parser};
pub use pid_models::Entry;

pub use args::parse::loss;
pub use assume::from_nominal;
pub use diagnose::summary;
pub use models::by_name;

use args::{Cli, Command, DemoArgs};
use error::CliError;

/// Where the studies of the project are.
const STUDIES: &str = "studies run from the source tree: cargo run --release -p pid-studies -- withheld|paper|coverage (--help lists all)";

/// Runs the command line of this process; `own` are models beside those of `simtrue models`, and
/// come first where names are equal.
pub fn main(own: &'static [Entry]) -> ExitCode {
    ExitCode::from(run(own, std::env::args_os()))
}

/// As [`main`] with the words of a command line, the program's name first; the exit code.
pub fn run(own: &'static [Entry], words: impl IntoIterator<Item = OsString>) -> u8 {
    models::add(own);
    let cli = match Cli::try_parse_from(words) {
        Ok(cli) => cli,
        // Help and version are among these, with code 0.
        Err(told) => {
            let _ = told.print();
            return u8::try_from(told.exit_code()).unwrap_or(MISTAKE);
        }
    };
    let outcome = match cli.command {
        None => identify::run(&cli.identify),
        Some(Command::New(args)) => new::run(&args),
        Some(Command::Identify(args)) => identify::run(&args),
        Some(Command::Diagnose(args)) => diagnose::run(&args),
        Some(Command::Simulate(args)) => simulate::run(&args),
        Some(Command::Regress(args)) => regress::run(&args),
        Some(Command::Check(args)) => check::run(&args),
        Some(Command::Convert(args)) => convert::run(&args),
        Some(Command::Export(args)) => export::run(&args),
        Some(Command::Fleet(args)) => fleet::run(&args),
        Some(Command::Models) => {
            list();
            Ok(0)
        }
        Some(Command::Completions(args)) => {
            completions(args.shell);
            Ok(0)
        }
        Some(Command::DemoData(args)) => demo_data(&args),
        Some(Command::Dump(args)) => dump::run(&args),
        Some(Command::Excite(args)) => excite::run(&args),
        Some(Command::Study(_)) => {
            output::message(STUDIES);
            Ok(1)
        }
    };
    match outcome {
        Ok(code) => code,
        Err(e) => {
            output::message(&format!("error: {e}"));
            match e {
                CliError::NoCommand { .. } => MISTAKE,
                _ => FAILED,
            }
        }
    }
}

/// Exit code of an error in the input.
const FAILED: u8 = 1;
/// Exit code of a mistake in the arguments.
const MISTAKE: u8 = 2;

/// Prints what a shell completes words of this command with.
fn completions(shell: clap_complete::Shell) {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "simtrue", &mut text);
    output::print(&String::from_utf8_lossy(&text));
}

/// Lists the models with their joints and inputs.
fn list() {
    for entry in models::all() {
        let model = entry.model;
        let joints: Vec<String> = model
            .joints()
            .iter()
            .map(|j| format!("{} ({})", j.name, j.unit()))
            .collect();
        let inputs: Vec<String> = model
            .inputs()
            .iter()
            .map(|i| format!("{} ({})", i.name, i.unit))
            .collect();
        output::print(&format!(
            "{}: {}\n  joints: {}\n  inputs: {}\n  {} parameters; {}\n\n",
            entry.name,
            entry.summary,
            joints.join(", "),
            inputs.join(", "),
            model.dims().np,
            entry.source
        ));
    }
}

fn demo_data(args: &DemoArgs) -> Result<u8, CliError> {
    error::make_folder(&args.out)?;
    for (name, text) in demo::generate()? {
        let path = args.out.join(name);
        error::write(&path, &text)?;
        output::print(&format!("{}\n", path.display()));
    }
    Ok(0)
}
