//! Friction falls while the joint warms up: f_c and f_v times 1 + a exp(−t/T).
//!
//! Source: A. C. Bittencourt, S. Gunnarsson, ASME J. Dyn. Syst. Meas. Control 134(5), 2012.

use crate::effect::{Class, Friction, Info, Kind, Law, Model, Site, Unit, parameter};
use crate::scalar::Scalar;

/// Friction falls while the joint warms up.
#[derive(Debug, Clone, Copy, Default)]
pub struct FrictionDrift;

static INFO: Info = Info {
    id: "friction_drift",
    title: "Friction falls while the joint warms up",
    equation: "f_c and f_v times 1 + a exp(−t/T)",
    source: "A. C. Bittencourt, S. Gunnarsson, ASME J. Dyn. Syst. Meas. Control 134(5), 2012",
    kind: Kind::State,
    class: Class::Time,
    has_joint: true,
    parameters: &[
        parameter("cold_excess", "1", Unit::One, -0.9, 6.0),
        parameter("time_constant_s", "s", Unit::Time, 0.15, 20.0),
    ],
    starts: &[&[0.2, 0.7], &[0.2, 1.5], &[0.2, 2.6], &[0.2, 5.0]],
    amplitudes: &[0],
    confusions: &[(
        "stribeck",
        "within a short window any wrong friction level looks alike; this has a trend over t",
    )],
    regime: "the trend over t, repeated in every record",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for FrictionDrift {
    fn info(&self) -> &'static Info {
        &INFO
    }
}

impl<D: Scalar> Law<D> for FrictionDrift {
    fn friction(&self, e: &[D], at: &Site<'_, D>, _memory: &[D], f: &mut Friction<D>) {
        let factor = e[0] * (-(e[1].inverse() * at.t)).exponential() + 1.0;
        f.forward = f.forward * factor;
        f.backward = f.backward * factor;
        f.viscous = f.viscous * factor;
    }
}
