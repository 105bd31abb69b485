//! Rotor and link are joined by a spring: torque K (q_m − q_l) + K T (dq_m − dq_l) between rotor
//! and link, K = 1/compliance.
//!
//! Source: M. W. Spong, ASME J. Dyn. Syst. Meas. Control 109(4), 1987.

use crate::effect::{Class, Gear, Info, Kind, Law, Model, Quantity, Unit, parameter, quantity};
use crate::scalar::Scalar;

/// Rotor and link are joined by a spring.
#[derive(Debug, Clone, Copy, Default)]
pub struct JointElasticity;

static INFO: Info = Info {
    id: "joint_elasticity",
    title: "Rotor and link are joined by a spring",
    equation: "torque K (q_m − q_l) + K T (dq_m − dq_l) between rotor and link, K = 1/compliance",
    source: "M. W. Spong, ASME J. Dyn. Syst. Meas. Control 109(4), 1987",
    kind: Kind::State,
    class: Class::Load,
    has_joint: true,
    parameters: &[
        parameter("compliance", "rad/(N*m)", Unit::Compliance, 1e-05, 0.6),
        parameter("damping_time", "s", Unit::Time, 0.0, 0.03),
    ],
    starts: &[
        &[0.0015, 0.001],
        &[0.005, 0.001],
        &[0.015, 0.001],
        &[0.04, 0.001],
        &[0.1, 0.001],
    ],
    amplitudes: &[],
    confusions: &[
        (
            "backlash",
            "backlash has a fixed travel, elasticity a travel in proportion to the torque",
        ),
        (
            "presliding_hysteresis",
            "presliding stops at the friction level and forgets",
        ),
    ],
    regime: "load changes and resonance",
    equals: &[],
    mujoco: Some(
        "a second joint in series with stiffness and damping; actuator and armature on the first",
    ),
    isaac: Some(
        "a second joint in series, its drive with stiffness and damping and the target zero",
    ),
    urdf: None,
};

impl Model for JointElasticity {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn shown(&self, e: &[f64], _gain: f64, _rated: f64) -> Vec<Quantity> {
        vec![
            quantity("stiffness", "N*m/rad", 1.0 / e[0]),
            quantity("damping", "N*m*s/rad", e[1] / e[0]),
        ]
    }
}

impl<D: Scalar> Law<D> for JointElasticity {
    fn gear(&self, e: &[D]) -> Option<Gear<D>> {
        let stiffness = e[0].inverse();
        Some(Gear {
            stiffness,
            damping: stiffness * e[1],
            open: D::nil(),
            gap: D::nil(),
        })
    }
}
