//! Estimation by inverse dynamics: records in, base parameters with deviations, checks on records
//! never fitted, and what they cover out.
//!
//! ```text
//! records -> zero-phase filters -> linear regression, parallel decimation -> normal equations per block of time
//! normal equations -> weighted least squares, base parameters, deviations, folds, bootstrap, consistent values
//! ```
//!
//! After the filters, everything works on the normal equations, a few small matrices per block, and
//! never passes over the records again.

pub mod base;
pub mod columns;
mod error;
pub mod filter_choice;
pub mod instruments;
pub mod judge;
pub mod normal;
mod options;
mod outcome;
pub mod range;
pub mod record;
pub mod robust;
pub mod shapes;
pub mod solution;
mod task;
pub mod unknowns;

pub use error::RegressError;
pub use options::Options;
pub use outcome::{PayloadFound, Regression, Row};
pub use task::regress;
