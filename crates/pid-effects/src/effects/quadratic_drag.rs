//! Drag with the square of the speed: additional force −c v |v|.
//!
//! Source: G. K. Batchelor, An Introduction to Fluid Dynamics, 1967, section 5.11.

use crate::constants::Constants;
use crate::effect::{Class, Forces, Info, Kind, Law, Model, Site, Source, Unit, parameter};
use crate::scalar::Scalar;

/// Drag with the square of the speed.
#[derive(Debug, Clone, Copy, Default)]
pub struct QuadraticDrag;

static INFO: Info = Info {
    id: "quadratic_drag",
    title: "Drag with the square of the speed",
    equation: "additional force −c v |v|",
    source: "G. K. Batchelor, An Introduction to Fluid Dynamics, 1967, section 5.11",
    kind: Kind::Force,
    class: Class::Velocity,
    has_joint: true,
    parameters: &[parameter("drag", "N*m*s^2", Unit::Drag, 0.0, 20.0)],
    starts: &[&[0.1]],
    amplitudes: &[0],
    confusions: &[(
        "stribeck",
        "a wide Stribeck curve bends the other way at low speed",
    )],
    regime: "fast motion",
    equals: &[],
    mujoco: Some("second coefficient of the joint's damping"),
    isaac: None,
    urdf: None,
};

impl Model for QuadraticDrag {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn source(&self) -> Option<Source> {
        Some(Source {
            own: "-{drag}*{v}^2*{sign}",
            before: None,
        })
    }
}

impl<D: Scalar> Law<D> for QuadraticDrag {
    fn force(
        &self,
        e: &[D],
        at: &Site<'_, D>,
        _memory: &[D],
        f: &mut Forces<'_, D>,
        _constants: &Constants<D>,
    ) {
        f.rate[at.joint] += e[0] * at.speed();
    }
}
