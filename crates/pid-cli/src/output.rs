//! The one place that writes to standard output; progress and messages go to standard error.

use std::io::Write;

/// Prints a text. A closed pipe (`simtrue models | head -1`) is not an error.
#[allow(clippy::print_stdout)] // results belong on standard output
pub fn print(text: &str) {
    let _ = std::io::stdout().write_all(text.as_bytes());
}

/// Prints a message for people to standard error.
pub fn message(text: &str) {
    eprintln!("{text}");
}
