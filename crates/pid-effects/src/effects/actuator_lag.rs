//! The drive answers with a first-order lag: T du_a/dt = u − u_a, exact for held commands.
//!
//! Source: G. F. Franklin, J. D. Powell, M. Workman, Digital Control of Dynamic Systems, 1998, section 4.3.

use crate::effect::{Class, Commands, Flow, Flowing, Info, Kind, Law, Model, Unit, parameter};
use crate::scalar::Scalar;

/// The drive answers with a first-order lag.
#[derive(Debug, Clone, Copy, Default)]
pub struct ActuatorLag;

static INFO: Info = Info {
    id: "actuator_lag",
    title: "The drive answers with a first-order lag",
    equation: "T du_a/dt = u − u_a, exact for held commands",
    source: "G. F. Franklin, J. D. Powell, M. Workman, Digital Control of Dynamic Systems, 1998, section 4.3",
    kind: Kind::State,
    class: Class::InputTiming,
    has_joint: true,
    parameters: &[parameter("time_constant_s", "s", Unit::Time, 0.0001, 0.4)],
    starts: &[&[0.002], &[0.008], &[0.025], &[0.07]],
    amplitudes: &[],
    confusions: &[
        (
            "input_delay",
            "a delay keeps the amplitude; they differ at frequencies near 1/T",
        ),
        ("sensor_delay", "for slow motion both shift the input"),
    ],
    regime: "fast changes of the input",
    equals: &[],
    mujoco: Some("actuator dyntype filterexact, time constant in dynprm"),
    isaac: None,
    urdf: None,
};

impl Model for ActuatorLag {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn memory(&self) -> usize {
        1
    }
}

impl<D: Scalar> Law<D> for ActuatorLag {
    fn input(&self, e: &[D], u: D, at: &Commands<'_>, memory: &mut [D]) -> D {
        let fade = (-(e[0].inverse() * at.dt)).exponential();
        let gone = memory[0] - u;
        memory[0] = u + gone * fade;
        u + gone * e[0] * (-fade + 1.0) / at.dt
    }
    fn flow(&self, e: &[D], at: &Flow<D>) -> Option<Flowing<D>> {
        Some(Flowing {
            time: e[0],
            rate: at.u - at.w,
            input: Some(at.w),
            friction: None,
        })
    }
    fn start(&self, _e: &[D], _balance: D, _coulomb: D, u: f64, memory: &mut [D]) {
        memory[0] = D::constant(u);
    }
}
