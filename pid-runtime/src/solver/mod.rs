//! Solvers for nonlinear programs and their parts.

pub mod kkt;
