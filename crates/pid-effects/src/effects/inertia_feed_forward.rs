//! The drive feeds the acceleration of its targets forward: u + s (M̂(q) r̈)/k̂ with the mass matrix M̂ and the motor
//! gain k̂ that the drive knows.
//!
//! Source: W. Leonhard, Control of Electrical Drives, 2001, chapter 15.

use pid_interpret::nominal::Gain;

use crate::constants::{Constant, Constants};
use crate::effect::{Class, Info, Kind, Law, Model, Unit, parameter};
use crate::scalar::Scalar;

/// The drive feeds the acceleration of its targets forward.
#[derive(Debug, Clone, Copy, Default)]
pub struct InertiaFeedForward;

static INFO: Info = Info {
    id: "inertia_feed_forward",
    title: "The drive feeds the acceleration of its targets forward",
    equation: "u + s (M̂(q) r̈)/k̂ with the mass matrix M̂ and the motor gain k̂ that the drive knows",
    source: "W. Leonhard, Control of Electrical Drives, 2001, chapter 15",
    kind: Kind::Channel,
    class: Class::InputTiming,
    has_joint: true,
    parameters: &[parameter("share", "1", Unit::Share, 0.0, 1.5)],
    starts: &[&[0.8]],
    amplitudes: &[0],
    confusions: &[
        (
            "unmodelled_rotor_inertia",
            "a rotor acts on the motion, feed-forward on the target: they differ where the joint does not follow",
        ),
        (
            "velocity_feed_forward",
            "that goes with the velocity of the target",
        ),
    ],
    regime: "targets that are accelerated",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for InertiaFeedForward {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn stage(&self) -> Option<Gain> {
        Some(Gain::InertiaAhead)
    }
}

impl<D: Scalar> Law<D> for InertiaFeedForward {
    fn constants(&self, e: &[D], joint: usize, constants: &mut Constants<D>) {
        constants.add(Constant::Servo(Gain::InertiaAhead, joint), e[0]);
    }
}
