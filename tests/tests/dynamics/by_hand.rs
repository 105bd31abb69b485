//! Equations of motion worked out by hand: residuals M a + b − f_L.

use pid_runtime::dynamics::At;

/// Residual by hand: M a + b − f_L from a mass matrix, a bias and a force.
fn by_hand<const N: usize>(m: [[f64; N]; N], b: [f64; N], f: [f64; N], a: &[f64]) -> Vec<f64> {
    (0..N)
        .map(|i| (0..N).map(|j| m[i][j] * a[j]).sum::<f64>() + b[i] - f[i])
        .collect()
}

/// Equations of Schäfer et al., Section V-A, worked out by hand (joint 2 meets the axis of joint 1).
pub(super) fn two_link_by_hand(at: &At<'_>) -> Vec<f64> {
    let [m1, m2, sx1, sy1, sx2, sy2, sz2, iz1, ix2, iy2, iz2] = at.p[..11] else {
        panic!("19 parameters")
    };
    let (dry, viscous, gain, sharp) = (&at.p[11..], &at.p[13..], &at.p[15..], &at.p[17..]);
    let (s, c) = at.q[1].sin_cos();
    let (r, z) = (c * sx2 + s * sz2, c * sz2 - s * sx2);
    let (v1, v2) = (at.v[0], at.v[1]);
    let m11 =
        iz1 + m1 * (sx1 * sx1 + sy1 * sy1) + ix2 * s * s + iz2 * c * c + m2 * (r * r + sy2 * sy2);
    let m12 = -m2 * sy2 * z;
    let m22 = iy2 + m2 * (sx2 * sx2 + sz2 * sz2);
    let d = 2.0 * s * c * (ix2 - iz2) + 2.0 * m2 * r * z;
    let b = [
        d * v1 * v2 + m2 * sy2 * r * v2 * v2,
        -0.5 * d * v1 * v1 - 9.81 * m2 * r,
    ];
    let f = [0, 1]
        .map(|j| -dry[j] * (sharp[j] * at.v[j]).tanh() - viscous[j] * at.v[j] + gain[j] * at.u[j]);
    by_hand([[m11, m12], [m12, m22]], b, f, at.a)
}

/// `M q'' = u − Fv q' − Fc tanh(sharp q') − offset`.
pub(super) fn emps_by_hand(at: &At<'_>) -> Vec<f64> {
    let [mass, viscous, dry, offset, sharp] = *at.p else {
        panic!("5 parameters")
    };
    let v = at.v[0];
    let f = at.u[0] - viscous * v - dry * (sharp * v).tanh() - offset;
    by_hand([[mass]], [0.0], [f], at.a)
}

/// Planar two-link pendulum with inertias about the joint axes (textbook form).
pub(super) fn double_pendulum_by_hand(at: &At<'_>) -> Vec<f64> {
    let [m1, r1, i1, m2, r2, i2, rotor] = at.p[..7] else {
        panic!("13 parameters")
    };
    let (viscous, dry, sharp) = (&at.p[7..], &at.p[9..], &at.p[11..]);
    let (l1, g) = (0.2, 9.81);
    let (s1, s12) = (at.q[0].sin(), (at.q[0] + at.q[1]).sin());
    let (s2, c2) = at.q[1].sin_cos();
    let (v1, v2) = (at.v[0], at.v[1]);
    let h = m2 * l1 * r2;
    let (m12, drive) = (i2 + h * c2, 36.0 * rotor);
    let m11 = i1 + i2 + m2 * l1 * l1 + 2.0 * h * c2 + drive;
    let b = [
        -h * s2 * (2.0 * v1 * v2 + v2 * v2) + g * (m1 * r1 * s1 + m2 * (l1 * s1 + r2 * s12)),
        h * s2 * v1 * v1 + g * m2 * r2 * s12,
    ];
    let f = [0, 1].map(|j| at.u[j] - viscous[j] * at.v[j] - dry[j] * (sharp[j] * at.v[j]).tanh());
    by_hand([[m11, m12], [m12, i2 + drive]], b, f, at.a)
}

/// Lagrange's equations of the pole on a cart, R. Florian 2007 with viscous friction.
pub(super) fn cart_pole_by_hand(at: &At<'_>) -> Vec<f64> {
    let [cart, pole, half, g, rolling, hinge] = *at.p else {
        panic!("6 parameters")
    };
    let (s, c) = at.q[1].sin_cos();
    let (ml, v) = (pole * half, at.v);
    let m = [[cart + pole, ml * c], [ml * c, 4.0 / 3.0 * ml * half]];
    let b = [-ml * v[1] * v[1] * s, -ml * g * s];
    by_hand(m, b, [at.u[0] - rolling * v[0], -hinge * v[1]], at.a)
}

/// Pendulum on a motor with back-EMF: `k (U − k v)/R`.
pub(super) fn servo_pendulum_by_hand(at: &At<'_>) -> Vec<f64> {
    let [m, l, gain, resistance, rotor, dry, viscous, slip] = *at.p else {
        panic!("8 parameters")
    };
    let v = at.v[0];
    let drive = gain * (at.u[0] - gain * v) / resistance;
    let f = drive - dry * (v / slip).tanh() - viscous * v;
    let b = m * 9.81 * l * at.q[0].sin();
    by_hand([[m * l * l + rotor]], [b], [f], at.a)
}
