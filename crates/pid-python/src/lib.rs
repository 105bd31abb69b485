//! The compiled part of the Python package `simtrue`; what users call is in `python/simtrue`.
//!
//! Work runs on a thread of its own while the calling thread has released Python and looks for
//! Ctrl-C (module `work`). Every error is a `SimtrueError`, a `ValueError` with place, value and mend.

use std::ffi::OsString;

use pyo3::prelude::*;

mod arrays;
mod diagnose;
mod error;
mod identify;
mod records;
mod robot;
mod simulate;
mod work;

/// The compiled part of `simtrue`.
#[pymodule]
mod _simtrue {
    #[pymodule_export]
    use super::{
        command,
        diagnose::{Report, check, diagnose},
        error::SimtrueError,
        identify::{Fit, identify},
        records::{Records, read},
        robot::Robot,
        simulate::simulate,
    };
}

/// Runs the command line with these words, the program's name first; the exit code.
#[pyfunction]
fn command(py: Python<'_>, words: Vec<OsString>) -> u8 {
    py.detach(|| simtrue::cli::run(&[], words))
}
