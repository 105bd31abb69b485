//! A gain of the drive that drifts to another one: u_a = u (1 − c (1 − exp(−t/T))).
//!
//! Source: heat of a winding: P. C. Krause et al., 2013, section 2.3.

use crate::effect::{Class, Commands, Info, Kind, Law, Model, ReadOff, Unit, parameter};
use crate::scalar::Scalar;

/// A gain that drifts with the time.
#[derive(Debug, Clone, Copy, Default)]
pub struct GainOverTime;

static INFO: Info = Info {
    id: "gain_over_time",
    title: "A gain that drifts with the time",
    equation: "u_a = u (1 − c (1 − exp(−t/T)))",
    source: "heat of a winding: P. C. Krause et al., 2013, section 2.3",
    kind: Kind::Channel,
    class: Class::Time,
    has_joint: true,
    parameters: &[
        parameter("loss", "1", Unit::One, -3.0, 0.95),
        parameter("time_constant_s", "s", Unit::Time, 0.2, 1e3),
    ],
    starts: &[],
    amplitudes: &[0],
    confusions: &[],
    regime: "the trend over t, repeated in every record",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for GainOverTime {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn read_off(&self) -> Option<ReadOff> {
        Some(ReadOff::TimeConstant { parameter: 1 })
    }
}

impl<D: Scalar> Law<D> for GainOverTime {
    fn input(&self, e: &[D], u: D, at: &Commands<'_>, _memory: &mut [D]) -> D {
        let t = at.begin + at.t + 0.5 * at.dt;
        let gone = -(-(e[1].inverse() * t)).exponential() + 1.0;
        u * (-(e[0] * gone) + 1.0)
    }
}
