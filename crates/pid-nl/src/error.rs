//! What can be wrong with a file.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

/// Why a `.nl` file cannot be used. Lines count from 1.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NlError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {error}", .file.display())]
    Unreadable {
        /// The file.
        file: PathBuf,
        /// Message of the operating system.
        error: io::Error,
    },
    /// Not a `.nl` file in text form.
    #[error("{}: begins with \"{begin}\", a `.nl` file as text begins with g\n  help: {mend}", .file.display())]
    Form {
        /// The file.
        file: PathBuf,
        /// Its first characters.
        begin: String,
        /// The mend.
        mend: &'static str,
    },
    /// A line that cannot stand where it does.
    #[error("{}:{line}: {item} is \"{value}\"\n  help: {mend}", .file.display())]
    Value {
        /// The file.
        file: PathBuf,
        /// Line.
        line: usize,
        /// What stands there.
        item: String,
        /// The line or its part.
        value: String,
        /// The mend.
        mend: String,
    },
    /// The file ends within a part.
    #[error("{}:{line}: the file ends before {item}\n  help: write it anew, it is cut", .file.display())]
    End {
        /// The file.
        file: PathBuf,
        /// Its last line.
        line: usize,
        /// What is missing.
        item: String,
    },
    /// Something that no smooth program holds.
    #[error("{}:{line}: {item} has no derivatives, or none that a smooth solver can use\n  help: {mend}", .file.display())]
    NotSmooth {
        /// The file.
        file: PathBuf,
        /// Line.
        line: usize,
        /// The operation.
        item: String,
        /// The mend.
        mend: String,
    },
}
