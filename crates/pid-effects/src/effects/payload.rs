//! An unmodelled mass at the tool: point mass at the tool point.
//!
//! Source: W. Khalil, M. Gautier, P. Lemoine, IEEE ICRA 2007.

use crate::constants::Constants;
use crate::effect::{Class, EqualWhen, Info, Kind, Law, Model, Unit, parameter};
use crate::scalar::Scalar;

/// An unmodelled mass at the tool.
#[derive(Debug, Clone, Copy, Default)]
pub struct Payload;

static INFO: Info = Info {
    id: "payload",
    title: "An unmodelled mass at the tool",
    equation: "point mass at the tool point",
    source: "W. Khalil, M. Gautier, P. Lemoine, IEEE ICRA 2007",
    kind: Kind::Force,
    class: Class::Inertia,
    has_joint: false,
    parameters: &[parameter("mass", "kg", Unit::Mass, -0.2, 5.0)],
    starts: &[&[0.05]],
    amplitudes: &[0],
    confusions: &[
        ("unmodelled_rotor_inertia", "a payload also changes gravity"),
        (
            "encoder_offset",
            "an offset of the last joint turns its centre of mass",
        ),
    ],
    regime: "gravity and acceleration of the last link",
    equals: &[(
        "unmodelled_rotor_inertia",
        EqualWhen::OneJointWithoutGravity,
    )],
    mujoco: Some("body mass and inertia"),
    isaac: Some("link mass and inertia"),
    urdf: Some("link inertial"),
};

impl Model for Payload {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn needs_bodies(&self) -> bool {
        true
    }
}

impl<D: Scalar> Law<D> for Payload {
    fn constants(&self, e: &[D], _joint: usize, constants: &mut Constants<D>) {
        if let Some((body, at)) = constants.tool() {
            constants.add_point_mass(body, e[0], at);
        }
    }
}
