//! A force that waves over two positions: additional force a sin(φ) + b cos(φ), φ = w (q + r q_before),
//! on the joint or on the one before.
//!
//! Source: Fourier series over both positions.

use crate::constants::Constants;
use crate::effect::{
    Class, Forces, Info, Kind, Law, Model, ReadOff, Site, Source, Unit, parameter,
};
use crate::scalar::Scalar;

/// A force that waves over the positions of a joint and the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WaveOfTwo {
    /// On the joint.
    Own,
    /// On the joint before.
    Before,
}

static OWN: Info = Info {
    id: "wave_of_two",
    title: "A force that waves over two positions",
    equation: "additional force a sin(φ) + b cos(φ), φ = w (q + r q_before)",
    source: "Fourier series over both positions",
    kind: Kind::Force,
    class: Class::Coupling,
    has_joint: true,
    parameters: &[
        parameter("sine", "N*m", Unit::Torque, -2.0, 2.0),
        parameter("cosine", "N*m", Unit::Torque, -2.0, 2.0),
        parameter("periods_per_unit", "1/rad", Unit::Wave, 0.5, 140.0),
        parameter("ratio", "1", Unit::Ratio, -20.0, 20.0),
    ],
    starts: &[],
    amplitudes: &[0, 1],
    confusions: &[],
    regime: "motion of both joints",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

static BEFORE: Info = Info {
    id: "wave_of_two_before",
    title: "A force on the joint before that waves over both positions",
    equation: "additional force on the joint before a sin(φ) + b cos(φ), φ = w (q + r q_before)",
    ..OWN
};

/// The force in the words of `robot!`.
const WAVE: &str = "{sine}*sin({periods_per_unit}*({q} + {ratio}*{q_before})) + {cosine}*cos({periods_per_unit}*({q} + {ratio}*{q_before}))";

impl Model for WaveOfTwo {
    fn info(&self) -> &'static Info {
        match self {
            WaveOfTwo::Own => &OWN,
            WaveOfTwo::Before => &BEFORE,
        }
    }
    fn read_off(&self) -> Option<ReadOff> {
        Some(ReadOff::WaveOfTwo { wave: 2, ratio: 3 })
    }
    fn source(&self) -> Option<Source> {
        let (own, before) = match self {
            WaveOfTwo::Own => (WAVE, None),
            WaveOfTwo::Before => ("", Some(WAVE)),
        };
        Some(Source { own, before })
    }
    fn partner(&self, joint: usize) -> Option<usize> {
        joint.checked_sub(1)
    }
    fn needs_partner(&self) -> bool {
        true
    }
}

impl<D: Scalar> Law<D> for WaveOfTwo {
    fn force(
        &self,
        e: &[D],
        at: &Site<'_, D>,
        _memory: &[D],
        f: &mut Forces<'_, D>,
        _constants: &Constants<D>,
    ) {
        let Some(other) = at.joint.checked_sub(1) else {
            return;
        };
        let (sine, cosine) = (e[2] * (at.q[at.joint] + e[3] * at.q[other])).sine_cosine();
        let on = match self {
            WaveOfTwo::Own => at.joint,
            WaveOfTwo::Before => other,
        };
        f.value[on] += e[0] * sine + e[1] * cosine;
    }
}
