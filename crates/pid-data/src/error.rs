//! Faults of a data set: the place, the value, the mend.

use std::io;

/// A data set that cannot be used. Lines count from 1 and include the header.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DataError {
    /// A file cannot be read.
    #[error(
        "{file}: cannot be read: {error}\n  help: a data set is a folder with `dataset.toml` and the CSV files it lists"
    )]
    Unreadable {
        /// The file.
        file: String,
        /// Message of the operating system.
        error: io::Error,
    },
    /// A file listed in the manifest is not among the embedded ones.
    #[error(
        "{file}: is not among the embedded files\n  help: add it, or take it out of `dataset.toml`"
    )]
    NotEmbedded {
        /// The file.
        file: String,
    },
    /// `dataset.toml` is not what the format asks for.
    #[error("{0}\n  the keys: docs/data-format.md")]
    Manifest(#[from] pid_toml::Mistake),
    /// A key of `dataset.toml` has a value that is not known.
    #[error("{place}: {item}: unknown {key} `{value}`\n  help: use one of {known}")]
    UnknownValue {
        /// Where the value stands.
        place: pid_toml::Place,
        /// Which joint or experiment.
        item: String,
        /// The key.
        key: &'static str,
        /// What stands there.
        value: String,
        /// What may stand there, and which of it is meant where that shows.
        known: String,
    },
    /// Gains by record that no drive has.
    #[error(
        "{place}: {item}: gain_factors.{key}: {why}\n  help: as in gain_factors = {{ kp = 4.0 }}, how many times the gain of [drive] acts in this record"
    )]
    GainFactors {
        /// Where they stand.
        place: pid_toml::Place,
        /// Which experiment.
        item: String,
        /// The key of the gain.
        key: String,
        /// What is wrong.
        why: String,
    },
    /// Drives that are off, of joints that there are not.
    #[error(
        "{place}: {item}: off: {why}\n  help: as in off = true, where no drive of the robot is on in this record"
    )]
    Off {
        /// Where it stands.
        place: pid_toml::Place,
        /// Which experiment.
        item: String,
        /// What is wrong.
        why: String,
    },
    /// The unit of an input does not fit its quantity.
    #[error(
        "{place}: joint `{joint}`: a {quantity} is recorded in {expected}, not in `{unit}`\n  help: convert the column and write input_unit = \"{expected}\""
    )]
    UnitOfQuantity {
        /// Where the unit stands.
        place: pid_toml::Place,
        /// The joint.
        joint: String,
        /// `torque`, `force`, `current` or `voltage`.
        quantity: &'static str,
        /// The unit it must be in.
        expected: &'static str,
        /// The unit that is stated.
        unit: String,
    },
    /// `dataset.toml` lists no joint or no experiment.
    #[error("{file}: no {what} listed\n  help: add a `[[{what}]]` table")]
    NothingListed {
        /// The file.
        file: String,
        /// `joint` or `experiment`.
        what: &'static str,
    },
    /// Two experiments or two joints have the same name.
    #[error("{place}: the {what} `{name}` is listed twice\n  help: give each its own name")]
    ListedTwice {
        /// Where it is listed for the second time.
        place: pid_toml::Place,
        /// `joint` or `experiment`.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// A CSV file without a header or without samples.
    #[error(
        "{file}: {what}\n  help: the file needs a header line `t,q1,…,u1,…` and one row per sample"
    )]
    Empty {
        /// The file.
        file: String,
        /// `is empty` or `has a header but no samples`.
        what: &'static str,
    },
    /// Fewer than two samples.
    #[error(
        "{file}: line {line}: only one sample\n  help: a record needs at least two samples to say anything about motion"
    )]
    OneSample {
        /// The file.
        file: String,
        /// Its line.
        line: u64,
    },
    /// A column is not in the header.
    #[error("{file}: line 1: column `{column}` is missing ({reason})\n  help: {help}")]
    MissingColumn {
        /// The file.
        file: String,
        /// The column.
        column: String,
        /// Why it is needed.
        reason: &'static str,
        /// The mend.
        help: String,
    },
    /// A column stands twice in the header.
    #[error("{file}: line 1: column `{column}` stands twice\n  help: rename or remove one of them")]
    DuplicateColumn {
        /// The file.
        file: String,
        /// The column.
        column: String,
    },
    /// A row has another number of cells than the header.
    #[error(
        "{file}: line {line}: {found} cells, but the header has {expected}\n  help: write one value per column; leave a cell empty between its commas if the sample is missing"
    )]
    CellCount {
        /// The file.
        file: String,
        /// Its line.
        line: u64,
        /// Cells in the row.
        found: usize,
        /// Cells in the header.
        expected: usize,
    },
    /// A cell that is no number.
    #[error(
        "{file}: line {line}: column `{column}`: `{value}` is not a number\n  help: use `.` as decimal point; leave the cell empty if the sample is missing"
    )]
    NotANumber {
        /// The file.
        file: String,
        /// Its line.
        line: u64,
        /// The column.
        column: String,
        /// What stands there.
        value: String,
    },
    /// A cell that says NaN or infinity.
    #[error(
        "{file}: line {line}: column `{column}`: `{value}` is not a finite number\n  help: leave the cell empty if the sample is missing, or remove the row"
    )]
    NotFinite {
        /// The file.
        file: String,
        /// Its line.
        line: u64,
        /// The column.
        column: String,
        /// What stands there.
        value: String,
    },
    /// A row without a time.
    #[error("{file}: line {line}: column `t` is empty\n  help: every sample needs its time")]
    MissingTime {
        /// The file.
        file: String,
        /// Its line.
        line: u64,
    },
    /// Time stands still or goes back.
    #[error(
        "{file}: line {line}: column `t`: time {value} s does not increase (previous sample: {previous} s)\n  help: sort the rows by time and remove repeated ones"
    )]
    TimeNotIncreasing {
        /// The file.
        file: String,
        /// Its line.
        line: u64,
        /// The time.
        value: f64,
        /// The time of the row before.
        previous: f64,
    },
    /// A file that is not CSV or not UTF-8.
    #[error("{file}: line {line}: {message}\n  help: save the file as UTF-8 text, comma separated")]
    Csv {
        /// The file.
        file: String,
        /// Its line, 0 if unknown.
        line: u64,
        /// What the parser says.
        message: String,
    },
    /// The data belong to another machine than the model.
    #[error(transparent)]
    Model(#[from] Box<ModelMismatch>),
}

/// A data set and a model that do not belong together.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelMismatch {
    /// A model with another number of joints than the data.
    #[error(
        "data set `{dataset}` has {data} joints ({data_joints}), model `{model}` has {joints} ({model_joints})\n  help: choose the model of this machine, or lock the joints that do not move"
    )]
    JointCount {
        /// The data set.
        dataset: String,
        /// The model.
        model: String,
        /// Joints of the data.
        data: usize,
        /// Their names.
        data_joints: String,
        /// Joints of the model.
        joints: usize,
        /// Their names.
        model_joints: String,
    },
    /// A joint that turns in the model and slides in the data, or the other way round.
    #[error(
        "joint {number}: `{data_joint}` of data set `{dataset}` is {data}, `{model_joint}` of model `{model}` is {found}\n  help: joints are compared in order, base to tip; check the order of the columns"
    )]
    JointKind {
        /// Number of the joint, from 1.
        number: usize,
        /// The data set.
        dataset: String,
        /// The model.
        model: String,
        /// Name in the data.
        data_joint: String,
        /// Kind in the data.
        data: &'static str,
        /// Name in the model.
        model_joint: String,
        /// Kind in the model.
        found: &'static str,
    },
    /// A model whose inputs are not one per joint, in joint order.
    #[error(
        "model `{model}` has the inputs [{inputs}]; the data have one input column per joint, {columns} in all\n  help: declare exactly one `input` per joint"
    )]
    InputCount {
        /// The model.
        model: String,
        /// Its inputs.
        inputs: String,
        /// Input columns of the data.
        columns: usize,
    },
    /// An input in another unit than the model expects.
    #[error(
        "column `u{number}` of data set `{dataset}` is a {quantity} in `{unit}`, but input `{input}` of model `{model}` is in `{expected}`\n  help: use a model whose input is in `{unit}`, or convert the column and say so in dataset.toml"
    )]
    InputUnit {
        /// Number of the joint, from 1.
        number: usize,
        /// The data set.
        dataset: String,
        /// What the column holds.
        quantity: &'static str,
        /// Its unit.
        unit: String,
        /// The model's input.
        input: String,
        /// The model.
        model: String,
        /// The unit of the model's input.
        expected: String,
    },
}

/// Something odd in a data set that does not prevent its use.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DataWarning {
    /// The number of samples is not the one stated.
    #[error("{file}: {found} samples, dataset.toml says {stated}")]
    SampleCount {
        /// The file.
        file: String,
        /// Samples in the file.
        found: usize,
        /// Samples stated.
        stated: usize,
    },
    /// The median time step is not the one stated (more than 1 % off).
    #[error("{file}: median time step {found} s, dataset.toml says {stated} s")]
    SampleTime {
        /// The file.
        file: String,
        /// Median step, s.
        found: f64,
        /// Step stated, s.
        stated: f64,
    },
    /// A column the format does not know.
    #[error("{file}: column `{column}` is not used")]
    UnusedColumn {
        /// The file.
        file: String,
        /// The column.
        column: String,
    },
    /// A velocity column of a joint whose velocity is said to be absent.
    #[error("{file}: column `{column}` is not used: dataset.toml says velocity = \"absent\"")]
    VelocityNotUsed {
        /// The file.
        file: String,
        /// The column.
        column: String,
    },
    /// A velocity that is said to be measured and is a difference of the positions.
    #[error(
        "{file}: joint {joint}: velocity = \"measured\", but `dq{joint}` is the {difference} difference of `q{joint}` ({records} of {of} \
         records)\n  help: write velocity = \"derived\": it tells nothing that the positions do not"
    )]
    VelocityIsDifference {
        /// The file.
        file: String,
        /// Joint from 1.
        joint: usize,
        /// Which.
        difference: super::Difference,
        /// In how many records.
        records: usize,
        /// Of how many.
        of: usize,
    },
    /// Empty cells.
    #[error("{file}: {count} empty cells are taken as missing samples")]
    Missing {
        /// The file.
        file: String,
        /// How many.
        count: usize,
    },
    /// No experiment to judge with, or none to fit on.
    #[error("no experiment with role \"{role}\"")]
    NoExperiment {
        /// The role.
        role: super::Role,
    },
}
