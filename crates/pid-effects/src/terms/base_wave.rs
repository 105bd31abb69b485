//! A base that shakes: acceleration a sin(ω t) + b cos(ω t) along each of its axes.
//!
//! The links feel gravity less that.
//!
//! Source: Fourier series, from the start of every record.

use crate::effect::{Class, Info, Kind, Law, Model, ReadOff, Unit, parameter};
use crate::scalar::Scalar;

/// A base that shakes.
#[derive(Debug, Clone, Copy, Default)]
pub struct BaseWave;

static INFO: Info = Info {
    id: "base_wave",
    title: "A base that shakes",
    equation: "acceleration of the base a sin(ω t) + b cos(ω t)",
    source: "Fourier series, from the start of every record",
    kind: Kind::Force,
    class: Class::Time,
    has_joint: false,
    parameters: &[
        parameter("sine_x", "m/s^2", Unit::One, -50.0, 50.0),
        parameter("sine_y", "m/s^2", Unit::One, -50.0, 50.0),
        parameter("sine_z", "m/s^2", Unit::One, -50.0, 50.0),
        parameter("cosine_x", "m/s^2", Unit::One, -50.0, 50.0),
        parameter("cosine_y", "m/s^2", Unit::One, -50.0, 50.0),
        parameter("cosine_z", "m/s^2", Unit::One, -50.0, 50.0),
        parameter("angular_frequency", "1/s", Unit::One, 0.0, 1e4),
    ],
    starts: &[],
    amplitudes: &[0, 1, 2, 3, 4, 5],
    confusions: &[],
    regime: "all of the time, repeated in every record",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for BaseWave {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn needs_bodies(&self) -> bool {
        true
    }
    fn read_off(&self) -> Option<ReadOff> {
        Some(ReadOff::BaseWave { wave: 6 })
    }
}

impl<D: Scalar> Law<D> for BaseWave {
    fn base_acceleration(&self, e: &[D], t: f64) -> Option<[D; 3]> {
        let (sine, cosine) = (e[6] * t).sine_cosine();
        Some([0, 1, 2].map(|i| e[i] * sine + e[3 + i] * cosine))
    }
}
