//! The drive makes up for gravity by itself: u + s ĝ(q)/k̂ with the gravity ĝ and the motor gain k̂ that the drive
//! knows.
//!
//! Source: M. Takegaki, S. Arimoto, Journal of Dynamic Systems, Measurement, and Control 103, 1981.

use pid_interpret::nominal::Gain;

use crate::constants::{Constant, Constants};
use crate::effect::{Class, Info, Kind, Law, Model, Unit, parameter};
use crate::scalar::Scalar;

/// The drive makes up for gravity by itself.
#[derive(Debug, Clone, Copy, Default)]
pub struct GravityFeedForward;

static INFO: Info = Info {
    id: "gravity_feed_forward",
    title: "The drive makes up for gravity by itself",
    equation: "u + s ĝ(q)/k̂ with the gravity ĝ and the motor gain k̂ that the drive knows",
    source: "M. Takegaki, S. Arimoto, Journal of Dynamic Systems, Measurement, and Control 103, 1981",
    kind: Kind::Channel,
    class: Class::Position,
    has_joint: true,
    parameters: &[parameter("share", "1", Unit::Share, 0.0, 1.5)],
    starts: &[&[0.8]],
    amplitudes: &[0],
    confusions: &[
        (
            "external_force",
            "a force at the tool that lasts is the same on one joint",
        ),
        ("payload", "a load changes inertia too"),
        (
            "spring",
            "a spring pulls to a place, gravity with the sine of the angle",
        ),
    ],
    regime: "different postures",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for GravityFeedForward {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn stage(&self) -> Option<Gain> {
        Some(Gain::Gravity)
    }
}

impl<D: Scalar> Law<D> for GravityFeedForward {
    fn constants(&self, e: &[D], joint: usize, constants: &mut Constants<D>) {
        constants.add(Constant::Servo(Gain::Gravity, joint), e[0]);
    }
}
