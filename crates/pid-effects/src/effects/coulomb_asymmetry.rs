//! Friction differs between directions: friction (f_c sgn v + f_v v)(1 + a sgn v).
//!
//! Source: B. Armstrong-Hélouvry, Control of Machines with Friction, 1991, section 5.3.

use crate::effect::{
    Class, EqualWhen, Friction, Info, Kind, Law, Model, Site, Source, Unit, parameter,
};
use crate::scalar::Scalar;

/// Friction differs between directions.
#[derive(Debug, Clone, Copy, Default)]
pub struct CoulombAsymmetry;

static INFO: Info = Info {
    id: "coulomb_asymmetry",
    title: "Friction differs between directions",
    equation: "friction (f_c sgn v + f_v v)(1 + a sgn v)",
    source: "B. Armstrong-Hélouvry, Control of Machines with Friction, 1991, section 5.3",
    kind: Kind::Force,
    class: Class::Velocity,
    has_joint: true,
    parameters: &[parameter("asymmetry", "1", Unit::One, -0.98, 0.98)],
    starts: &[&[0.1]],
    amplitudes: &[0],
    confusions: &[(
        "current_offset",
        "an offset does not grow with speed; only the viscous part and the tie to the friction level tell them apart",
    )],
    regime: "both directions of motion",
    equals: &[("current_offset", EqualWhen::NoViscousFriction)],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for CoulombAsymmetry {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn source(&self) -> Option<Source> {
        Some(Source {
            own: "-{asymmetry}*({coulomb} + {viscous}*{v}*{sign})",
            before: None,
        })
    }
}

impl<D: Scalar> Law<D> for CoulombAsymmetry {
    fn friction(&self, e: &[D], at: &Site<'_, D>, _memory: &[D], f: &mut Friction<D>) {
        f.forward = f.forward * (e[0] + 1.0);
        f.backward = f.backward * (-e[0] + 1.0);
        f.viscous = f.viscous * (e[0] * at.direction() + 1.0);
    }
}
