//! A constant error of the input: u_a = u + u₀.
//!
//! Source: data sheets of current sensors.

use crate::effect::{Class, Commands, EqualWhen, Info, Kind, Law, Model, Source, Unit, parameter};
use crate::scalar::Scalar;

/// A constant error of the input.
#[derive(Debug, Clone, Copy, Default)]
pub struct CurrentOffset;

static INFO: Info = Info {
    id: "current_offset",
    title: "A constant error of the input",
    equation: "u_a = u + u₀",
    source: "data sheets of current sensors",
    kind: Kind::Channel,
    class: Class::Position,
    has_joint: true,
    parameters: &[parameter("offset", "A", Unit::Input, -1.0, 1.0)],
    starts: &[&[0.02]],
    amplitudes: &[0],
    confusions: &[
        ("coulomb_asymmetry", "asymmetry grows with speed"),
        (
            "spring",
            "a soft spring far from its rest is a constant force",
        ),
    ],
    regime: "any motion",
    equals: &[("coulomb_asymmetry", EqualWhen::NoViscousFriction)],
    mujoco: Some("actuator biasprm, first entry: gain times the offset"),
    isaac: None,
    urdf: None,
};

impl Model for CurrentOffset {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn source(&self) -> Option<Source> {
        Some(Source {
            own: "{gain}*{offset}",
            before: None,
        })
    }
}

impl<D: Scalar> Law<D> for CurrentOffset {
    fn input(&self, e: &[D], u: D, _at: &Commands<'_>, _memory: &mut [D]) -> D {
        u + e[0]
    }
}
