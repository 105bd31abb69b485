//! Force ripple over the position: additional force a sin(w q) + b cos(w q) = A sin(w q + φ).
//!
//! The motion must pass one and a half of its periods. Less shows no period, and would stand for
//! any force that depends on the position, such as a soft stop.
//!
//! Source: P. C. Krause et al., Analysis of Electric Machinery and Drive Systems, 2013, section 15.7.

use std::f64::consts::TAU;

use crate::constants::Constants;
use crate::effect::{
    Class, Forces, Info, Kind, Law, Model, Quantity, Site, Source, Unit, parameter, quantity,
};
use crate::scalar::Scalar;

/// Force ripple over the position.
#[derive(Debug, Clone, Copy, Default)]
pub struct Cogging;

static INFO: Info = Info {
    id: "cogging",
    title: "Force ripple over the position",
    equation: "additional force a sin(w q) + b cos(w q) = A sin(w q + φ)",
    source: "P. C. Krause et al., Analysis of Electric Machinery and Drive Systems, 2013, section 15.7",
    kind: Kind::Force,
    class: Class::Position,
    has_joint: true,
    parameters: &[
        parameter("sine", "N*m", Unit::Torque, -2.0, 2.0),
        parameter("cosine", "N*m", Unit::Torque, -2.0, 2.0),
        parameter("periods_per_unit", "1/rad", Unit::Wave, 1.5 * TAU, 140.0),
    ],
    starts: &[
        &[0.01, 0.01, 10.6],
        &[0.01, 0.01, 12.8],
        &[0.01, 0.01, 15.0],
        &[0.01, 0.01, 17.2],
        &[0.01, 0.01, 19.4],
        &[0.01, 0.01, 21.6],
        &[0.01, 0.01, 23.8],
        &[0.01, 0.01, 26.0],
        &[0.01, 0.01, 28.2],
        &[0.01, 0.01, 30.4],
        &[0.01, 0.01, 32.6],
        &[0.01, 0.01, 34.8],
        &[0.01, 0.01, 37.0],
        &[0.01, 0.01, 39.2],
        &[0.01, 0.01, 41.4],
        &[0.01, 0.01, 43.6],
        &[0.01, 0.01, 45.8],
        &[0.01, 0.01, 48.0],
        &[0.01, 0.01, 50.2],
        &[0.01, 0.01, 52.4],
        &[0.01, 0.01, 54.6],
        &[0.01, 0.01, 56.8],
        &[0.01, 0.01, 59.0],
        &[0.01, 0.01, 61.2],
        &[0.01, 0.01, 63.4],
        &[0.01, 0.01, 65.6],
        &[0.01, 0.01, 67.8],
    ],
    amplitudes: &[0, 1],
    confusions: &[("spring", "over less than a period a ripple is a spring")],
    regime: "slow motion over several periods",
    equals: &[],
    mujoco: Some("actuator dcmotor, cogging"),
    isaac: None,
    urdf: None,
};

impl Model for Cogging {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn source(&self) -> Option<Source> {
        Some(Source {
            own: "{sine}*sin({periods_per_unit}*{q}) + {cosine}*cos({periods_per_unit}*{q})",
            before: None,
        })
    }
    fn shown(&self, e: &[f64], _gain: f64, _rated: f64) -> Vec<Quantity> {
        vec![
            quantity("amplitude", "N*m", e[0].hypot(e[1])),
            quantity("periods_per_unit", "1/rad", e[2]),
            quantity("phase", "rad", e[1].atan2(e[0])),
        ]
    }
}

impl<D: Scalar> Law<D> for Cogging {
    fn force(
        &self,
        e: &[D],
        at: &Site<'_, D>,
        _memory: &[D],
        f: &mut Forces<'_, D>,
        _constants: &Constants<D>,
    ) {
        let phase = e[2] * at.q[at.joint];
        f.value[at.joint] += e[0] * phase.sine() + e[1] * phase.cosine();
    }
}
