//! Why no code can be written.

use pid_interpret::nominal::NominalError;

/// Why no code can be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FirmwareError {
    /// An effect of the description that the library does not take.
    #[error(transparent)]
    Effect(#[from] NominalError),
    /// A value that the code cannot have.
    #[error("robot `{robot}`, {item}: {value}\n  help: {mend}")]
    Value {
        /// Name of the robot.
        robot: String,
        /// The joint, effect or constant.
        item: String,
        /// The value.
        value: String,
        /// What to write instead.
        mend: &'static str,
    },
}
