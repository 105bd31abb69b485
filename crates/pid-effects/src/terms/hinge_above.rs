//! A force beyond a position: additional force −k max(q − a, 0).
//!
//! Source: J. H. Friedman, Annals of Statistics 19(1), 1991.

use crate::constants::Constants;
use crate::effect::{
    Class, Forces, Info, Kind, Law, Model, Over, ReadOff, Site, Source, Unit, parameter,
};
use crate::scalar::Scalar;
use crate::terms::positive;

/// A force beyond a position.
#[derive(Debug, Clone, Copy, Default)]
pub struct HingeAbove;

static INFO: Info = Info {
    id: "hinge_above",
    title: "A force beyond a position",
    equation: "additional force −k max(q − a, 0)",
    source: "J. H. Friedman, Annals of Statistics 19(1), 1991",
    kind: Kind::Force,
    class: Class::Position,
    has_joint: true,
    parameters: &[
        parameter("stiffness", "N*m/rad", Unit::Stiffness, -50.0, 50.0),
        parameter("from", "rad", Unit::Range, -1e3, 1e3),
    ],
    starts: &[],
    amplitudes: &[0],
    confusions: &[],
    regime: "positions beyond it",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for HingeAbove {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn read_off(&self) -> Option<ReadOff> {
        Some(ReadOff::Place {
            parameter: 1,
            of: Over::Position,
        })
    }
    fn source(&self) -> Option<Source> {
        Some(Source {
            own: "-{stiffness}*0.5*({q} - {from} + sqrt(({q} - {from})^2 + ({round_q})^2))",
            before: None,
        })
    }
}

impl<D: Scalar> Law<D> for HingeAbove {
    fn force(
        &self,
        e: &[D],
        at: &Site<'_, D>,
        _memory: &[D],
        f: &mut Forces<'_, D>,
        _constants: &Constants<D>,
    ) {
        f.value[at.joint] += -(e[0] * positive(at.q[at.joint] - e[1]));
    }
}
