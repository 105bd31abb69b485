//! The base is not level: the base is turned by (x, y) rad; gravity turns in base axes.
//!
//! Source: ISO 9946; W. Khalil, E. Dombre 2002, section 11.6.

use crate::constants::{Constant, Constants};
use crate::effect::{Class, EqualWhen, Info, Kind, Law, Model, Unit, parameter};
use crate::scalar::Scalar;

/// The base is not level.
#[derive(Debug, Clone, Copy, Default)]
pub struct BaseTilt;

static INFO: Info = Info {
    id: "base_tilt",
    title: "The base is not level",
    equation: "the base is turned by (x, y) rad; gravity turns in base axes",
    source: "ISO 9946; W. Khalil, E. Dombre 2002, section 11.6",
    kind: Kind::Force,
    class: Class::Inertia,
    has_joint: false,
    parameters: &[
        parameter("tilt_x", "rad", Unit::Angle, -0.6, 0.6),
        parameter("tilt_y", "rad", Unit::Angle, -0.6, 0.6),
    ],
    starts: &[&[0.01, 0.01]],
    amplitudes: &[0, 1],
    confusions: &[(
        "encoder_offset",
        "in the plane of a planar arm an offset of joint 1 is exactly the same",
    )],
    regime: "gravity on every joint",
    equals: &[("encoder_offset", EqualWhen::FirstOfVerticalPlane)],
    mujoco: Some("option gravity"),
    isaac: Some("simulation gravity, or orientation of the base"),
    urdf: Some("origin of the base joint, rpy"),
};

impl Model for BaseTilt {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn needs_bodies(&self) -> bool {
        true
    }
}

impl<D: Scalar> Law<D> for BaseTilt {
    fn constants(&self, e: &[D], _joint: usize, constants: &mut Constants<D>) {
        // g cos a − (ê × g) sin a + ê (ê·g)(1 − cos a) with a ê = (x, y, 0); series in a², 3e-9 at
        // 0.6 rad and regular at zero.
        let (x, y) = (e[0], e[1]);
        let a2 = x * x + y * y;
        let series = |first: f64, terms: [f64; 4]| {
            let [a, b, c, d] = terms.map(|t| 1.0 / t);
            (((a2 * d - c) * a2 + b) * a2 - a) * a2 + first
        };
        let c = series(1.0, [2.0, 24.0, 720.0, 40_320.0]);
        let s = series(1.0, [6.0, 120.0, 5_040.0, 362_880.0]);
        let k = series(0.5, [24.0, 720.0, 40_320.0, 3_628_800.0]);
        let g = [0, 1, 2].map(|i| constants.get(Constant::Gravity(i)));
        let along = (x * g[0] + y * g[1]) * k;
        let turned = [
            g[0] * c - y * g[2] * s + x * along,
            g[1] * c + x * g[2] * s + y * along,
            g[2] * c - (x * g[1] - y * g[0]) * s,
        ];
        for (i, g) in turned.into_iter().enumerate() {
            constants.set(Constant::Gravity(i), g);
        }
    }
}
