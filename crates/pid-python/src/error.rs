//! Errors as Python has them.

use std::fmt::Display;

use pyo3::exceptions::PyValueError;
use pyo3::{PyErr, create_exception};

create_exception!(
    simtrue,
    SimtrueError,
    PyValueError,
    "An error in the input. The message says the place, the value that is wrong, and how to mend it."
);

/// As an exception; options of the command line become keyword arguments.
pub(crate) fn raised(error: impl Display) -> PyErr {
    SimtrueError::new_err(keywords(&error.to_string()))
}

/// A text with `--sample-time 0.002` as `sample_time=0.002` and `--passive` as `passive`.
fn keywords(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some(at) = rest.find("--") {
        let (before, option) = rest.split_at(at);
        let option = &option[2..];
        out.push_str(before);
        let end = option
            .find(|c: char| !c.is_ascii_lowercase() && c != '-')
            .unwrap_or(option.len());
        let (word, after) = option.split_at(end);
        if word.is_empty() || before.ends_with('-') || word.starts_with('-') {
            out.push_str("--");
            rest = option;
            continue;
        }
        out.push_str(&word.replace('-', "_"));
        rest = after;
        let value = rest.strip_prefix(' ').unwrap_or_default();
        if value.starts_with(|c: char| c == '\'' || c.is_ascii_digit()) {
            out.push('=');
            rest = value;
        }
    }
    out.push_str(rest);
    out
}
