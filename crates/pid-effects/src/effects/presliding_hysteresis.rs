//! The joint gives way elastically before it slides: dz/dt = v − |v| z/z_s, friction f_c (z + T₁
//! dz/dt)/z_s in place of dry friction.
//!
//! Source: P. R. Dahl 1968; C. Canudas de Wit, H. Olsson, K. J. Åström, P. Lischinsky, IEEE TAC
//! 40(3), 1995, with a constant level.

use crate::constants::{Constant, Constants};
use crate::effect::{
    After, Class, Flow, Flowing, Forces, Friction, Info, Kind, Law, Model, Site, Unit, parameter,
};
use crate::scalar::Scalar;

/// The joint gives way elastically before it slides.
#[derive(Debug, Clone, Copy, Default)]
pub struct PreslidingHysteresis;

static INFO: Info = Info {
    id: "presliding_hysteresis",
    title: "The joint gives way elastically before it slides",
    equation: "dz/dt = v − |v| z/z_s, friction f_c (z + T₁ dz/dt)/z_s in place of dry friction",
    source: "P. R. Dahl 1968; C. Canudas de Wit, H. Olsson, K. J. Åström, P. Lischinsky, IEEE TAC 40(3), 1995, with a constant level",
    kind: Kind::State,
    class: Class::Reversal,
    has_joint: true,
    parameters: &[
        parameter("presliding_range", "rad", Unit::Range, 1e-05, 0.2),
        parameter("micro_damping_time", "s", Unit::Time, 0.0, 0.02),
    ],
    starts: &[
        &[0.0006, 0.001],
        &[0.002, 0.001],
        &[0.007, 0.001],
        &[0.025, 0.001],
    ],
    amplitudes: &[],
    confusions: &[
        (
            "stribeck",
            "Stribeck is a function of speed, without memory",
        ),
        (
            "joint_elasticity",
            "elasticity follows the torque, without regard to the amplitude",
        ),
        ("backlash", "backlash transmits nothing within its travel"),
    ],
    regime: "reversals and standstill",
    equals: &[],
    mujoco: Some("actuator dcmotor, lugre"),
    isaac: None,
    urdf: None,
};

/// `exp(−x)`, `A = (1 − exp(−x))/x` and `(1 − A)/x` for x ≥ 0.
fn passage<D: Scalar>(x: D) -> (D, D, D) {
    if x.value() < 1e-3 {
        // Three terms of the series: the next is below 1e-13.
        let mean = -x * (-x / 3.0 + 1.0) * 0.5 + 1.0;
        let lag = -x * (-x * 0.25 + 1.0) / 6.0 + 0.5;
        return (-x * mean + 1.0, mean, lag);
    }
    let decay = (-x).exponential();
    let mean = (-decay + 1.0) / x;
    (decay, mean, (-mean + 1.0) / x)
}

impl Model for PreslidingHysteresis {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn memory(&self) -> usize {
        1
    }
    fn largest_memory(&self) -> Option<f64> {
        Some(1.0)
    }
}

impl<D: Scalar> Law<D> for PreslidingHysteresis {
    fn friction(&self, _e: &[D], _at: &Site<'_, D>, _memory: &[D], f: &mut Friction<D>) {
        f.forward = D::nil();
        f.backward = D::nil();
    }
    fn force(
        &self,
        e: &[D],
        at: &Site<'_, D>,
        memory: &[D],
        f: &mut Forces<'_, D>,
        constants: &Constants<D>,
    ) {
        // s = z / z_s over a step of constant speed is s E + (1 − E) sgn v, E = exp(−x), x = δ
        // |v|/z_s; its mean is s A + (1 − A) sgn v, A = (1 − E)/x. The speed that multiplies is
        // that of the step, implicitly.
        let level = constants.get(Constant::Coulomb(at.joint));
        let travel = e[0].inverse() * at.dt;
        let (decay, mean, lag) = passage(at.v[at.joint].magnitude() * travel);
        let micro = e[1] / at.dt;
        f.value[at.joint] -= level * memory[0] * (mean + micro * (decay - 1.0));
        f.rate[at.joint] += level * travel * (lag + micro * mean);
    }
    fn advance(&self, e: &[D], after: &After<D>, memory: &mut [D]) {
        let w = after.v * after.dt / e[0];
        let (decay, mean, _) = passage(w.magnitude());
        memory[0] = memory[0] * decay + w * mean;
    }
    fn flow(&self, e: &[D], at: &Flow<D>) -> Option<Flowing<D>> {
        // w = z / z_s.
        let rate = at.v - at.speed * at.w;
        Some(Flowing {
            time: e[0],
            rate,
            input: None,
            friction: Some(at.coulomb * (at.w + e[1] / e[0] * rate)),
        })
    }
    fn start(&self, _e: &[D], balance: D, coulomb: D, _u: f64, memory: &mut [D]) {
        memory[0] = (balance / (coulomb + 1e-12)).limit(D::constant(-1.0), D::constant(1.0));
    }
}
