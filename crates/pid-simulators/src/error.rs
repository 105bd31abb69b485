//! Why a robot cannot be written.

use pid_interpret::nominal::NominalError;

/// Why a robot cannot be written for a simulator.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// An effect of the description that the library does not take.
    #[error(transparent)]
    Effect(#[from] NominalError),
    /// A mechanism that is no tree of bodies with numbers.
    #[error(
        "robot `{robot}`: {what}\n  help: a simulator takes a tree of bodies on revolute and prismatic joints; {mend}"
    )]
    Structure {
        /// Name of the robot.
        robot: String,
        /// What it is.
        what: String,
        /// What to write instead.
        mend: String,
    },
    /// A value that no simulator takes.
    #[error("robot `{robot}`, {item}: {value}\n  help: {mend}")]
    Value {
        /// Name of the robot.
        robot: String,
        /// The joint, link or effect.
        item: String,
        /// The value.
        value: String,
        /// What to write instead.
        mend: &'static str,
    },
    /// A file of results that is not of the form that `simtrue` writes.
    #[error("{name}: {what}\n  help: give the {kind} that `simtrue {command}` wrote")]
    Results {
        /// Name of the file.
        name: String,
        /// What is wrong.
        what: String,
        /// `diagnosis.json` or `fit.json`.
        kind: &'static str,
        /// The command that writes it.
        command: &'static str,
    },
    /// The text of a file cannot be put together.
    #[error("{name} cannot be written: {error}")]
    Text {
        /// Name of the file.
        name: &'static str,
        /// Message of the writer.
        error: std::io::Error,
    },
}
