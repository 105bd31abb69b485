//! Identification problems as sparse nonlinear programs.

mod expansion;
mod explicit_form;
mod full_discretization;
mod residual_fit;
mod scheme;

pub use explicit_form::ExplicitForm;
pub use full_discretization::{Curvature, FullDiscretization, Setup, Track};
pub use residual_fit::ResidualFit;
pub use scheme::Scheme;
