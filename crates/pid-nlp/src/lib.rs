//! Nonlinear programs and their solvers.
//!
//! A program implements [`Nlp`]; [`solver::solve`] minimises it by an interior-point method or by
//! sequential quadratic programming, with exact or quasi-Newton Hessians. The KKT systems are
//! factorised by [`solver::kkt::sparse`] or, where the program is a chain of blocks with common
//! variables, by [`solver::kkt::structured`].

pub mod eigen;
mod nlp;
pub mod solver;

pub use nlp::{Nlp, PointCheck, SparsePattern, check_point};
