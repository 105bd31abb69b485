//! A spring at the joint: additional force c − K q = −K (q − c/K).
//!
//! Source: MuJoCo documentation, joint stiffness.

use crate::constants::Constants;
use crate::effect::{
    Class, Forces, Info, Kind, Law, Model, Quantity, Site, Source, Unit, parameter, quantity,
};
use crate::scalar::Scalar;

/// A spring at the joint.
#[derive(Debug, Clone, Copy, Default)]
pub struct Spring;

static INFO: Info = Info {
    id: "spring",
    title: "A spring at the joint",
    equation: "additional force c − K q = −K (q − c/K)",
    source: "MuJoCo documentation, joint stiffness",
    kind: Kind::Force,
    class: Class::Position,
    has_joint: true,
    parameters: &[
        parameter("stiffness", "N*m/rad", Unit::Stiffness, 0.0, 20.0),
        parameter("preload", "N*m", Unit::Torque, -10.0, 10.0),
    ],
    starts: &[&[0.02, 0.0]],
    amplitudes: &[0, 1],
    confusions: &[
        ("joint_coupling", "a cable also loads the other joint"),
        ("cogging", "a ripple bends over a period"),
        (
            "encoder_offset",
            "gravity over a small range is a linear spring",
        ),
    ],
    regime: "the whole range of the position",
    equals: &[],
    mujoco: Some("joint stiffness and springref"),
    isaac: Some("drive stiffness with a constant target, in place of a position control"),
    urdf: None,
};

impl Model for Spring {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn source(&self) -> Option<Source> {
        Some(Source {
            own: "{preload} - {stiffness}*{q}",
            before: None,
        })
    }
    fn shown(&self, e: &[f64], _gain: f64, _rated: f64) -> Vec<Quantity> {
        vec![
            quantity("stiffness", "N*m/rad", e[0]),
            quantity("rest", "rad", e[1] / e[0]),
        ]
    }
}

impl<D: Scalar> Law<D> for Spring {
    fn force(
        &self,
        e: &[D],
        at: &Site<'_, D>,
        _memory: &[D],
        f: &mut Forces<'_, D>,
        _constants: &Constants<D>,
    ) {
        f.value[at.joint] += e[1] - e[0] * at.q[at.joint];
    }
}
