//! Something pushes the tool: a force on the tool point, fixed in base axes, on within time windows.
//!
//! Source: A. De Luca, R. Mattone, IEEE ICRA 2005.

use crate::effect::{Class, Info, Kind, Law, Model, Quantity, Unit, parameter, quantity};
use crate::scalar::Scalar;

/// Something pushes the tool.
#[derive(Debug, Clone, Copy, Default)]
pub struct ExternalForce;

static INFO: Info = Info {
    id: "external_force",
    title: "Something pushes the tool",
    equation: "a force on the tool point, fixed in base axes, on within time windows",
    source: "A. De Luca, R. Mattone, IEEE ICRA 2005",
    kind: Kind::Force,
    class: Class::Time,
    has_joint: false,
    parameters: &[
        parameter("force_x", "N", Unit::Force, -20.0, 20.0),
        parameter("force_y", "N", Unit::Force, -20.0, 20.0),
        parameter("force_z", "N", Unit::Force, -20.0, 20.0),
        parameter("on_1_s", "s", Unit::Time, -1000.0, 1000000.0),
        parameter("off_1_s", "s", Unit::Time, -1000.0, 1000000.0),
        parameter("on_2_s", "s", Unit::Time, -1000.0, 1000000.0),
        parameter("off_2_s", "s", Unit::Time, -1000.0, 1000000.0),
        parameter("on_3_s", "s", Unit::Time, -1000.0, 1000000.0),
        parameter("off_3_s", "s", Unit::Time, -1000.0, 1000000.0),
    ],
    starts: &[&[
        0.02, 0.0, 0.02, 0.0, 100000.0, 200000.0, 200000.0, 200000.0, 200000.0,
    ]],
    amplitudes: &[0, 1, 2],
    confusions: &[
        (
            "base_tilt",
            "a constant force on a single body adds to gravity",
        ),
        (
            "payload",
            "a constant downward force is a weight without inertia",
        ),
    ],
    regime: "the time windows",
    equals: &[],
    mujoco: Some("xfrc_applied"),
    isaac: Some(
        "permanent_wrench_composer of the articulation; set_external_force_and_torque before Isaac Lab 2.3",
    ),
    urdf: None,
};

impl Model for ExternalForce {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn needs_bodies(&self) -> bool {
        true
    }
    fn edges(&self) -> &'static [usize] {
        &[3, 4, 5, 6, 7, 8]
    }
    fn shown(&self, e: &[f64], _gain: f64, _rated: f64) -> Vec<Quantity> {
        vec![
            quantity("force_x", "N", e[0]),
            quantity("force_y", "N", e[1]),
            quantity("force_z", "N", e[2]),
            quantity("on_1_s", "s", e[3]),
            quantity("off_1_s", "s", e[4]),
            quantity("on_2_s", "s", e[5]),
            quantity("off_2_s", "s", e[6]),
            quantity("on_3_s", "s", e[7]),
            quantity("off_3_s", "s", e[8]),
        ]
    }
}

impl<D: Scalar> Law<D> for ExternalForce {
    fn tip_force(&self, e: &[D], t: f64, dt: f64) -> Option<[D; 3]> {
        let end = t + dt;
        let mut share = D::nil();
        for w in e[3..9].chunks_exact(2) {
            if w[1].value() <= t || w[0].value() >= end {
                continue;
            }
            let from = if w[0].value() > t {
                w[0]
            } else {
                D::constant(t)
            };
            let to = if w[1].value() < end {
                w[1]
            } else {
                D::constant(end)
            };
            share += (to - from) / dt;
        }
        Some([e[0] * share, e[1] * share, e[2] * share])
    }
}
