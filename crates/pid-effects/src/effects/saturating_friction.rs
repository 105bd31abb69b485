//! A share of the dry friction builds up over low speed: friction level f_c (1 − x + x tanh(|v|/v_s)).
//!
//! Source: C. Makkar, W. E. Dixon, W. G. Sawyer, G. Hu, IEEE/ASME AIM 2005: Coulomb friction as a smooth
//! function of speed. Strain-wave gears have it in part, and simulators that round friction at rest in whole.

use crate::effect::{Class, Friction, Info, Kind, Law, Model, Site, Source, Unit, parameter};
use crate::scalar::Scalar;

/// A share of the dry friction builds up over low speed.
#[derive(Debug, Clone, Copy, Default)]
pub struct SaturatingFriction;

static INFO: Info = Info {
    id: "saturating_friction",
    title: "Dry friction builds up over low speed",
    equation: "friction level f_c (1 − x + x tanh(|v|/v_s))",
    source: "C. Makkar, W. E. Dixon, W. G. Sawyer, G. Hu, IEEE/ASME AIM 2005",
    kind: Kind::Force,
    class: Class::Velocity,
    has_joint: true,
    parameters: &[
        parameter("share", "1", Unit::Share, 0.0, 1.0),
        parameter("saturation_speed", "rad/s", Unit::Speed, 0.004, 0.8),
    ],
    starts: &[&[0.5, 0.01], &[0.5, 0.03], &[0.5, 0.1], &[0.5, 0.3]],
    amplitudes: &[0],
    confusions: &[
        (
            "stribeck",
            "Stribeck's friction falls over low speed, this rises",
        ),
        (
            "presliding_hysteresis",
            "presliding depends on the distance since the reversal and has a memory; this is a function of speed alone",
        ),
        (
            "quadratic_drag",
            "drag rises ever more with speed, this ever less",
        ),
    ],
    regime: "slow motion, below a few saturation speeds",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for SaturatingFriction {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn source(&self) -> Option<Source> {
        Some(Source {
            own: "{coulomb}*{share}*(1-tanh({v}*{sign}/{saturation_speed}))*{sign}",
            before: None,
        })
    }
}

impl<D: Scalar> Law<D> for SaturatingFriction {
    fn friction(&self, e: &[D], at: &Site<'_, D>, _memory: &[D], f: &mut Friction<D>) {
        let decay = (at.speed() / e[1] * -2.0).exponential();
        // 1 − tanh x = 2 exp(−2x)/(1 + exp(−2x)).
        let factor = -e[0] * 2.0 * decay / (decay + 1.0) + 1.0;
        f.forward = f.forward * factor;
        f.backward = f.backward * factor;
    }
}
