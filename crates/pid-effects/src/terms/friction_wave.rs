//! Friction that waves over the position: level f_c + a sin(w q) + b cos(w q).
//!
//! Source: Fourier series; H. Olsson et al., European Journal of Control 4(3), 1998, for friction over the position.

use crate::effect::{
    Class, Friction, Info, Kind, Law, Model, ReadOff, Site, Source, Unit, parameter,
};
use crate::scalar::Scalar;

/// Friction that changes with the position.
#[derive(Debug, Clone, Copy, Default)]
pub struct FrictionWave;

static INFO: Info = Info {
    id: "friction_wave",
    title: "Friction that changes with the position",
    equation: "friction level f_c + a sin(w q) + b cos(w q)",
    source: "Fourier series; H. Olsson et al., European Journal of Control 4(3), 1998, for friction over the position",
    kind: Kind::Force,
    class: Class::Position,
    has_joint: true,
    parameters: &[
        parameter("sine", "N*m", Unit::Torque, -2.0, 2.0),
        parameter("cosine", "N*m", Unit::Torque, -2.0, 2.0),
        parameter("periods_per_unit", "1/rad", Unit::Wave, 1.0, 140.0),
    ],
    starts: &[],
    amplitudes: &[0, 1],
    confusions: &[],
    regime: "slow motion over the range",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for FrictionWave {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn read_off(&self) -> Option<ReadOff> {
        Some(ReadOff::FrictionWave { wave: 2 })
    }
    fn source(&self) -> Option<Source> {
        Some(Source {
            own: "-({sine}*sin({periods_per_unit}*{q}) + {cosine}*cos({periods_per_unit}*{q}))*{sign}",
            before: None,
        })
    }
}

impl<D: Scalar> Law<D> for FrictionWave {
    fn friction(&self, e: &[D], at: &Site<'_, D>, _memory: &[D], f: &mut Friction<D>) {
        let (sine, cosine) = (e[2] * at.q[at.joint]).sine_cosine();
        let extra = e[0] * sine + e[1] * cosine;
        f.forward += extra;
        f.backward += extra;
    }
}
