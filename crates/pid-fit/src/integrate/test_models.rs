//! Small models written by hand, for tests.

use std::borrow::Cow;

use pid_runtime::dynamics::{
    At, Dims, Dynamics, InputInfo, Jacobian, JointInfo, ParamInfo, Pattern,
};

const fn joint(name: &'static str) -> JointInfo {
    JointInfo {
        name: Cow::Borrowed(name),
        prismatic: false,
        limits: None,
    }
}

const fn input(joint: usize) -> InputInfo {
    InputInfo {
        name: Cow::Borrowed("torque"),
        unit: Cow::Borrowed("N*m"),
        joint: Some(joint),
    }
}

const fn param(name: &'static str, nominal: f64) -> ParamInfo {
    ParamInfo {
        name: Cow::Borrowed(name),
        unit: Cow::Borrowed(""),
        doc: Cow::Borrowed(""),
        nominal,
        lower: 0.0,
        upper: 1e4,
        fixed: false,
    }
}

/// A driven pendulum with viscous and dry friction, p = (J, mgl, d, c, s):
/// `r = J a + mgl sin q + d v + c tanh(s v) − u`.
pub(crate) struct Pendulum;

/// Parameters of a lively pendulum.
pub(crate) const PENDULUM: [f64; 5] = [1.2, 9.0, 0.3, 0.2, 5.0];

static PENDULUM_PARAMS: [ParamInfo; 5] = [
    param("J", 1.2),
    param("mgl", 9.0),
    param("d", 0.3),
    param("c", 0.2),
    param("s", 5.0),
];
static PENDULUM_JOINTS: [JointInfo; 1] = [joint("hinge")];
static PENDULUM_INPUTS: [InputInfo; 1] = [input(0)];

impl Dynamics for Pendulum {
    fn name(&self) -> &str {
        "Pendulum"
    }
    fn dims(&self) -> Dims {
        Dims {
            nq: 1,
            nu: 1,
            np: 5,
        }
    }
    fn params(&self) -> &[ParamInfo] {
        &PENDULUM_PARAMS
    }
    fn joints(&self) -> &[JointInfo] {
        &PENDULUM_JOINTS
    }
    fn inputs(&self) -> &[InputInfo] {
        &PENDULUM_INPUTS
    }
    fn mass_matrix(&self, at: &At<'_>, m: &mut [f64]) {
        m[0] = at.p[0];
    }
    fn bias(&self, at: &At<'_>, b: &mut [f64]) {
        b[0] = at.p[1] * at.q[0].sin();
    }
    fn applied_force(&self, at: &At<'_>, f: &mut [f64]) {
        f[0] = at.u[0] - at.p[2] * at.v[0] - at.p[3] * (at.p[4] * at.v[0]).tanh();
    }
    fn residual(&self, at: &At<'_>, r: &mut [f64]) {
        let mut f = [0.0];
        self.applied_force(at, &mut f);
        r[0] = at.p[0] * at.a[0] + at.p[1] * at.q[0].sin() - f[0];
    }
    fn kinetic_energy(&self, at: &At<'_>) -> f64 {
        0.5 * at.p[0] * at.v[0] * at.v[0]
    }
    fn potential_energy(&self, at: &At<'_>) -> f64 {
        -at.p[1] * at.q[0].cos()
    }
}

impl Jacobian for Pendulum {
    fn jacobian_pattern(&self) -> Pattern<'_> {
        // z = (q, v, a, u, J, mgl, d, c, s)
        Pattern {
            rows: &[0; 9],
            cols: &[0, 1, 2, 3, 4, 5, 6, 7, 8],
        }
    }
    fn residual_jacobian(&self, at: &At<'_>, r: &mut [f64], values: &mut [f64]) {
        self.residual(at, r);
        let (q, v, a, p) = (at.q[0], at.v[0], at.a[0], at.p);
        let th = (p[4] * v).tanh();
        let steep = p[3] * (1.0 - th * th);
        values.copy_from_slice(&[
            p[1] * q.cos(),
            p[2] + steep * p[4],
            p[0],
            -1.0,
            a,
            q.sin(),
            v,
            th,
            steep * v,
        ]);
    }
}

/// Two masses coupled through M = [[2, 1], [1, 2]] and springs K = [[5, −1], [−1, 5]]; no parameters.
pub(crate) struct TwoMasses;

static PAIR_JOINTS: [JointInfo; 2] = [joint("one"), joint("two")];
static PAIR_INPUTS: [InputInfo; 2] = [input(0), input(1)];

impl Dynamics for TwoMasses {
    fn name(&self) -> &str {
        "TwoMasses"
    }
    fn dims(&self) -> Dims {
        Dims {
            nq: 2,
            nu: 2,
            np: 0,
        }
    }
    fn params(&self) -> &[ParamInfo] {
        &[]
    }
    fn joints(&self) -> &[JointInfo] {
        &PAIR_JOINTS
    }
    fn inputs(&self) -> &[InputInfo] {
        &PAIR_INPUTS
    }
    fn mass_matrix(&self, _: &At<'_>, m: &mut [f64]) {
        m.copy_from_slice(&[2.0, 1.0, 2.0]);
    }
    fn bias(&self, at: &At<'_>, b: &mut [f64]) {
        b[0] = 5.0 * at.q[0] - at.q[1];
        b[1] = 5.0 * at.q[1] - at.q[0];
    }
    fn applied_force(&self, at: &At<'_>, f: &mut [f64]) {
        f.copy_from_slice(at.u);
    }
    fn residual(&self, at: &At<'_>, r: &mut [f64]) {
        self.bias(at, r);
        r[0] += 2.0 * at.a[0] + at.a[1] - at.u[0];
        r[1] += at.a[0] + 2.0 * at.a[1] - at.u[1];
    }
    fn kinetic_energy(&self, at: &At<'_>) -> f64 {
        at.v[0] * at.v[0] + at.v[0] * at.v[1] + at.v[1] * at.v[1]
    }
    fn potential_energy(&self, at: &At<'_>) -> f64 {
        2.5 * (at.q[0] * at.q[0] + at.q[1] * at.q[1]) - at.q[0] * at.q[1]
    }
}

impl Jacobian for TwoMasses {
    fn jacobian_pattern(&self) -> Pattern<'_> {
        Pattern {
            rows: &[0, 0, 0, 0, 0, 1, 1, 1, 1, 1],
            cols: &[0, 1, 4, 5, 6, 0, 1, 4, 5, 7],
        }
    }
    fn residual_jacobian(&self, at: &At<'_>, r: &mut [f64], values: &mut [f64]) {
        self.residual(at, r);
        values.copy_from_slice(&[5.0, -1.0, 2.0, 1.0, -1.0, -1.0, 5.0, 1.0, 2.0, -1.0]);
    }
}

/// Two point masses of 1 kg on rods of 1 m, angles from the vertical, both absolute; no derivatives.
pub(crate) struct DoublePendulum;

impl Dynamics for DoublePendulum {
    fn name(&self) -> &str {
        "DoublePendulum"
    }
    fn dims(&self) -> Dims {
        Dims {
            nq: 2,
            nu: 2,
            np: 0,
        }
    }
    fn params(&self) -> &[ParamInfo] {
        &[]
    }
    fn joints(&self) -> &[JointInfo] {
        &PAIR_JOINTS
    }
    fn inputs(&self) -> &[InputInfo] {
        &PAIR_INPUTS
    }
    fn mass_matrix(&self, at: &At<'_>, m: &mut [f64]) {
        m.copy_from_slice(&[2.0, (at.q[0] - at.q[1]).cos(), 1.0]);
    }
    fn bias(&self, at: &At<'_>, b: &mut [f64]) {
        let s = (at.q[0] - at.q[1]).sin();
        b[0] = s * at.v[1] * at.v[1] + 2.0 * 9.81 * at.q[0].sin();
        b[1] = -s * at.v[0] * at.v[0] + 9.81 * at.q[1].sin();
    }
    fn applied_force(&self, at: &At<'_>, f: &mut [f64]) {
        f.copy_from_slice(at.u);
    }
    fn residual(&self, at: &At<'_>, r: &mut [f64]) {
        let c = (at.q[0] - at.q[1]).cos();
        self.bias(at, r);
        r[0] += 2.0 * at.a[0] + c * at.a[1] - at.u[0];
        r[1] += c * at.a[0] + at.a[1] - at.u[1];
    }
    fn kinetic_energy(&self, at: &At<'_>) -> f64 {
        let (v, c) = (at.v, (at.q[0] - at.q[1]).cos());
        v[0] * v[0] + c * v[0] * v[1] + 0.5 * v[1] * v[1]
    }
    fn potential_energy(&self, at: &At<'_>) -> f64 {
        -9.81 * (2.0 * at.q[0].cos() + at.q[1].cos())
    }
}
