//! The drive reads its encoder late: q(t − T), v(t − T) in the position loop.
//!
//! Source: K. J. Åström, B. Wittenmark, Computer-Controlled Systems, 1997, section 2.3.

use pid_interpret::nominal::Gain;

use crate::constants::{Constant, Constants};
use crate::effect::{Class, Info, Kind, Law, Model, Unit, parameter};
use crate::scalar::Scalar;

/// The drive reads its encoder late.
#[derive(Debug, Clone, Copy, Default)]
pub struct FeedbackDelay;

static INFO: Info = Info {
    id: "feedback_delay",
    title: "The drive reads its encoder late",
    equation: "q(t − T), v(t − T) in the position loop",
    source: "K. J. Åström, B. Wittenmark, Computer-Controlled Systems, 1997, section 2.3",
    kind: Kind::Channel,
    class: Class::PositionTiming,
    has_joint: true,
    parameters: &[parameter("delay_s", "s", Unit::Time, 0.0, 0.1)],
    starts: &[&[0.003], &[0.01], &[0.03]],
    amplitudes: &[],
    confusions: &[
        ("actuator_lag", "a lag also attenuates"),
        (
            "joint_elasticity",
            "a gear rings at one frequency, a late loop at that of its gains",
        ),
        (
            "sensor_delay",
            "readings of the record are late too, the loop is not",
        ),
    ],
    regime: "a loop that rings",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for FeedbackDelay {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn stage(&self) -> Option<Gain> {
        Some(Gain::FeedbackDelay)
    }
}

impl<D: Scalar> Law<D> for FeedbackDelay {
    fn constants(&self, e: &[D], joint: usize, constants: &mut Constants<D>) {
        constants.add(Constant::Servo(Gain::FeedbackDelay, joint), e[0]);
    }
}
