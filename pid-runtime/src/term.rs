//! Force terms that a declaration lacks: friction laws and rotor inertias as options of an estimation.
//!
//! A term adds `c φ(w, α, u; s)` to the residual of its joints. `w` and `α` are velocity and
//! acceleration of the joint (or the sum of two joints' for a motor that turns with both), `u` is
//! the joint's input, `c` a coefficient to be estimated, `s` a shape parameter where φ has one.
//! Signs are those of a resistance: positive coefficients take energy out of the motion.
//!
//! | term | φ | c in | s |
//! |---|---|---|---|
//! | `armature` | α | kg·m² | |
//! | `offset` | 1 | N·m | |
//! | `viscous` | w | N·m·s/rad | |
//! | `coulomb` | tanh(w/v₀) | N·m | |
//! | `asymmetric` | w tanh(w/v₀): the viscous friction is c₀ + c forwards, c₀ − c backwards | N·m·s/rad | |
//! | `stribeck` | exp(−(w/s)²) tanh(w/v₀) | N·m | Stribeck velocity |
//! | `saturating` | tanh(w/s): viscous friction that grows ever less (strain-wave gears) | N·m | velocity |
//! | `load` | √(ũ² + ε²) tanh(w/v₀): friction grows with the transmitted drive torque; ũ = u, for a voltage u − k w with the motor's constant k (parameter `gain_JOINT`) | N·m per unit of u | |
//! | `quadratic` | w √(w² + v₀²) | N·m·s² | |
//! | `presliding` | z of [`crate::memory`], at three widths: friction that builds up over a displacement | N·m | |
//!
//! v₀ is the velocity of the transition at rest ([`REST_ROTATION`], [`REST_TRANSLATION`]), ε a
//! thousandth of a unit of the input. `presliding` depends on the motion so far: the model takes z
//! as one more input, and the caller computes it from the positions. Sources: B.
//! Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, Automatica 30, 1994 (Stribeck); P. Hamon, M.
//! Gautier, P. Garrec, IROS 2010 (load); A. Janot, M. Gautier, M. Brunot, 2019 (asymmetry).

use num_dual::{DualNum, HyperDual64};
use std::fmt;
use std::str::FromStr;

/// Transition velocity v₀ of revolute joints, rad/s.
pub const REST_ROTATION: f64 = 0.02;
/// Transition velocity v₀ of prismatic joints, m/s.
pub const REST_TRANSLATION: f64 = 0.001;
/// Smoothing of |u|, in units of the input.
const LOAD_SMOOTHING: f64 = 1e-3;

/// A force law φ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Law {
    /// Inertia of a rotor.
    Armature,
    /// Constant force.
    Offset,
    /// Viscous friction.
    Viscous,
    /// Coulomb friction.
    Coulomb,
    /// Viscous friction that differs between the directions.
    Asymmetric,
    /// Excess of friction at low velocity.
    Stribeck,
    /// Viscous friction that saturates.
    Saturating,
    /// Friction in proportion to the transmitted drive torque.
    Load,
    /// Friction with the square of the velocity.
    Quadratic,
    /// Friction that builds up over a displacement.
    Presliding,
}

/// All laws.
pub const LAWS: [Law; 10] = [
    Law::Armature,
    Law::Offset,
    Law::Viscous,
    Law::Coulomb,
    Law::Asymmetric,
    Law::Stribeck,
    Law::Saturating,
    Law::Load,
    Law::Quadratic,
    Law::Presliding,
];

/// Arguments of φ: velocity, acceleration, input, shape parameter.
pub(crate) const ARGUMENTS: usize = 4;
/// Position of the shape parameter among the arguments.
pub(crate) const SHAPE: usize = 3;

impl Law {
    /// The word on the command line.
    pub fn word(self) -> &'static str {
        match self {
            Law::Armature => "armature",
            Law::Offset => "offset",
            Law::Viscous => "viscous",
            Law::Coulomb => "coulomb",
            Law::Asymmetric => "asymmetric",
            Law::Stribeck => "stribeck",
            Law::Saturating => "saturating",
            Law::Load => "load",
            Law::Quadratic => "quadratic",
            Law::Presliding => "presliding",
        }
    }

    /// Identifier of the effect of the library whose linear form it is; `None` for a law that every
    /// model may have.
    pub fn effect(self) -> Option<&'static str> {
        match self {
            Law::Armature => Some("unmodelled_rotor_inertia"),
            Law::Offset => Some("current_offset"),
            Law::Asymmetric => Some("coulomb_asymmetry"),
            Law::Stribeck => Some("stribeck"),
            Law::Load => Some("load_dependent_friction"),
            Law::Quadratic => Some("quadratic_drag"),
            Law::Presliding => Some("presliding_hysteresis"),
            Law::Saturating => Some("saturating_friction"),
            Law::Viscous | Law::Coulomb => None,
        }
    }

    /// Whether φ has a shape parameter, a velocity.
    pub fn has_shape(self) -> bool {
        matches!(self, Law::Stribeck | Law::Saturating)
    }

    /// Whether φ depends on the motion so far, by a state that the model takes as an input.
    pub fn has_memory(self) -> bool {
        self == Law::Presliding
    }

    /// Whether a negative coefficient would feed energy into the motion.
    pub fn non_negative(self) -> bool {
        !matches!(self, Law::Offset | Law::Asymmetric)
    }

    /// Unit of the coefficient for a revolute or prismatic joint with an input of the given unit.
    pub fn unit(self, prismatic: bool, input: &str) -> String {
        let (force, speed) = if prismatic {
            ("N", "m")
        } else {
            ("N*m", "rad")
        };
        match self {
            Law::Armature if prismatic => "kg".to_owned(),
            Law::Armature => "kg*m^2".to_owned(),
            Law::Offset | Law::Coulomb | Law::Stribeck | Law::Saturating | Law::Presliding => {
                force.to_owned()
            }
            Law::Viscous | Law::Asymmetric => format!("{force}*s/{speed}"),
            Law::Load if input == force => "1".to_owned(),
            Law::Load => format!("{force}/{input}"),
            Law::Quadratic => format!("{force}*s^2/{speed}^2"),
        }
    }

    /// Which of (w, α, u, s) φ depends on.
    pub(crate) fn depends(self) -> [bool; ARGUMENTS] {
        match self {
            Law::Armature => [false, true, false, false],
            Law::Offset => [false; ARGUMENTS],
            Law::Viscous | Law::Coulomb | Law::Asymmetric | Law::Quadratic => {
                [true, false, false, false]
            }
            Law::Stribeck | Law::Saturating => [true, false, false, true],
            Law::Load => [true, false, true, true],
            Law::Presliding => [false, false, true, false],
        }
    }

    /// Whether φ is linear in its arguments, so that its second derivatives vanish.
    pub(crate) fn linear(self) -> bool {
        matches!(
            self,
            Law::Armature | Law::Offset | Law::Viscous | Law::Presliding
        )
    }

    /// φ of (w, α, u, s) with the transition velocity v₀; s of [`Law::Load`] is the motor's
    /// constant behind a voltage, or 0; u of [`Law::Presliding`] is its state z.
    pub fn value<D: DualNum<Primitive = f64> + Copy>(self, x: [D; ARGUMENTS], rest: f64) -> D {
        let [w, alpha, u, s] = x;
        let sign = || saturated(w / rest);
        match self {
            Law::Armature => alpha,
            Law::Offset => D::from(1.0),
            Law::Viscous => w,
            Law::Coulomb => sign(),
            Law::Asymmetric => w * sign(),
            Law::Stribeck => {
                let ratio = w / s;
                (-(ratio * ratio)).exp() * sign()
            }
            Law::Saturating => saturated(w / s),
            Law::Load => {
                let net = u - s * w;
                (net * net + LOAD_SMOOTHING * LOAD_SMOOTHING).sqrt() * sign()
            }
            Law::Quadratic => w * (w * w + rest * rest).sqrt(),
            Law::Presliding => u,
        }
    }

    /// φ, its gradient and its Hessian.
    pub(crate) fn derivatives(
        self,
        x: [f64; ARGUMENTS],
        rest: f64,
    ) -> (f64, [f64; ARGUMENTS], [[f64; ARGUMENTS]; ARGUMENTS]) {
        let (mut gradient, mut hessian) = ([0.0; ARGUMENTS], [[0.0; ARGUMENTS]; ARGUMENTS]);
        let depends = self.depends();
        let mut seeded = x.map(HyperDual64::from_re);
        for i in (0..ARGUMENTS).filter(|&i| depends[i]) {
            for j in (0..=i).filter(|&j| depends[j]) {
                seeded[i].eps1 = 1.0;
                seeded[j].eps2 = 1.0;
                let f = self.value(seeded, rest);
                seeded[i].eps1 = 0.0;
                seeded[j].eps2 = 0.0;
                gradient[i] = f.eps1;
                hessian[i][j] = f.eps1eps2;
                hessian[j][i] = f.eps1eps2;
            }
        }
        (self.value(x, rest), gradient, hessian)
    }
}

/// tanh, whose derivatives stay finite where the exponential functions overflow: beyond 20 it is ±1
/// to rounding.
fn saturated<D: DualNum<Primitive = f64> + Copy>(x: D) -> D {
    if x > 20.0 {
        D::from(1.0)
    } else if x < -20.0 {
        D::from(-1.0)
    } else {
        x.tanh()
    }
}

/// A law and its place: every joint, one joint, or a motor that turns with the sum of two.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Request {
    /// The law.
    pub law: Law,
    /// Where.
    pub place: Place,
}

/// Where a term acts.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Place {
    /// At every joint, each with a coefficient of its own.
    EveryJoint,
    /// At the joint of this name.
    Joint(String),
    /// At a motor that turns with the sum of two joints; the force acts on both.
    Sum(String, String),
}

/// A term that cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{text}` is not a force term\n  help: write a law, `stribeck`, a law at a joint, `stribeck:elbow`, or a law at a motor of two joints, `viscous:j5+j6`; the laws are {laws}"
)]
pub struct ParseTermError {
    /// The text written.
    pub text: String,
    /// The laws.
    pub laws: String,
}

impl FromStr for Request {
    type Err = ParseTermError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let error = || ParseTermError {
            text: text.to_owned(),
            laws: LAWS.map(Law::word).join(", "),
        };
        let (word, place) = match text.split_once(':') {
            None => (text, Place::EveryJoint),
            Some((word, place)) => match place.split_once('+') {
                None => (word, Place::Joint(place.trim().to_owned())),
                Some((a, b)) => (word, Place::Sum(a.trim().to_owned(), b.trim().to_owned())),
            },
        };
        let law = LAWS
            .into_iter()
            .find(|law| law.word() == word.trim() || law.effect() == Some(word.trim()))
            .ok_or_else(error)?;
        Ok(Self { law, place })
    }
}

impl fmt::Display for Request {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.law.word())?;
        match &self.place {
            Place::EveryJoint => Ok(()),
            Place::Joint(j) => write!(f, ":{j}"),
            Place::Sum(a, b) => write!(f, ":{a}+{b}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn derivatives_are_those_of_differences(
            x in prop::array::uniform4(0.1_f64..1.5),
            negative in prop::bool::ANY,
        ) {
            let mut x = x;
            if negative { x[0] = -x[0]; }
            // Away from the rounded kink of |ũ|, which differences of this step do not resolve.
            prop_assume!((x[2] - x[3] * x[0]).abs() > 0.1);
            let rest = 0.5;
            for law in LAWS {
                let (value, gradient, hessian) = law.derivatives(x, rest);
                prop_assert_eq!(value, law.value(x, rest));
                for i in 0..ARGUMENTS {
                    let h = 1e-5;
                    let at = |d: f64| { let mut y = x; y[i] += d; law.derivatives(y, rest) };
                    let (up, down) = (at(h), at(-h));
                    prop_assert!(((up.0 - down.0) / (2.0 * h) - gradient[i]).abs() < 1e-6, "{law:?} {i}");
                    for j in 0..ARGUMENTS {
                        let second = (up.1[j] - down.1[j]) / (2.0 * h);
                        prop_assert!((second - hessian[i][j]).abs() < 1e-4, "{law:?} {i} {j}");
                    }
                    prop_assert!(law.depends()[i] || gradient[i] == 0.0);
                }
            }
        }
    }

    #[test]
    fn requests_are_read_and_refused() {
        let read = |t: &str| t.parse::<Request>();
        assert_eq!(read("stribeck").unwrap().place, Place::EveryJoint);
        assert_eq!(read("load:x").unwrap().place, Place::Joint("x".into()));
        let sum = read("viscous:j5+j6").unwrap();
        assert_eq!(sum.place, Place::Sum("j5".into(), "j6".into()));
        assert_eq!(sum.to_string(), "viscous:j5+j6");
        let message = read("striction").unwrap_err().to_string();
        assert!(
            message.contains("`striction`") && message.contains("stribeck"),
            "{message}"
        );
    }

    #[test]
    fn friction_of_a_non_negative_law_never_drives() {
        for law in LAWS
            .into_iter()
            .filter(|l| l.non_negative() && *l != Law::Armature && !l.has_memory())
        {
            for w in [-2.0, -0.01, 0.0, 0.003, 1.0] {
                assert!(
                    law.value([w, 0.3, -0.7, 0.2], 0.02) * w >= 0.0,
                    "{law:?} at {w}"
                );
            }
        }
    }
}
