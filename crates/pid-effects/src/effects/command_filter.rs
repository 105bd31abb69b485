//! The drive filters its targets: T dr_f/dt = r − r_f before the position loop.
//!
//! Source: L. Biagiotti, C. Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008, chapter 4.

use pid_interpret::nominal::Gain;

use crate::constants::{Constant, Constants};
use crate::effect::{Class, Info, Kind, Law, Model, Unit, parameter};
use crate::scalar::Scalar;

/// The drive filters its targets.
#[derive(Debug, Clone, Copy, Default)]
pub struct CommandFilter;

static INFO: Info = Info {
    id: "command_filter",
    title: "The drive filters its targets",
    equation: "T dr_f/dt = r − r_f before the position loop",
    source: "L. Biagiotti, C. Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008, chapter 4",
    kind: Kind::Channel,
    class: Class::InputTiming,
    has_joint: true,
    parameters: &[parameter("time_constant_s", "s", Unit::Time, 0.0005, 0.5)],
    starts: &[&[0.008], &[0.03], &[0.1]],
    amplitudes: &[],
    confusions: &[
        (
            "input_delay",
            "a delay keeps the amplitude; they differ at frequencies near 1/T",
        ),
        (
            "velocity_feed_forward",
            "a loop that lacks it lags by a time too, but by its own gains",
        ),
        ("actuator_lag", "inside the loop a lag takes damping away"),
    ],
    regime: "fast changes of the target",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for CommandFilter {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn stage(&self) -> Option<Gain> {
        Some(Gain::TargetTime)
    }
}

impl<D: Scalar> Law<D> for CommandFilter {
    fn constants(&self, e: &[D], joint: usize, constants: &mut Constants<D>) {
        constants.add(Constant::Servo(Gain::TargetTime, joint), e[0]);
    }
}
