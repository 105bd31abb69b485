//! The command line `pid`.

use std::process::ExitCode;

fn main() -> ExitCode {
    pid_cli::main(&[])
}
