//! Identification problems as sparse nonlinear programs.

mod expansion;
mod full_discretization;
mod residual_fit;
mod scheme;

pub use full_discretization::{Curvature, FullDiscretization, Setup, Track};
pub use residual_fit::ResidualFit;
pub use scheme::Scheme;
