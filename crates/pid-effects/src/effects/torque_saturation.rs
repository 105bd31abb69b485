//! The drive limits its torque: k u_a within ± limit.
//!
//! Source: data sheets of drives; K. J. Åström, L. Rundqwist, ACC 1989.

use crate::effect::{
    Class, Commands, Info, Kind, Law, Model, Quantity, Source, Unit, parameter, quantity,
};
use crate::scalar::Scalar;

/// The drive limits its torque.
#[derive(Debug, Clone, Copy, Default)]
pub struct TorqueSaturation;

static INFO: Info = Info {
    id: "torque_saturation",
    title: "The drive limits its torque",
    equation: "k u_a within ± limit",
    source: "data sheets of drives; K. J. Åström, L. Rundqwist, ACC 1989",
    kind: Kind::Channel,
    class: Class::Load,
    has_joint: true,
    parameters: &[parameter("limit_input", "A", Unit::Input, 0.05, 1.2)],
    starts: &[&[0.9], &[0.7], &[0.5], &[0.3]],
    amplitudes: &[],
    confusions: &[(
        "gain_error_nonlinear",
        "a gain law bends smoothly, a limit has a corner",
    )],
    regime: "large inputs",
    equals: &[],
    mujoco: Some("actuator forcerange"),
    isaac: Some("actuator effort_limit; effort_limit_sim where the drive is implicit"),
    urdf: Some("limit effort"),
};

impl Model for TorqueSaturation {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn source(&self) -> Option<Source> {
        Some(Source {
            own: "{gain}*(0.5*sqrt(({input} + {limit_input})^2 + (0.01*{limit_input})^2) - 0.5*sqrt(({input} - {limit_input})^2 + (0.01*{limit_input})^2) - {input})",
            before: None,
        })
    }
    fn shown(&self, e: &[f64], gain: f64, _rated: f64) -> Vec<Quantity> {
        vec![quantity("limit", "N*m", e[0] * gain)]
    }
}

impl<D: Scalar> Law<D> for TorqueSaturation {
    fn input(&self, e: &[D], u: D, _at: &Commands<'_>, _memory: &mut [D]) -> D {
        u.limit(-e[0], e[0])
    }
}
