//! The one place that writes to standard output; progress and messages go to standard error.

use std::io::Write;

/// Prints a text. A closed pipe (`pid models | head -1`) is not an error.
#[allow(clippy::print_stdout)] // results belong on standard output
pub(crate) fn print(text: &str) {
    let _ = std::io::stdout().write_all(text.as_bytes());
}

/// Prints a message for people to standard error.
pub(crate) fn message(text: &str) {
    eprintln!("{text}");
}
