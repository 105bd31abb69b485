//! Solvers for nonlinear programs and their parts.

pub mod ip;
pub mod kkt;
mod method;
mod outcome;
pub mod quasi_newton;
mod settings;
pub mod sqp;

pub use method::{Algorithm, minimise, solve};
pub use outcome::{Counts, Iteration, Seconds, Solution, Status};
pub use settings::{Barrier, Interrupt, Oracle, Settings};
