//! The drive acts later: u_a(t) = u(t − T).
//!
//! Source: K. J. Åström, B. Wittenmark, Computer-Controlled Systems, 1997, section 2.3.

use crate::effect::{Class, Commands, EqualWhen, Info, Kind, Law, Model, Unit, parameter};
use crate::scalar::Scalar;

/// The drive acts later.
#[derive(Debug, Clone, Copy, Default)]
pub struct InputDelay;

static INFO: Info = Info {
    id: "input_delay",
    title: "The drive acts later",
    equation: "u_a(t) = u(t − T)",
    source: "K. J. Åström, B. Wittenmark, Computer-Controlled Systems, 1997, section 2.3",
    kind: Kind::Channel,
    class: Class::InputTiming,
    has_joint: true,
    parameters: &[parameter("delay_s", "s", Unit::Time, 0.0, 0.25)],
    starts: &[&[0.003], &[0.01], &[0.03]],
    amplitudes: &[0],
    confusions: &[
        ("actuator_lag", "a lag also attenuates"),
        (
            "sensor_delay",
            "on one joint exactly the same map from input to readings",
        ),
    ],
    regime: "fast changes of the input",
    equals: &[("sensor_delay", EqualWhen::OneJoint)],
    mujoco: Some("actuator delay, with nsample"),
    isaac: Some("DelayedPDActuatorCfg min_delay and max_delay, in steps of the physics"),
    urdf: None,
};

impl Model for InputDelay {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn before_drive(&self) -> bool {
        true
    }
}

impl<D: Scalar> Law<D> for InputDelay {
    fn input(&self, e: &[D], _u: D, at: &Commands<'_>, _memory: &mut [D]) -> D {
        at.mean(e[0])
    }
}
