//! The command line `pid`: identify a robot from its records, see where model and robot differ.
//!
//! Exit codes: 0 done, 1 an error in the input (the message says where and what to do), 2 a mistake in the arguments,
//! 3 finished, but the result is not to be used, 130 interrupted (what was reached has been written).

mod args;
mod assemble;
mod assume;
mod coverage;
mod demo;
mod diagnose;
mod dump;
mod error;
mod excite;
mod findings;
mod horizon;
mod identify;
mod output;
mod paper;
mod parameters;
mod progress;
mod regress;
mod simulate;
mod source;
mod study;

use std::process::ExitCode;

use clap::Parser;

use args::{Cli, Command, DemoArgs};
use error::CliError;

fn main() -> ExitCode {
    let cli = Cli::parse();
    let outcome = match cli.command {
        None => identify::run(&cli.identify),
        Some(Command::Identify(args)) => identify::run(&args),
        Some(Command::Diagnose(args)) => diagnose::run(&args),
        Some(Command::Study(args)) => study::run(&args),
        Some(Command::Coverage(args)) => coverage::run(&args),
        Some(Command::Simulate(args)) => simulate::run(&args),
        Some(Command::Regress(args)) => regress::run(&args),
        Some(Command::Models) => {
            models();
            Ok(0)
        }
        Some(Command::DemoData(args)) => demo_data(&args),
        Some(Command::Paper(args)) => paper::run(&args),
        Some(Command::Dump(args)) => dump::run(&args),
        Some(Command::Excite(args)) => excite::run(&args),
    };
    match outcome {
        Ok(code) => ExitCode::from(code),
        Err(e) => {
            output::message(&format!("error: {e}"));
            ExitCode::FAILURE
        }
    }
}

/// Lists the models with their joints and inputs.
fn models() {
    for entry in pid_models::all() {
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
