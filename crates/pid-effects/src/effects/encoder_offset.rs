//! The encoder zero is wrong: reading q + d.
//!
//! Source: W. Khalil, E. Dombre 2002, section 11.3.

use crate::effect::{Class, EqualWhen, Info, Kind, Law, Model, Unit, parameter};
use crate::scalar::Scalar;

/// The encoder zero is wrong.
#[derive(Debug, Clone, Copy, Default)]
pub struct EncoderOffset;

static INFO: Info = Info {
    id: "encoder_offset",
    title: "The encoder zero is wrong",
    equation: "reading q + d",
    source: "W. Khalil, E. Dombre 2002, section 11.3",
    kind: Kind::Channel,
    class: Class::Position,
    has_joint: true,
    parameters: &[parameter("offset", "rad", Unit::Range, -0.3, 0.3)],
    starts: &[&[0.005]],
    amplitudes: &[0],
    confusions: &[
        (
            "base_tilt",
            "in the plane of a planar arm a tilt is the same as an offset of joint 1",
        ),
        (
            "payload",
            "on the last joint an offset turns the centre of mass",
        ),
    ],
    regime: "gravity and the coupling to other joints",
    equals: &[("base_tilt", EqualWhen::FirstOfVerticalPlane)],
    mujoco: Some("joint ref"),
    isaac: Some("frame of the joint, turned or moved along its axis by the offset"),
    urdf: Some("origin of the joint, turned or moved along its axis by the offset"),
};

impl Model for EncoderOffset {
    fn info(&self) -> &'static Info {
        &INFO
    }
}

impl<D: Scalar> Law<D> for EncoderOffset {
    fn sense(&self, e: &[D], q: D, v: D) -> (D, D) {
        (q + e[0], v)
    }
}
