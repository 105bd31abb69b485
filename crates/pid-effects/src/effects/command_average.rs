//! The drive averages its targets over a time: r_a = 1/T ∫ r over the time T before, before the position loop.
//!
//! Source: L. Biagiotti, C. Melchiorri, Control Engineering Practice 20, 2012.

use pid_interpret::nominal::Gain;

use crate::constants::{Constant, Constants};
use crate::effect::{Class, Info, Kind, Law, Model, Unit, parameter};
use crate::scalar::Scalar;

/// The drive averages its targets over a time.
#[derive(Debug, Clone, Copy, Default)]
pub struct CommandAverage;

static INFO: Info = Info {
    id: "command_average",
    title: "The drive averages its targets over a time",
    equation: "r_a = 1/T ∫ r over the time T before, before the position loop",
    source: "L. Biagiotti, C. Melchiorri, Control Engineering Practice 20, 2012",
    kind: Kind::Channel,
    class: Class::InputTiming,
    has_joint: true,
    parameters: &[parameter("time_s", "s", Unit::Time, 0.001, 0.5)],
    starts: &[&[0.016], &[0.06], &[0.2]],
    amplitudes: &[],
    confusions: &[
        ("command_filter", "a filter has a tail, an average ends"),
        (
            "input_delay",
            "a delay of half the time is the same for slow motions",
        ),
    ],
    regime: "fast changes of the target",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for CommandAverage {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn stage(&self) -> Option<Gain> {
        Some(Gain::TargetAverage)
    }
}

impl<D: Scalar> Law<D> for CommandAverage {
    fn constants(&self, e: &[D], joint: usize, constants: &mut Constants<D>) {
        constants.add(Constant::Servo(Gain::TargetAverage, joint), e[0]);
    }
}
