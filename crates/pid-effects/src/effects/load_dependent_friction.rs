//! Dry friction grows with the torque through the gear: friction level f_c + μ |τ_l|.
//!
//! Source: P. Hamon, M. Gautier, P. Garrec, IEEE/RSJ IROS 2010.

use crate::effect::{Class, Friction, Info, Kind, Law, Model, Site, Source, Unit, parameter};
use crate::scalar::Scalar;

/// Dry friction grows with the torque through the gear.
#[derive(Debug, Clone, Copy, Default)]
pub struct LoadDependentFriction;

static INFO: Info = Info {
    id: "load_dependent_friction",
    title: "Dry friction grows with the torque through the gear",
    equation: "friction level f_c + μ |τ_l|",
    source: "P. Hamon, M. Gautier, P. Garrec, IEEE/RSJ IROS 2010",
    kind: Kind::Force,
    class: Class::Load,
    has_joint: true,
    parameters: &[parameter("load_coefficient", "1", Unit::One, 0.0, 1.5)],
    starts: &[&[0.1]],
    amplitudes: &[0],
    confusions: &[(
        "gain_error_nonlinear",
        "the sign of this follows the motion, that of a gain law the input",
    )],
    regime: "load that varies at the same speed",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for LoadDependentFriction {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn source(&self) -> Option<Source> {
        Some(Source {
            own: "-{load_coefficient}*sqrt(({gain}*{input} - {coulomb}*{sign} - {viscous}*{v})^2 + ({round})^2)*{sign}/(0.5*((1 + {sign}*{load_coefficient}*({gain}*{input} - {coulomb}*{sign} - {viscous}*{v})/sqrt(({gain}*{input} - {coulomb}*{sign} - {viscous}*{v})^2 + ({round})^2)) + sqrt((1 + {sign}*{load_coefficient}*({gain}*{input} - {coulomb}*{sign} - {viscous}*{v})/sqrt(({gain}*{input} - {coulomb}*{sign} - {viscous}*{v})^2 + ({round})^2))^2 + {jam}^2)))",
            before: None,
        })
    }
}

impl<D: Scalar> Law<D> for LoadDependentFriction {
    fn friction(&self, e: &[D], at: &Site<'_, D>, _memory: &[D], f: &mut Friction<D>) {
        let extra = e[0] * at.load[at.joint].magnitude();
        f.forward += extra;
        f.backward += extra;
    }
    fn load_slope(&self, e: &[D], at: &Site<'_, D>) -> Option<D> {
        let load = at.load[at.joint];
        Some(e[0] * load / load.magnitude())
    }
}
