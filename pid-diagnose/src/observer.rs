//! Steady-state Kalman gains of one joint: how an innovation corrects the predicted state.
//!
//! Drive side alone, or rotor and link with a gear between them, `x = (q, v)` or `(q_m, v_m, q_l, v_l)`, linear:
//!
//! ```text
//! x⁺ = A x + w,   w from torque noise held over a sample,   y = q (and v) + noise
//! P = A (P − P Cᵀ S⁻¹ C P) Aᵀ + Q,   S = C P Cᵀ + R,   K = P Cᵀ S⁻¹
//! ```
//!
//! (B. D. O. Anderson, J. B. Moore, Optimal Filtering, 1979, chapter 4). The predictor is consistent with any gain; this one
//! makes its innovations nearly white where model and noise levels are right, which is what their weights rest on.

use nalgebra::{DMatrix, Matrix2};

/// What the gain is designed for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Design {
    /// Sample time, s.
    pub h: f64,
    /// Rotor inertia where there is a gear, all of it otherwise.
    pub inertia: f64,
    /// Viscous friction.
    pub viscous: f64,
    /// Link inertia, stiffness and damping of the gear; encoder on the link side.
    pub gear: Option<(f64, f64, f64, bool)>,
    /// Standard deviations of torque, position and (if it is read) velocity.
    pub torque: f64,
    /// Of a position reading.
    pub q: f64,
    /// Of a velocity reading.
    pub v: Option<f64>,
}

/// Gain of one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gain {
    /// Corrections of `(q_m, v_m, q_l, v_l)` per unit of position innovation and velocity innovation.
    pub rows: [[f64; 2]; 4],
    /// Inverse of the lower Cholesky factor of S: whitens (position, velocity) innovations.
    pub whiten: [[f64; 2]; 2],
}

/// Gain by iterating the Riccati recursion to rest.
pub fn gain(d: &Design) -> Gain {
    let size = if d.gear.is_some() { 4 } else { 2 };
    let mut a = DMatrix::<f64>::zeros(size, size);
    a[(0, 1)] = 1.0;
    a[(1, 1)] = -d.viscous / d.inertia;
    let mut link_side = false;
    if let Some((link, k, c, on_link)) = d.gear {
        link_side = on_link;
        a[(1, 0)] = -k / d.inertia;
        a[(1, 2)] = k / d.inertia;
        a[(1, 1)] -= c / d.inertia;
        a[(1, 3)] = c / d.inertia;
        a[(2, 3)] = 1.0;
        a[(3, 0)] = k / link;
        a[(3, 2)] = -k / link;
        a[(3, 1)] = c / link;
        a[(3, 3)] = -c / link;
    }
    let step = (a * d.h).exp();
    let mut q = DMatrix::<f64>::zeros(size, size);
    let noise = |inertia: f64, torque: f64| {
        let v = d.h * torque / inertia;
        let p = 0.5 * d.h * v;
        (p * p, p * v, v * v)
    };
    let mut put = |at: usize, (pp, pv, vv): (f64, f64, f64)| {
        q[(at, at)] += pp;
        q[(at, at + 1)] += pv;
        q[(at + 1, at)] += pv;
        q[(at + 1, at + 1)] += vv;
    };
    put(0, noise(d.inertia, d.torque));
    if let Some((link, ..)) = d.gear {
        put(2, noise(link, 0.5 * d.torque));
    }
    let at = if link_side { 2 } else { 0 };
    let outputs = if d.v.is_some() { 2 } else { 1 };
    let mut c = DMatrix::<f64>::zeros(outputs, size);
    c[(0, at)] = 1.0;
    let mut r = DMatrix::<f64>::zeros(outputs, outputs);
    r[(0, 0)] = d.q * d.q;
    if let Some(v) = d.v {
        c[(1, at + 1)] = 1.0;
        r[(1, 1)] = v * v;
    }
    let mut p = &q + DMatrix::from_diagonal(&q.diagonal()) * 10.0;
    let mut s = &c * &p * c.transpose() + &r;
    let mut k = DMatrix::zeros(size, outputs);
    for _ in 0..4000 {
        let Some(inverse) = s.clone().try_inverse() else {
            break;
        };
        k = &p * c.transpose() * inverse;
        let next = &step * (&p - &k * &c * &p) * step.transpose() + &q;
        let next = (&next + next.transpose()) * 0.5;
        let change = (&next - &p).amax() / next.amax().max(1e-300);
        p = next;
        s = &c * &p * c.transpose() + &r;
        if change < 1e-9 {
            break;
        }
    }
    let mut rows = [[0.0; 2]; 4];
    for i in 0..size {
        for o in 0..outputs {
            rows[i][o] = k[(i, o)];
        }
    }
    let full = if outputs == 2 {
        Matrix2::new(s[(0, 0)], s[(0, 1)], s[(1, 0)], s[(1, 1)])
    } else {
        Matrix2::new(s[(0, 0)], 0.0, 0.0, 1.0)
    };
    let l00 = full[(0, 0)].sqrt();
    let l10 = full[(1, 0)] / l00;
    let l11 = (full[(1, 1)] - l10 * l10).max(1e-300).sqrt();
    Gain {
        rows,
        whiten: [[1.0 / l00, 0.0], [-l10 / (l00 * l11), 1.0 / l11]],
    }
}
