//! The closed loop against differences and by hand.

use pid_runtime::control::*;
#[path = "common/derivatives.rs"]
mod derivatives;

use derivatives::derivatives_hold_at;
use pid_models::{DoublePendulum, ServoPendulum};
use pid_runtime::dynamics::{At, Dynamics, Hessian};
use pid_runtime::extend::Extended;

fn closed<'m>(model: &'m dyn Hessian, terms: &[&str]) -> ClosedLoop<'m> {
    let terms: Vec<_> = terms.iter().map(|t| t.parse().expect("a term")).collect();
    let model = Extended::new(model, &terms).expect("fits");
    ClosedLoop::new(Box::new(model)).expect("one input per joint")
}

/// A point in every regime: linear, saturated, off.
fn point(model: &ClosedLoop<'_>, regime: usize) -> Vec<f64> {
    let (d, nq) = (model.dims(), model.dims().nq);
    let mut z: Vec<f64> = (0..d.nz()).map(|k| (0.7 + 1.3 * k as f64).sin()).collect();
    for j in 0..nq {
        let u = &mut z[d.u()..d.p()];
        u[nq + j] = [2.0, 30.0, 2.0][regime];
        u[2 * nq + j] = 0.3;
        u[3 * nq + j] = 3.0;
        u[4 * nq + j] = [1.0, 1.0, 0.25][regime];
    }
    for (k, info) in model.params().iter().enumerate() {
        z[d.p() + k] = if info.nominal == 0.0 {
            0.02
        } else {
            info.nominal
        };
    }
    z
}

#[test]
fn derivatives_are_those_of_differences() {
    for model in [
        closed(&ServoPendulum, &["stribeck", "load"]),
        closed(&DoublePendulum, &["load"]),
    ] {
        let d = model.dims();
        for regime in 0..3 {
            let lambda: Vec<f64> = (0..d.nq).map(|j| 0.8 - 0.5 * j as f64).collect();
            derivatives_hold_at(&model, &point(&model, regime), &lambda, &[]);
        }
    }
}

#[test]
fn a_drive_that_is_off_exerts_no_torque() {
    // Without friction, only the motor applies a force to the servo: it vanishes at every velocity.
    let model = closed(&ServoPendulum, &[]);
    let mut p: Vec<f64> = model.params().iter().map(|i| i.nominal).collect();
    for (value, info) in p.iter_mut().zip(model.params()) {
        if info.name.starts_with("dry") || info.name.starts_with("viscous") {
            *value = 0.0;
        }
    }
    let mut f = [f64::NAN];
    for v in [-8.0, 0.3, 5.0] {
        let at = At {
            q: &[0.4],
            v: &[v],
            a: &[0.0],
            u: &[9.0, 5.0, 0.1, 7.3, 0.0],
            p: &p,
        };
        model.applied_force(&at, &mut f);
        assert!(f[0].abs() < 1e-12, "{v}: {f:?}");
    }
}
