//! The drive goes to its targets along a profile with a limited acceleration: |d²r_p/dt²| ≤ a, and r_p rests at r,
//! before the position loop.
//!
//! Source: L. Biagiotti, C. Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008, section 3.2.

use pid_interpret::nominal::Gain;

use crate::constants::{Constant, Constants};
use crate::effect::{Class, Info, Kind, Law, Model, Unit, parameter};
use crate::scalar::Scalar;

/// The drive goes to its targets along a profile with a limited acceleration.
#[derive(Debug, Clone, Copy, Default)]
pub struct CommandAccelerationLimit;

static INFO: Info = Info {
    id: "command_acceleration_limit",
    title: "The drive goes to its targets along a profile with a limited acceleration",
    equation: "|d²r_p/dt²| ≤ a, and r_p rests at r, before the position loop",
    source: "L. Biagiotti, C. Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008, section 3.2",
    kind: Kind::Channel,
    class: Class::InputTiming,
    has_joint: true,
    parameters: &[parameter(
        "acceleration",
        "rad/s^2",
        Unit::Acceleration,
        0.05,
        100.0,
    )],
    starts: &[&[8.0], &[2.0], &[0.7]],
    amplitudes: &[],
    confusions: &[
        (
            "command_speed_limit",
            "a largest speed bounds long ways, an acceleration short ones too",
        ),
        (
            "command_filter",
            "a filter slows all motions by one time, a profile large steps more than small ones",
        ),
        (
            "torque_saturation",
            "a limited torque accelerates less where the inertia is larger",
        ),
    ],
    regime: "targets that jump",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for CommandAccelerationLimit {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn stage(&self) -> Option<Gain> {
        Some(Gain::TargetAcceleration)
    }
}

impl<D: Scalar> Law<D> for CommandAccelerationLimit {
    fn constants(&self, e: &[D], joint: usize, constants: &mut Constants<D>) {
        constants.add(Constant::Servo(Gain::TargetAcceleration, joint), e[0]);
    }
}
