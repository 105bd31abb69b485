//! A force beyond a position or below it: additional force −k max(q − a, 0), or k max(a − q, 0).
//!
//! Source: J. H. Friedman, Annals of Statistics 19(1), 1991.

use crate::constants::Constants;
use crate::effect::{
    Class, Forces, Info, Kind, Law, Model, Over, ReadOff, Site, Source, Unit, parameter,
};
use crate::scalar::Scalar;
use crate::terms::positive;

/// A force on one side of a position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hinge {
    /// −k max(q − a, 0).
    Above,
    /// k max(a − q, 0).
    Below,
}

static ABOVE: Info = Info {
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

static BELOW: Info = Info {
    id: "hinge_below",
    title: "A force below a position",
    equation: "additional force k max(a − q, 0)",
    regime: "positions below it",
    ..ABOVE
};

impl Model for Hinge {
    fn info(&self) -> &'static Info {
        match self {
            Hinge::Above => &ABOVE,
            Hinge::Below => &BELOW,
        }
    }
    fn read_off(&self) -> Option<ReadOff> {
        Some(ReadOff::Place {
            parameter: 1,
            of: Over::Position,
        })
    }
    fn source(&self) -> Option<Source> {
        let own = match self {
            Hinge::Above => {
                "-{stiffness}*0.5*({q} - {from} + sqrt(({q} - {from})^2 + ({round_q})^2))"
            }
            Hinge::Below => {
                "{stiffness}*0.5*({from} - {q} + sqrt(({from} - {q})^2 + ({round_q})^2))"
            }
        };
        Some(Source { own, before: None })
    }
}

impl<D: Scalar> Law<D> for Hinge {
    fn force(
        &self,
        e: &[D],
        at: &Site<'_, D>,
        _memory: &[D],
        f: &mut Forces<'_, D>,
        _constants: &Constants<D>,
    ) {
        let beyond = at.q[at.joint] - e[1];
        f.value[at.joint] += match self {
            Hinge::Above => -(e[0] * positive(beyond)),
            Hinge::Below => e[0] * positive(-beyond),
        };
    }
}
