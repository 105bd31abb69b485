//! The encoder disc runs out of true: reading q + a sin q + b cos q; velocity times its derivative.
//!
//! Source: encoder data sheets; A = √(a² + b²).

use crate::effect::{Class, Info, Kind, Law, Model, Quantity, Unit, parameter, quantity};
use crate::scalar::Scalar;

/// The encoder disc runs out of true.
#[derive(Debug, Clone, Copy, Default)]
pub struct EncoderEccentricity;

static INFO: Info = Info {
    id: "encoder_eccentricity",
    title: "The encoder disc runs out of true",
    equation: "reading q + a sin q + b cos q; velocity times its derivative",
    source: "encoder data sheets; A = √(a² + b²)",
    kind: Kind::Channel,
    class: Class::Position,
    has_joint: true,
    parameters: &[
        parameter("sine", "rad", Unit::Angle, -0.3, 0.3),
        parameter("cosine", "rad", Unit::Angle, -0.3, 0.3),
    ],
    starts: &[&[0.005, 0.005]],
    amplitudes: &[0, 1],
    confusions: &[(
        "encoder_offset",
        "over a fraction of a turn it is an offset and an error of scale",
    )],
    regime: "motion over a large arc",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for EncoderEccentricity {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn shown(&self, e: &[f64], _gain: f64, _rated: f64) -> Vec<Quantity> {
        vec![
            quantity("amplitude", "rad", e[0].hypot(e[1])),
            quantity("phase", "rad", e[1].atan2(e[0])),
        ]
    }
}

impl<D: Scalar> Law<D> for EncoderEccentricity {
    fn sense(&self, e: &[D], q: D, v: D) -> (D, D) {
        let (s, c) = (q.sine(), q.cosine());
        (q + e[0] * s + e[1] * c, v * (e[0] * c - e[1] * s + 1.0))
    }
}
