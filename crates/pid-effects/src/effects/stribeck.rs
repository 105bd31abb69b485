//! Friction rises towards standstill: friction level f_c (1 + x exp(−(v/v_s)²)), x = static/Coulomb − 1.
//!
//! Source: R. Stribeck 1902; B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, Automatica 30(7),
//! 1994, section 2.1.

use crate::effect::{
    Class, Friction, Info, Kind, Law, Model, Quantity, Site, Source, Unit, parameter, quantity,
};
use crate::scalar::Scalar;

/// Friction rises towards standstill.
#[derive(Debug, Clone, Copy, Default)]
pub struct Stribeck;

static INFO: Info = Info {
    id: "stribeck",
    title: "Friction rises towards standstill",
    equation: "friction level f_c (1 + x exp(−(v/v_s)²)), x = static/Coulomb − 1",
    source: "R. Stribeck 1902; B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, Automatica 30(7), 1994, section 2.1",
    kind: Kind::Force,
    class: Class::Velocity,
    has_joint: true,
    parameters: &[
        parameter("excess", "1", Unit::One, 0.0, 8.0),
        parameter("stribeck_velocity", "rad/s", Unit::Speed, 0.004, 0.8),
    ],
    starts: &[
        &[0.5, 0.015],
        &[0.5, 0.035],
        &[0.5, 0.08],
        &[0.5, 0.18],
        &[0.5, 0.4],
    ],
    amplitudes: &[0],
    confusions: &[
        (
            "presliding_hysteresis",
            "presliding depends on the distance since the reversal and has a memory; this is a function of speed alone",
        ),
        ("quadratic_drag", "drag grows with speed, this falls"),
    ],
    regime: "slow motion, below a few Stribeck velocities",
    equals: &[],
    mujoco: Some("actuator dcmotor, lugre, whose bristles give way before they slide"),
    isaac: Some("actuator friction (static) and dynamic_friction: a jump in place of the curve"),
    urdf: None,
};

impl Model for Stribeck {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn source(&self) -> Option<Source> {
        Some(Source {
            own: "-{coulomb}*{excess}*exp(-({v}/{stribeck_velocity})^2)*{sign}",
            before: None,
        })
    }
    fn shown(&self, e: &[f64], _gain: f64, _rated: f64) -> Vec<Quantity> {
        vec![
            quantity("static_to_coulomb", "1", 1.0 + e[0]),
            quantity("stribeck_velocity", "rad/s", e[1]),
        ]
    }
}

impl<D: Scalar> Law<D> for Stribeck {
    fn friction(&self, e: &[D], at: &Site<'_, D>, _memory: &[D], f: &mut Friction<D>) {
        let x = at.v[at.joint] / e[1];
        let factor = e[0] * (-(x * x)).exponential() + 1.0;
        f.forward = f.forward * factor;
        f.backward = f.backward * factor;
    }
}
