//! Faults of a log: file, channel and row, value, mend.

use std::io;

/// A log that cannot be used. Rows count from 1; those of text files are lines and include the header.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// A file or folder cannot be read or written.
    #[error("{file}: cannot be {action}: {error}\n  help: check the path and its permissions")]
    File {
        /// The file or folder.
        file: String,
        /// `read` or `written`.
        action: &'static str,
        /// Message of the operating system.
        error: io::Error,
    },
    /// A file of a kind that is not read.
    #[error("{file}: {found}\n  help: {mend}")]
    Format {
        /// The file.
        file: String,
        /// What the first bytes say.
        found: String,
        /// How to make a file that is read.
        mend: String,
    },
    /// A file that breaks the rules of its format, or ends too early.
    #[error(
        "{file}: broken {format} file: {message}\n  help: copy or record the file again; {mend}"
    )]
    Broken {
        /// The file.
        file: String,
        /// The format.
        format: &'static str,
        /// What is wrong, with the place where known.
        message: String,
        /// The mend of this format.
        mend: &'static str,
    },
    /// A message that does not follow its schema.
    #[error("{file}: topic `{topic}`: message {row}: {message}\n  help: {mend}")]
    Message {
        /// The file.
        file: String,
        /// The topic.
        topic: String,
        /// Number of the message on its topic, from 1.
        row: usize,
        /// What is wrong.
        message: String,
        /// The mend.
        mend: &'static str,
    },
    /// A file without samples.
    #[error("{file}: {what}\n  help: {mend}")]
    Empty {
        /// The file.
        file: String,
        /// What is missing.
        what: String,
        /// The mend.
        mend: String,
    },
    /// A row with too few or too many cells.
    #[error(
        "{file}: line {row}: {found} cells, but the header has {expected}\n  help: write one value per column; leave a cell empty if the sample is missing"
    )]
    Cells {
        /// The file.
        file: String,
        /// The line.
        row: usize,
        /// Cells of the row.
        found: usize,
        /// Cells of the header.
        expected: usize,
    },
    /// A value that is no finite number, in a channel that is needed.
    #[error(
        "{file}: {row}: channel `{channel}`: `{value}` is not a finite number\n  help: leave the cell empty if the sample is missing, or map another channel"
    )]
    Value {
        /// The file.
        file: String,
        /// Which row: `line 7`, `message 7` or `row 7`.
        row: String,
        /// The channel.
        channel: String,
        /// What stands there.
        value: String,
    },
    /// Time stands still, goes back or is missing.
    #[error("{file}: {row}: time `{channel}`: {what}\n  help: {mend}")]
    Time {
        /// The file.
        file: String,
        /// Which row.
        row: String,
        /// The channel of times.
        channel: String,
        /// What is wrong, with the values.
        what: String,
        /// The mend.
        mend: &'static str,
    },
    /// A quantity that must be there.
    #[error("{file}: no {quantity}{of}{found}\n  help: {mend}")]
    Missing {
        /// The file.
        file: String,
        /// The quantity.
        quantity: &'static str,
        /// Of which joints, begun by a blank; empty if of none in particular.
        of: String,
        /// What is there instead, begun by a separator; empty if nothing.
        found: String,
        /// The mend.
        mend: String,
    },
    /// Several channels may be meant.
    #[error("{file}: {what} may be {candidates}\n  help: {mend}")]
    Ambiguous {
        /// The file.
        file: String,
        /// The quantity and the joint.
        what: String,
        /// The channels.
        candidates: String,
        /// The mend.
        mend: String,
    },
    /// An input whose quantity nobody states.
    #[error(
        "{file}: `{channel}` is an input of joint `{joint}`, but nothing says which: torque at the joint, motor current or voltage\n  help: say --input torque, --input current or --input voltage, state it in the description of the robot, or map it with its unit: --map 'u:{joint}={channel}[N*m]'"
    )]
    InputUnknown {
        /// The file.
        file: String,
        /// The channel.
        channel: String,
        /// The joint.
        joint: String,
    },
    /// A unit that does not fit the quantity.
    #[error("{file}: channel `{channel}`: unit `{unit}` does not fit {quantity}\n  help: {mend}")]
    Unit {
        /// The file.
        file: String,
        /// The channel.
        channel: String,
        /// The unit.
        unit: String,
        /// The quantity it is taken for.
        quantity: String,
        /// The mend.
        mend: String,
    },
    /// A `--map` entry that cannot be read, or names what is not there.
    #[error("{place}: {what}\n  help: {mend}")]
    Map {
        /// The entry, or its place in a file.
        place: String,
        /// What is wrong.
        what: String,
        /// The mend.
        mend: String,
    },
    /// A file of map entries that is not TOML.
    #[error("{0}\n  the form: docs/logs.md")]
    MapFile(#[from] pid_toml::Mistake),
    /// Logs that do not belong to one data set.
    #[error("{second}: {what}, other than in {first}\n  help: {mend}")]
    Disagree {
        /// The first log.
        first: String,
        /// The one that differs.
        second: String,
        /// What differs.
        what: String,
        /// The mend.
        mend: &'static str,
    },
    /// A data set that does not pass its own reader.
    #[error(transparent)]
    Data(#[from] pid_data::DataError),
}
