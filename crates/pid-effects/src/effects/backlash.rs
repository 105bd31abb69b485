//! Free travel between rotor and link: as joint elasticity, with a stiff spring and damper only where
//! |q_m − q_l| > gap/2. The lubricant of the teeth may damp throughout.
//!
//! Source: M. Nordin, P.-O. Gutman, Automatica 38(10), 2002.

use crate::effect::{Class, Gear, Info, Kind, Law, Model, Quantity, Unit, parameter, quantity};
use crate::scalar::Scalar;

/// Free travel between rotor and link.
#[derive(Debug, Clone, Copy, Default)]
pub struct Backlash;

static INFO: Info = Info {
    id: "backlash",
    title: "Free travel between rotor and link",
    equation: "as joint elasticity, with a stiff spring and damper only where |q_m − q_l| > gap/2, and a damper throughout",
    source: "M. Nordin, P.-O. Gutman, Automatica 38(10), 2002",
    kind: Kind::State,
    class: Class::Reversal,
    has_joint: true,
    parameters: &[
        parameter("gap", "rad", Unit::Range, 1e-05, 0.2),
        parameter("compliance", "rad/(N*m)", Unit::Compliance, 0.0001, 0.02),
        parameter("damping_time", "s", Unit::Time, 0.0, 0.03),
        parameter("open_damping_time", "s", Unit::Time, 0.0, 0.03),
    ],
    // Stiff contacts damped throughout, and soft ones with more damping at the contact, which find a gap
    // from further away.
    starts: &[
        &[0.002, 0.0015, 0.0, 0.0003],
        &[0.0035, 0.0015, 0.0, 0.0003],
        &[0.006, 0.0015, 0.0, 0.0003],
        &[0.009, 0.0015, 0.0, 0.0003],
        &[0.013, 0.0015, 0.0, 0.0003],
        &[0.018, 0.0015, 0.0, 0.0003],
        &[0.025, 0.0015, 0.0, 0.0003],
        &[0.0025, 0.003, 0.0015, 0.0],
        &[0.0035, 0.003, 0.0015, 0.0],
        &[0.005, 0.003, 0.0015, 0.0],
        &[0.007, 0.003, 0.0015, 0.0],
        &[0.01, 0.003, 0.0015, 0.0],
        &[0.014, 0.003, 0.0015, 0.0],
        &[0.02, 0.003, 0.0015, 0.0],
        &[0.028, 0.003, 0.0015, 0.0],
        &[0.04, 0.003, 0.0015, 0.0],
    ],
    amplitudes: &[],
    confusions: &[
        ("joint_elasticity", "elasticity has no fixed travel"),
        (
            "presliding_hysteresis",
            "presliding transmits torque within its travel",
        ),
    ],
    regime: "reversals of the load",
    equals: &[],
    mujoco: Some("a second joint in series, range ± gap/2, its stiffness by solreflimit"),
    isaac: Some("a second joint in series, limits ± gap/2"),
    urdf: Some("a second joint in series, limit ± gap/2, without an effort of its own"),
};

impl Model for Backlash {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn shown(&self, e: &[f64], _gain: f64, _rated: f64) -> Vec<Quantity> {
        vec![
            quantity("gap", "rad", e[0]),
            quantity("stiffness", "N*m/rad", 1.0 / e[1]),
            quantity("damping", "N*m*s/rad", (e[2] + e[3]) / e[1]),
            quantity("open_damping", "N*m*s/rad", e[3] / e[1]),
        ]
    }
}

impl<D: Scalar> Law<D> for Backlash {
    fn gear(&self, e: &[D]) -> Option<Gear<D>> {
        let stiffness = e[1].inverse();
        Some(Gear {
            stiffness,
            damping: stiffness * e[2],
            open: stiffness * e[3],
            gap: e[0],
        })
    }
}
