use std::io;
use std::path::PathBuf;

use thiserror::Error;

/// Why a nominal description cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NominalError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {error}", .file.display())]
    Unreadable {
        /// The file.
        file: PathBuf,
        /// What the system says.
        error: io::Error,
    },
    /// Not TOML, or with keys that are unknown, missing or of the wrong type.
    #[error("{}: {message}\n  help: see docs/nominal-format.md for the keys and their values", .file.display())]
    Syntax {
        /// The file.
        file: PathBuf,
        /// What the TOML parser says, with line and column.
        message: String,
    },
    /// No joint.
    #[error("{}: no joint listed\n  help: add a `[[joint]]` table per moving link, base to tip", .file.display())]
    NoJoint {
        /// The file.
        file: PathBuf,
    },
    /// A value that cannot be.
    #[error("{}:{line}: {item}: `{key}` is {found}\n  help: {mend}", .file.display())]
    Value {
        /// The file.
        file: PathBuf,
        /// Line of the value, from 1.
        line: usize,
        /// `robot`, `tolerance` or `joint j2`.
        item: String,
        /// The key.
        key: &'static str,
        /// The value.
        found: String,
        /// What to write instead.
        mend: String,
    },
}
