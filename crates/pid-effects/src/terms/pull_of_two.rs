//! A hose between two joints that pulls beyond a length: additional force −k max(s − a, 0) on the joint
//! and r times that on the one before, s = q + r q_before.
//!
//! Source: J. H. Friedman, Annals of Statistics 19(1), 1991.

use crate::constants::Constants;
use crate::effect::{
    Class, Forces, Info, Kind, Law, Model, ReadOff, Site, Source, Unit, parameter,
};
use crate::scalar::Scalar;
use crate::terms::positive;

/// A pull between two joints beyond a length.
#[derive(Debug, Clone, Copy, Default)]
pub struct PullOfTwo;

static INFO: Info = Info {
    id: "pull_of_two",
    title: "A pull between two joints beyond a length",
    equation: "additional force −k max(s − a, 0), r times that on the joint before, s = q + r q_before",
    source: "J. H. Friedman, Annals of Statistics 19(1), 1991",
    kind: Kind::Force,
    class: Class::Coupling,
    has_joint: true,
    parameters: &[
        parameter("stiffness", "N*m/rad", Unit::Stiffness, -20.0, 20.0),
        parameter("ratio", "1", Unit::Ratio, -4.0, 4.0),
        parameter("from", "rad", Unit::Range, -1e3, 1e3),
    ],
    starts: &[],
    amplitudes: &[0],
    confusions: &[],
    regime: "motion of both joints beyond it",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for PullOfTwo {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn read_off(&self) -> Option<ReadOff> {
        Some(ReadOff::PlaceOfTwo {
            parameter: 2,
            ratio: 1,
        })
    }
    fn source(&self) -> Option<Source> {
        Some(Source {
            own: "-{stiffness}*0.5*({q} + {ratio}*{q_before} - {from} + sqrt(({q} + {ratio}*{q_before} - {from})^2 + ({round_q})^2))",
            before: Some(
                "-{ratio}*{stiffness}*0.5*({q} + {ratio}*{q_before} - {from} + sqrt(({q} + {ratio}*{q_before} - {from})^2 + ({round_q})^2))",
            ),
        })
    }
    fn partner(&self, joint: usize) -> Option<usize> {
        joint.checked_sub(1)
    }
    fn needs_partner(&self) -> bool {
        true
    }
}

impl<D: Scalar> Law<D> for PullOfTwo {
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
        let pull = -(e[0] * positive(at.q[at.joint] + e[1] * at.q[other] - e[2]));
        f.value[at.joint] += pull;
        f.value[other] += pull * e[1];
    }
}
