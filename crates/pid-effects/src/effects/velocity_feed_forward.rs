//! The drive feeds the velocity of its targets forward: v̂ − s ṙ in place of v̂ in the position loop; in a
//! cascade w + s ṙ.
//!
//! Source: W. Leonhard, Control of Electrical Drives, 2001, chapter 15.

use pid_interpret::nominal::Gain;

use crate::constants::{Constant, Constants};
use crate::effect::{Class, Info, Kind, Law, Model, Unit, parameter};
use crate::scalar::Scalar;

/// The drive feeds the velocity of its targets forward.
#[derive(Debug, Clone, Copy, Default)]
pub struct VelocityFeedForward;

static INFO: Info = Info {
    id: "velocity_feed_forward",
    title: "The drive feeds the velocity of its targets forward",
    equation: "v̂ − s ṙ in place of v̂ in the position loop; in a cascade w + s ṙ",
    source: "W. Leonhard, Control of Electrical Drives, 2001, chapter 15",
    kind: Kind::Channel,
    class: Class::InputTiming,
    has_joint: true,
    parameters: &[parameter("share", "1", Unit::Share, 0.0, 1.5)],
    starts: &[&[0.8]],
    amplitudes: &[0],
    confusions: &[
        (
            "command_filter",
            "a filter makes the motion later, feed-forward earlier",
        ),
        ("input_delay", "a delay cannot be negative"),
    ],
    regime: "targets that move fast",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for VelocityFeedForward {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn stage(&self) -> Option<Gain> {
        Some(Gain::VelocityAhead)
    }
}

impl<D: Scalar> Law<D> for VelocityFeedForward {
    fn constants(&self, e: &[D], joint: usize, constants: &mut Constants<D>) {
        constants.add(Constant::Servo(Gain::VelocityAhead, joint), e[0]);
    }
}
