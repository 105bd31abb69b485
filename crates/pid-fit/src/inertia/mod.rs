//! Inertial parameters of bodies whose density is positive everywhere.

pub mod consistent;
pub mod log_cholesky;
pub mod poses;
pub mod pseudo_inertia;
