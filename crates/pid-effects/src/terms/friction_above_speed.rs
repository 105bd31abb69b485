//! Friction that rises or falls beyond a speed: level f_c + k max(|v| − s, 0).
//!
//! Source: J. H. Friedman, Annals of Statistics 19(1), 1991.

use crate::effect::{
    Class, Friction, Info, Kind, Law, Model, Over, ReadOff, Site, Source, Unit, parameter,
};
use crate::scalar::Scalar;
use crate::terms::positive;

/// Friction that bends at a speed.
#[derive(Debug, Clone, Copy, Default)]
pub struct FrictionAboveSpeed;

static INFO: Info = Info {
    id: "friction_above_speed",
    title: "Friction that bends at a speed",
    equation: "friction level f_c + k max(|v| − s, 0)",
    source: "J. H. Friedman, Annals of Statistics 19(1), 1991",
    kind: Kind::Force,
    class: Class::Velocity,
    has_joint: true,
    parameters: &[
        parameter("slope", "N*m*s/rad", Unit::Damping, -10.0, 10.0),
        parameter("from", "rad/s", Unit::Speed, 0.0, 2.0),
    ],
    starts: &[],
    amplitudes: &[0],
    confusions: &[],
    regime: "speeds beyond it",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for FrictionAboveSpeed {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn read_off(&self) -> Option<ReadOff> {
        Some(ReadOff::Place {
            parameter: 1,
            of: Over::Speed,
        })
    }
    fn source(&self) -> Option<Source> {
        Some(Source {
            own: "-{slope}*0.5*({v}*{sign} - {from} + sqrt(({v}*{sign} - {from})^2 + ({round_v})^2))*{sign}",
            before: None,
        })
    }
}

impl<D: Scalar> Law<D> for FrictionAboveSpeed {
    fn friction(&self, e: &[D], at: &Site<'_, D>, _memory: &[D], f: &mut Friction<D>) {
        let extra = e[0] * positive(at.speed() - e[1]);
        f.forward += extra;
        f.backward += extra;
    }
}
