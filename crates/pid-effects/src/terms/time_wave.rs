//! A force that waves over the time: additional force a sin(ω t) + b cos(ω t).
//!
//! Source: Fourier series, from the start of every record.

use crate::constants::Constants;
use crate::effect::{Class, Forces, Info, Kind, Law, Model, ReadOff, Site, Unit, parameter};
use crate::scalar::Scalar;

/// A force that waves over the time.
#[derive(Debug, Clone, Copy, Default)]
pub struct TimeWave;

static INFO: Info = Info {
    id: "time_wave",
    title: "A force that waves over the time",
    equation: "additional force a sin(ω t) + b cos(ω t)",
    source: "Fourier series, from the start of every record",
    kind: Kind::Force,
    class: Class::Time,
    has_joint: true,
    parameters: &[
        parameter("sine", "N*m", Unit::Torque, -2.0, 2.0),
        parameter("cosine", "N*m", Unit::Torque, -2.0, 2.0),
        parameter("angular_frequency", "1/s", Unit::One, 0.0, 1e4),
    ],
    starts: &[],
    amplitudes: &[0, 1],
    confusions: &[],
    regime: "all of the time, repeated in every record",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for TimeWave {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn read_off(&self) -> Option<ReadOff> {
        Some(ReadOff::TimeWave { wave: 2 })
    }
}

impl<D: Scalar> Law<D> for TimeWave {
    fn force(
        &self,
        e: &[D],
        at: &Site<'_, D>,
        _memory: &[D],
        f: &mut Forces<'_, D>,
        _constants: &Constants<D>,
    ) {
        let (sine, cosine) = (e[2] * at.t).sine_cosine();
        f.value[at.joint] += e[0] * sine + e[1] * cosine;
    }
}
