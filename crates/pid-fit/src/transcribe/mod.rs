//! Identification problems as sparse nonlinear programs.

mod bodies;
mod butcher;
mod constrained;
mod constrained_kkt;
mod expansion;
mod explicit_form;
mod explicit_lanes;
mod fit;
mod full_discretization;
mod loss;
mod residual_fit;
mod scheme;
mod setup;
mod shooting;
mod step;
mod step_lanes;
mod tableau;

pub use bodies::Body;
pub use constrained::{Constrained, Constraint, ConstraintError, Place, Sense, States};
pub use constrained_kkt::{ConstrainedKkt, Roomy, Structured};
pub use explicit_form::ExplicitForm;
pub use fit::Output;
pub use full_discretization::FullDiscretization;
pub use loss::{Loss, Prior};
pub use residual_fit::ResidualFit;
pub use scheme::{Scheme, SchemeError, Stages};
pub use setup::{Curvature, Setup, Track};
pub use shooting::{Adaptive, Shooting, ShootingKkt, Stepping};
