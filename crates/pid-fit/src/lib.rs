//! Identification of mechanical models from records.
//!
//! | module | duty |
//! |---|---|
//! | [`ident`] | parameters with their uncertainty from records: the estimators behind one call |
//! | [`mod@identify`] | a whole identification from one request: horizon, fit, positive densities, intervals |
//! | [`transcribe`] | motions as nonlinear programs: schemes, full discretization, shooting |
//! | [`integrate`] | motions by integration |
//! | [`regress`] | linear regression on filtered records by the inverse dynamics |
//! | [`inertia`] | bodies of positive density: pseudo-inertias, consistent values |
//! | [`wrap`] | models with a controller, a lag, or parameters of one record |
//! | [`excite`] | motions that determine the parameters |
//! | [`gap`] | what is left between model and records |
//! | [`synthetic`] | records of a robot that is known |

pub mod excite;
pub mod gap;
pub mod ident;
pub mod identify;
pub mod inertia;
pub mod integrate;
pub mod regress;
pub mod synthetic;
pub mod transcribe;
pub mod wrap;

#[cfg(test)]
#[path = "../../../pid-runtime/tests/common/derivatives.rs"]
mod derivatives;
