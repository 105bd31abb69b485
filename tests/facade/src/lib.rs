//! `robot!` for a crate that depends on `simtrue` alone, under another name. It has to compile: `.ci/run` checks it.
#![deny(warnings, rustdoc::broken_intra_doc_links)]

use front::robot;

robot! {
    /// A carriage on a rail.
    pub robot Carriage {
        gravity: [0, 0, -9.81] m/s^2;
        params {
            /// Moving mass.
            mass: kg = 95.0 in 10.0..=300.0;
        }
        link body { mass: mass; }
        joint x: prismatic along x { base -> body; }
        per joint { input force: N; force = force; }
        emit { second_derivatives, lanes, regressor, base_parameters }
    }
}

/// Acceleration of the nominal carriage under a force (N), m/s².
///
/// # Errors
/// Where the mass matrix is not positive definite.
pub fn acceleration(force: f64) -> Result<f64, front::dynamics::SingularMassMatrix> {
    let p = CarriageParams::nominal();
    let u = CarriageInputs { force_x: force };
    Carriage::forward_dynamics(&[0.0], &[0.0], &u, &p).map(|a| a[0])
}

/// The carriage as a model with exact second derivatives.
pub fn model() -> &'static dyn front::dynamics::Hessian {
    &Carriage
}
