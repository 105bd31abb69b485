//! The velocity reading lags: T dw/dt = v − w, w is read.
//!
//! Source: drive manuals.

use crate::effect::{Class, Info, Kind, Law, Model, Unit, parameter};
use crate::scalar::Scalar;

/// The velocity reading lags.
#[derive(Debug, Clone, Copy, Default)]
pub struct VelocityFilterLag;

static INFO: Info = Info {
    id: "velocity_filter_lag",
    title: "The velocity reading lags",
    equation: "T dw/dt = v − w, w is read",
    source: "drive manuals",
    kind: Kind::Channel,
    class: Class::VelocityTiming,
    has_joint: true,
    parameters: &[parameter("time_constant_s", "s", Unit::Time, 0.0, 0.5)],
    starts: &[&[0.003], &[0.02]],
    amplitudes: &[],
    confusions: &[("sensor_delay", "a delayed encoder shifts the position too")],
    regime: "the velocity channel alone",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for VelocityFilterLag {
    fn info(&self) -> &'static Info {
        &INFO
    }
}

impl<D: Scalar> Law<D> for VelocityFilterLag {
    fn velocity_lag(&self, e: &[D]) -> Option<D> {
        Some(e[0])
    }
}
