//! Estimation by inverse dynamics.
//!
//! ```text
//! records -> zero-phase filters -> linear regression, parallel decimation -> normal equations per block of time
//! normal equations -> weighted least squares, base parameters, deviations, folds, bootstrap, consistent values
//! ```
//!
//! Everything after the filters works on the normal equations, a few small matrices per block, and takes no further pass over
//! the records.

pub mod assumptions;
pub mod base;
pub mod bootstrap;
mod chain;
pub mod columns;
pub mod consistent;
pub mod control;
pub mod controllers;
pub mod coverage;
pub mod extend;
pub mod filter_choice;
pub mod instruments;
pub mod judge;
pub mod lag;
pub mod log_cholesky;
pub mod memory;
pub mod normal;
pub mod poses;
pub mod private;
pub mod pseudo_inertia;
pub mod range;
pub mod record;
pub mod regress;
pub mod robust;
pub mod shapes;
pub mod solution;
pub mod synthetic;
pub mod term;
pub mod unknowns;
