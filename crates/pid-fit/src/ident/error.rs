//! Why an identification is impossible.

use crate::transcribe::ConstraintError;
use pid_data::DataError;
use pid_data::signal::{FilterError, SignalError};

/// An identification that cannot start.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IdentError {
    /// The data do not fit the model.
    #[error(transparent)]
    Data(#[from] DataError),
    /// States cannot be estimated from a record.
    #[error(transparent)]
    Signal(#[from] SignalError),
    /// A filter cannot be designed.
    #[error("the inputs of experiment `{experiment}` cannot be filtered: {error}")]
    Filter {
        /// The experiment.
        experiment: String,
        /// Why.
        error: FilterError,
    },
    /// Nothing to fit on.
    #[error(
        "data set `{dataset}` has no experiment with role \"train\"\n  help: set `role = \"train\"` in dataset.toml for at least one experiment"
    )]
    NoTraining {
        /// The data set.
        dataset: String,
    },
    /// Too few parameters, or too many.
    #[error("the start has {found} values, the model has {expected} parameters")]
    StartLength {
        /// Parameters of the model.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// Noise levels for other channels than the model's.
    #[error(
        "{found} noise levels are given, the model has {expected} channels: positions of all joints, then velocities"
    )]
    NoiseLength {
        /// Channels of the model.
        expected: usize,
        /// Levels given.
        found: usize,
    },
    /// A parameter to hold that does not exist.
    #[error("parameter {position} is to be held, the model has {parameters}, counted from 0")]
    NoParameter {
        /// The position.
        position: usize,
        /// Parameters of the model.
        parameters: usize,
    },
    /// An estimator that takes recorded inputs, for a model whose inputs no record has.
    #[error(
        "`{model}` takes more inputs than one per joint (a controller within the model, parameters private to a record); the equation error does not\n  help: leave them out, or use full discretization or shooting"
    )]
    Controller {
        /// The model.
        model: String,
    },
    /// A constraint that does not fit the program.
    #[error(transparent)]
    Constraint(#[from] ConstraintError),
    /// Constraints for an estimator that has no program to add them to.
    #[error(
        "constraint `{name}` is given, and the equation error takes none\n  help: use full discretization or shooting, or narrow the parameters' ranges"
    )]
    ConstrainedEquationError {
        /// Name of the first constraint.
        name: String,
    },
    /// A start that its own bounds exclude.
    #[error(
        "start of `{parameter}` = {value} lies outside of its bounds {lower} … {upper} {unit}\n  help: choose a value within them, or widen the range in the model"
    )]
    StartOutsideBounds {
        /// The parameter.
        parameter: String,
        /// Its start.
        value: f64,
        /// Lower bound.
        lower: f64,
        /// Upper bound.
        upper: f64,
        /// Unit.
        unit: String,
    },
    /// A mass matrix without an inverse.
    #[error(
        "the mass matrix is singular at the start: experiment `{experiment}`, t = {time} s, joint `{joint}` (pivot {pivot:.1e})\n  help: give the links that this joint moves a mass or an inertia above zero, or declare an armature"
    )]
    SingularMassMatrix {
        /// The experiment.
        experiment: String,
        /// Time of the sample, s.
        time: f64,
        /// Joint whose pivot vanishes.
        joint: String,
        /// The pivot.
        pivot: f64,
    },
    /// A start that no body can have, where bounds or held values keep it from becoming one.
    #[error(
        "the inertial parameters of link `{link}` at the start are not those of a body with a positive density, and their bounds or held values allow none near it\n  help: change the start or the held values, widen the ranges, or fit without physical consistency"
    )]
    NoBody {
        /// The link.
        link: String,
    },
    /// Windows without an input.
    #[error(
        "experiment `{experiment}` has an empty cell in an input column (row {row}); a simulation cannot go over it\n  help: fill the input, or split the record there"
    )]
    MissingInput {
        /// The experiment.
        experiment: String,
        /// Data row, from 1.
        row: usize,
    },
}
