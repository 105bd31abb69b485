//! A cable over two joints: potential K/2 (q_j + ρ q_i)² − c (q_j + ρ q_i), i the joint before.
//!
//! Source: L.-W. Tsai, Robot Analysis, 1999, chapter 7.

use crate::constants::Constants;
use crate::effect::{
    Class, Forces, Info, Kind, Law, Model, Quantity, Site, Source, Unit, parameter, quantity,
};
use crate::scalar::Scalar;

/// A cable over two joints.
#[derive(Debug, Clone, Copy, Default)]
pub struct JointCoupling;

static INFO: Info = Info {
    id: "joint_coupling",
    title: "A cable over two joints",
    equation: "potential K/2 (q_j + ρ q_i)² − c (q_j + ρ q_i), i the joint before",
    source: "L.-W. Tsai, Robot Analysis, 1999, chapter 7",
    kind: Kind::Force,
    class: Class::Coupling,
    has_joint: true,
    parameters: &[
        parameter("stiffness", "N*m/rad", Unit::Stiffness, 0.0, 10.0),
        parameter("ratio", "1", Unit::Ratio, -4.0, 4.0),
        parameter("preload", "N*m", Unit::Torque, -10.0, 10.0),
    ],
    starts: &[
        &[0.05, -1.4, 0.0],
        &[0.05, -0.8, 0.0],
        &[0.05, -0.4, 0.0],
        &[0.05, 0.4, 0.0],
        &[0.05, 0.8, 0.0],
        &[0.05, 1.4, 0.0],
    ],
    amplitudes: &[0, 2],
    confusions: &[("spring", "a spring does not load the other joint")],
    regime: "motion of the other joint while this one rests",
    equals: &[],
    mujoco: Some("fixed tendon with stiffness"),
    isaac: Some("fixed tendon with stiffness"),
    urdf: None,
};

impl Model for JointCoupling {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn source(&self) -> Option<Source> {
        Some(Source {
            own: "{preload} - {stiffness}*({q} + {ratio}*{q_before})",
            before: Some("{ratio}*({preload} - {stiffness}*({q} + {ratio}*{q_before}))"),
        })
    }
    fn partner(&self, joint: usize) -> Option<usize> {
        joint.checked_sub(1)
    }
    fn needs_partner(&self) -> bool {
        true
    }
    fn shown(&self, e: &[f64], _gain: f64, _rated: f64) -> Vec<Quantity> {
        vec![
            quantity("stiffness", "N*m/rad", e[0]),
            quantity("ratio", "1", e[1]),
            quantity("rest", "rad", e[2] / e[0]),
        ]
    }
}

impl<D: Scalar> Law<D> for JointCoupling {
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
        let pull = e[2] - e[0] * (at.q[at.joint] + e[1] * at.q[other]);
        f.value[at.joint] += pull;
        f.value[other] += pull * e[1];
    }
}
