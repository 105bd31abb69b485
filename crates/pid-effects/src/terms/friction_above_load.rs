//! Friction that rises or falls beyond a load: level f_c + μ max(|τ_l| − l, 0).
//!
//! Source: J. H. Friedman, Annals of Statistics 19(1), 1991.

use crate::effect::{
    Class, Friction, Info, Kind, Law, Model, Over, ReadOff, Site, Source, Unit, parameter,
};
use crate::scalar::Scalar;
use crate::terms::positive;

/// Friction that bends at a load.
#[derive(Debug, Clone, Copy, Default)]
pub struct FrictionAboveLoad;

static INFO: Info = Info {
    id: "friction_above_load",
    title: "Friction that bends at a load",
    equation: "friction level f_c + μ max(|τ_l| − l, 0)",
    source: "J. H. Friedman, Annals of Statistics 19(1), 1991",
    kind: Kind::Force,
    class: Class::Load,
    has_joint: true,
    parameters: &[
        parameter("coefficient", "1", Unit::One, -1.0, 2.0),
        parameter("from", "N*m", Unit::Torque, 0.0, 10.0),
    ],
    starts: &[],
    amplitudes: &[0],
    confusions: &[],
    regime: "loads beyond it",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for FrictionAboveLoad {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn read_off(&self) -> Option<ReadOff> {
        Some(ReadOff::Place {
            parameter: 1,
            of: Over::Load,
        })
    }
    fn source(&self) -> Option<Source> {
        Some(Source {
            own: "-{coefficient}*0.5*((sqrt(({gain}*{input} - {coulomb}*{sign} - {viscous}*{v})^2 + ({round})^2) - {from}) + sqrt((sqrt(({gain}*{input} - {coulomb}*{sign} - {viscous}*{v})^2 + ({round})^2) - {from})^2 + ({round})^2))*{sign}/(0.5*((1 + {sign}*{coefficient}*0.5*(1 + (sqrt(({gain}*{input} - {coulomb}*{sign} - {viscous}*{v})^2 + ({round})^2) - {from})/sqrt((sqrt(({gain}*{input} - {coulomb}*{sign} - {viscous}*{v})^2 + ({round})^2) - {from})^2 + ({round})^2))*({gain}*{input} - {coulomb}*{sign} - {viscous}*{v})/sqrt(({gain}*{input} - {coulomb}*{sign} - {viscous}*{v})^2 + ({round})^2)) + sqrt((1 + {sign}*{coefficient}*0.5*(1 + (sqrt(({gain}*{input} - {coulomb}*{sign} - {viscous}*{v})^2 + ({round})^2) - {from})/sqrt((sqrt(({gain}*{input} - {coulomb}*{sign} - {viscous}*{v})^2 + ({round})^2) - {from})^2 + ({round})^2))*({gain}*{input} - {coulomb}*{sign} - {viscous}*{v})/sqrt(({gain}*{input} - {coulomb}*{sign} - {viscous}*{v})^2 + ({round})^2))^2 + {jam}^2)))",
            before: None,
        })
    }
}

impl<D: Scalar> Law<D> for FrictionAboveLoad {
    fn friction(&self, e: &[D], at: &Site<'_, D>, _memory: &[D], f: &mut Friction<D>) {
        let extra = e[0] * positive(at.load[at.joint].magnitude() - e[1]);
        f.forward += extra;
        f.backward += extra;
    }
    fn load_slope(&self, e: &[D], at: &Site<'_, D>) -> Option<D> {
        let load = at.load[at.joint];
        let size = load.magnitude();
        Some(e[0] * crate::terms::rises(size - e[1]) * load / size)
    }
}
