//! The drive goes to its targets at a limited speed: |dr_s/dt| ≤ s before the position loop.
//!
//! Source: L. Biagiotti, C. Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008, chapter 4.

use pid_interpret::nominal::Gain;

use crate::constants::{Constant, Constants};
use crate::effect::{Class, Info, Kind, Law, Model, Unit, parameter};
use crate::scalar::Scalar;

/// The drive goes to its targets at a limited speed.
#[derive(Debug, Clone, Copy, Default)]
pub struct CommandSpeedLimit;

static INFO: Info = Info {
    id: "command_speed_limit",
    title: "The drive goes to its targets at a limited speed",
    equation: "|dr_s/dt| ≤ s before the position loop",
    source: "L. Biagiotti, C. Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008, chapter 4",
    kind: Kind::Channel,
    class: Class::InputTiming,
    has_joint: true,
    parameters: &[parameter("speed", "rad/s", Unit::Speed, 0.05, 1.5)],
    starts: &[&[0.8], &[0.5], &[0.3]],
    amplitudes: &[],
    confusions: &[
        (
            "torque_saturation",
            "a limited torque limits accelerations, not speeds",
        ),
        ("quadratic_drag", "drag slows gradually"),
    ],
    regime: "targets that move faster than the limit",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for CommandSpeedLimit {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn stage(&self) -> Option<Gain> {
        Some(Gain::TargetSpeed)
    }
}

impl<D: Scalar> Law<D> for CommandSpeedLimit {
    fn constants(&self, e: &[D], joint: usize, constants: &mut Constants<D>) {
        constants.add(Constant::Servo(Gain::TargetSpeed, joint), e[0]);
    }
}
