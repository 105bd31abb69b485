//! The rotor is heavier than stated: M_jj + J.
//!
//! Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, 2002, section 9.4.

use crate::constants::{Constant, Constants};
use crate::effect::{Class, EqualWhen, Info, Kind, Law, Model, Unit, parameter};
use crate::scalar::Scalar;

/// The rotor is heavier than stated.
#[derive(Debug, Clone, Copy, Default)]
pub struct UnmodelledRotorInertia;

static INFO: Info = Info {
    id: "unmodelled_rotor_inertia",
    title: "The rotor is heavier than stated",
    equation: "M_jj + J",
    source: "W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, 2002, section 9.4",
    kind: Kind::Force,
    class: Class::Inertia,
    has_joint: true,
    parameters: &[parameter(
        "extra_inertia",
        "kg*m^2",
        Unit::Inertia,
        -0.5,
        4.0,
    )],
    starts: &[&[0.1]],
    amplitudes: &[0],
    confusions: &[(
        "payload",
        "link inertia also enters the off-diagonal terms of later joints",
    )],
    regime: "accelerations of a joint beyond the first",
    equals: &[("payload", EqualWhen::OneJointWithoutGravity)],
    mujoco: Some("joint armature"),
    isaac: Some("actuator armature"),
    urdf: None,
};

impl Model for UnmodelledRotorInertia {
    fn info(&self) -> &'static Info {
        &INFO
    }
}

impl<D: Scalar> Law<D> for UnmodelledRotorInertia {
    fn constants(&self, e: &[D], joint: usize, constants: &mut Constants<D>) {
        constants.add(Constant::Rotor(joint), e[0]);
    }
}
