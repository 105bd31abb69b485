//! The idealised two-link robot of K. Schäfer, M. Runge, K. Flaßkamp, C. Büskens, *Parameter
//! Identification for Dynamical Systems Using Optimal Control Techniques*, Section V-A: yaw about
//! z, then pitch about y.
//!
//! Nominal values are those of the paper's Table II, where the inertias are about the centres of
//! mass. The table calls κ₁ "viscous" and κ₂ "dry" while the formula
//! `f_L = −κ₁ tanh(a v) − κ₂ v + κ₃ I` uses them the other way round; the units follow the formula.
//! The distance between the axes is not stated and has no effect on the equations of motion.
//!
//! Ranges: 0.1 to 10 times the nominal value, ±0.3 m for the offsets of the centres of mass that
//! are nominally 0.
//!
//! The 19 parameters are not all identifiable: link 1 enters only through `iz1 + m1 (sx1² + sy1²)`,
//! `iz1` can be traded against `ix2` and `iz2` together, and one scale is common to masses,
//! inertias, friction and gains.

use pid_runtime::dynamics::Dynamics;
use pid_runtime::robot;

robot! {
    /// Idealised two-link arm: yaw about z, pitch about y.
    pub robot TwoLink {
        gravity: [0, 0, -9.81] m/s^2;

        params {
            /// Mass of link 1.
            m1: kg = 6.0 in 0.6..=60.0;
            /// Mass of link 2.
            m2: kg = 23.0 in 2.3..=230.0;
            /// Centre of mass of link 1 in its own frame, x.
            sx1: m = 0.0 in -0.3..=0.3;
            /// Centre of mass of link 1 in its own frame, y.
            sy1: m = 0.0 in -0.3..=0.3;
            /// Centre of mass of link 2 in its own frame, x.
            sx2: m = 0.0 in -0.3..=0.3;
            /// Centre of mass of link 2 in its own frame, y.
            sy2: m = 0.0 in -0.3..=0.3;
            /// Centre of mass of link 2 in its own frame, z.
            sz2: m = 0.2875 in 0.02875..=2.875;
            /// Inertia of link 1 about its centre of mass, axis z.
            iz1: kg*m^2 = 0.03 in 0.003..=0.3;
            /// Inertia of link 2 about its centre of mass, axis x.
            ix2: kg*m^2 = 0.6912 in 0.06912..=6.912;
            /// Inertia of link 2 about its centre of mass, axis y.
            iy2: kg*m^2 = 0.6912 in 0.06912..=6.912;
            /// Inertia of link 2 about its centre of mass, axis z.
            iz2: kg*m^2 = 0.115 in 0.0115..=1.15;
        }

        link upper { mass: m1; com: [sx1, sy1, _];   inertia at com: diag(_, _, iz1); }
        link fore  { mass: m2; com: [sx2, sy2, sz2]; inertia at com: diag(ix2, iy2, iz2); }

        joint shoulder: revolute about z { base -> upper; }
        joint elbow: revolute about y { upper -> fore at [0, 0, 0] m; }

        per joint {
            /// Motor current.
            input current: A;
            /// Dry friction, κ₁.
            dry: N*m = [1.0, 2.0] in [0.1..=10.0, 0.2..=20.0];
            /// Viscous friction, κ₂.
            viscous: N*m*s/rad = [8.0, 3.0] in [0.8..=80.0, 0.3..=30.0];
            /// Torque per ampere, κ₃.
            gain: N*m/A = [0.7, 0.4] in [0.07..=7.0, 0.04..=4.0];
            /// Sharpness of the transition of dry friction at rest, a.
            sharp: s/rad = 50.0 in 5.0..=500.0;

            force = -dry*tanh(sharp*v) - viscous*v + gain*current;
        }

        emit { dynamics, first_derivatives, second_derivatives, lanes }
        expect rank 14;
        expect rank 13 at nominal;
    }
}

/// Combinations of the 19 parameters that motions under known currents determine, all over κ₃ of
/// the elbow: the inertia of the hanging arm about z, its change with the elbow's angle, the
/// inertia about the elbow, the moment of gravity, κ₃ of the shoulder, then κ₁ and κ₂ of both
/// joints. `p` in the order of the model's parameters.
///
/// # Panics
/// If `p` is not as long as the model's parameters.
pub fn identifiable(p: &[f64]) -> [(&'static str, f64); 9] {
    let infos = TwoLink.params();
    assert_eq!(p.len(), infos.len(), "parameters of the two-link robot");
    let at = |name: &str| {
        let k = infos.iter().position(|i| i.name == name);
        p[k.unwrap_or_else(|| unreachable!("the robot declares {name}"))]
    };
    let square = |name: &str| at(name) * at(name);
    let (m1, m2) = (at("m1"), at("m2"));
    let combinations = [
        (
            "Iz1 + m1 (sx1² + sy1²) + Iz2 + m2 (sx2² + sy2²)",
            at("iz1")
                + m1 * (square("sx1") + square("sy1"))
                + at("iz2")
                + m2 * (square("sx2") + square("sy2")),
        ),
        (
            "Ix2 − Iz2 + m2 (sz2² − sx2²)",
            at("ix2") - at("iz2") + m2 * (square("sz2") - square("sx2")),
        ),
        (
            "Iy2 + m2 (sx2² + sz2²)",
            at("iy2") + m2 * (square("sx2") + square("sz2")),
        ),
        ("m2 sz2", m2 * at("sz2")),
        ("κ3 of joint 1", at("gain_shoulder")),
        ("κ1 of joint 1", at("dry_shoulder")),
        ("κ1 of joint 2", at("dry_elbow")),
        ("κ2 of joint 1", at("viscous_shoulder")),
        ("κ2 of joint 2", at("viscous_elbow")),
    ];
    combinations.map(|(name, value)| (name, value / at("gain_elbow")))
}
