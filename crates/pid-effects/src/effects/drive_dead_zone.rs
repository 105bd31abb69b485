//! Small inputs do nothing: u_a = sgn(u) max(|u| − w, 0).
//!
//! Source: D. A. Recker, P. V. Kokotović, IEEE CDC 1991.

use crate::effect::{Class, Commands, Info, Kind, Law, Model, Source, Unit, parameter};
use crate::scalar::Scalar;

/// Small inputs do nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct DriveDeadZone;

static INFO: Info = Info {
    id: "drive_dead_zone",
    title: "Small inputs do nothing",
    equation: "u_a = sgn(u) max(|u| − w, 0)",
    source: "D. A. Recker, P. V. Kokotović, IEEE CDC 1991",
    kind: Kind::Channel,
    class: Class::Load,
    has_joint: true,
    parameters: &[parameter("half_width", "A", Unit::Input, 0.0, 0.6)],
    starts: &[&[0.02], &[0.08]],
    amplitudes: &[],
    confusions: &[(
        "stribeck",
        "more dry friction looks alike while input and motion agree in sign; it differs where gravity drives and the input brakes",
    )],
    regime: "small inputs",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for DriveDeadZone {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn source(&self) -> Option<Source> {
        Some(Source {
            own: "-{gain}*(0.5*sqrt(({input} + {half_width})^2 + (0.01*{half_width})^2) - 0.5*sqrt(({input} - {half_width})^2 + (0.01*{half_width})^2))",
            before: None,
        })
    }
}

impl<D: Scalar> Law<D> for DriveDeadZone {
    fn input(&self, e: &[D], u: D, _at: &Commands<'_>, _memory: &mut [D]) -> D {
        u - u.limit(-e[0], e[0])
    }
}
