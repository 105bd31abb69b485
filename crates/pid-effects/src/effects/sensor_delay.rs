//! The readings come later: q and dq are read T after they were true.
//!
//! Source: K. J. Åström, B. Wittenmark 1997, section 2.3.

use crate::effect::{Class, EqualWhen, Info, Kind, Law, Model, Unit, parameter};
use crate::scalar::Scalar;

/// The readings come later.
#[derive(Debug, Clone, Copy, Default)]
pub struct SensorDelay;

static INFO: Info = Info {
    id: "sensor_delay",
    title: "The readings come later",
    equation: "q and dq are read T after they were true",
    source: "K. J. Åström, B. Wittenmark 1997, section 2.3",
    kind: Kind::Channel,
    class: Class::PositionTiming,
    has_joint: true,
    parameters: &[parameter("delay_s", "s", Unit::Time, 0.0, 0.25)],
    starts: &[&[0.003], &[0.01], &[0.03]],
    amplitudes: &[0],
    confusions: &[
        (
            "input_delay",
            "on one joint exactly the same map from input to readings",
        ),
        ("actuator_lag", "a lag also attenuates"),
    ],
    regime: "fast motion",
    equals: &[("input_delay", EqualWhen::OneJoint)],
    mujoco: Some("sensor delay, with nsample"),
    isaac: None,
    urdf: None,
};

impl Model for SensorDelay {
    fn info(&self) -> &'static Info {
        &INFO
    }
}

impl<D: Scalar> Law<D> for SensorDelay {
    fn reading_delay(&self, e: &[D]) -> Option<D> {
        Some(e[0])
    }
}
