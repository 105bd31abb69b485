//! Identification problems as sparse nonlinear programs.

mod expansion;
mod full_discretization;
mod scheme;

pub use full_discretization::{Curvature, FullDiscretization, Setup, Track};
pub use scheme::Scheme;
