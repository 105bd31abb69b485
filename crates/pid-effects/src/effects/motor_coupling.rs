//! The motor of a joint is turned by the joint before it too: friction −f_v w − f_c tanh(w/w₀) on w
//! = v_j + ρ v_i.
//!
//! Source: M. Gautier, S. Briot, ASME J. Dyn. Syst. Meas. Control 136(5), 2014 (the wrist of the
//! Stäubli TX40).

use crate::constants::Constants;
use crate::effect::{
    Class, Forces, Info, Kind, Law, Model, Quantity, Site, Source, Unit, parameter, quantity,
};
use crate::scalar::Scalar;

/// The motor of a joint is turned by the joint before it too.
#[derive(Debug, Clone, Copy, Default)]
pub struct MotorCoupling;

/// Start value of the speed at which the dry part reaches three quarters, as a share of the typical
/// speed.
const SHARP: f64 = 0.02;

static INFO: Info = Info {
    id: "motor_coupling",
    title: "The motor is turned by the joint before it too",
    equation: "friction −f_v w − f_c tanh(w/w₀) on w = v_j + ρ v_i, with ρ times that on joint i, the joint before",
    source: "M. Gautier, S. Briot, ASME J. Dyn. Syst. Meas. Control 136(5), 2014 (the wrist of the Stäubli TX40)",
    kind: Kind::Force,
    class: Class::Coupling,
    has_joint: true,
    parameters: &[
        parameter("viscous", "N*m*s/rad", Unit::Damping, 0.0, 2.0),
        parameter("coulomb", "N*m", Unit::Torque, 0.0, 1.0),
        parameter("ratio", "1", Unit::One, -3.0, 3.0),
        parameter("transition", "rad/s", Unit::Speed, 0.005, 0.1),
    ],
    starts: &[&[0.0, 0.0, 1.0, SHARP], &[0.0, 0.0, -1.0, SHARP]],
    amplitudes: &[0, 1],
    confusions: &[(
        "joint_coupling",
        "a cable pulls at rest too, this only in motion",
    )],
    regime: "motion of the joint before, while this one rests",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for MotorCoupling {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn source(&self) -> Option<Source> {
        Some(Source {
            own: "-{own.viscous}*({v} + {ratio}*{v_before}) - {own.coulomb}*tanh(({v} + {ratio}*{v_before})/{transition})",
            before: Some(
                "-{ratio}*({own.viscous}*({v} + {ratio}*{v_before}) + {own.coulomb}*tanh(({v} + {ratio}*{v_before})/{transition}))",
            ),
        })
    }
    fn partner(&self, joint: usize) -> Option<usize> {
        joint.checked_sub(1)
    }
    fn needs_partner(&self) -> bool {
        true
    }
    /// Without a ratio it is friction of its own joint.
    fn essential(&self) -> &'static [usize] {
        &[2]
    }
    fn shown(&self, e: &[f64], _gain: f64, _rated: f64) -> Vec<Quantity> {
        vec![
            quantity("viscous", "N*m*s/rad", e[0]),
            quantity("coulomb", "N*m", e[1]),
            quantity("ratio", "1", e[2]),
            quantity("transition", "rad/s", e[3]),
        ]
    }
}

impl<D: Scalar> Law<D> for MotorCoupling {
    fn force(
        &self,
        e: &[D],
        at: &Site<'_, D>,
        _memory: &[D],
        f: &mut Forces<'_, D>,
        _constants: &Constants<D>,
    ) {
        let Some(other) = at.joint.checked_sub(1) else {
            return;
        };
        let w = at.v[at.joint] + e[2] * at.v[other];
        let drag = e[0] * w + e[1] * (w / e[3]).hyperbolic_tangent();
        f.value[at.joint] += -drag;
        f.value[other] += -(drag * e[2]);
    }
}
