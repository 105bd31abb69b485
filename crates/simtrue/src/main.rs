//! The command `simtrue`.

use std::process::ExitCode;

fn main() -> ExitCode {
    pid_cli::main(&[])
}
