//! The robot on which effects are drawn, and an effect of a size at its second joint.

use std::path::Path;

use pid_effects::constants::{Constant, Constants};
use pid_effects::effect::{Effect, Forces, Friction, Site, Unit};
use pid_effects::nominal::Nominal;
use pid_interpret::links::At;

use crate::Failure;

/// Typical torque, N·m, speed, rad/s, and range, rad, of both joints: a third of a turn at half a
/// turn in three seconds, as an arm of a few kilograms moves.
const TORQUE: f64 = 6.0;
const SPEED: f64 = 1.0;
const RANGE: f64 = 2.0;
/// The joint with the effect: one that has a joint before it.
pub(crate) const JOINT: usize = 1;
/// Amplitudes are drawn this many times the start of a search, which is small, so that they show.
const CLEAR: f64 = 4.0;

/// The robot.
pub(crate) struct Reference {
    pub(crate) nominal: Nominal,
    theta: Vec<f64>,
}

/// What a joint feels besides gravity and inertia, N·m: friction against the motion, the level of dry
/// friction, and the other forces on it and on the joint before.
#[derive(Clone, Copy)]
pub(crate) struct Felt {
    pub(crate) dry: f64,
    pub(crate) viscous: f64,
    pub(crate) level: f64,
    pub(crate) own: f64,
    pub(crate) before: f64,
}

impl Reference {
    pub(crate) fn new() -> Result<Self, Failure> {
        let nominal = Nominal::parse(include_str!("reference.toml"), Path::new("reference.toml"))
            .map_err(|e| Failure(format!("the robot of the catalogue: {e}")))?;
        let theta = vec![0.0; nominal.size()];
        Ok(Reference { nominal, theta })
    }

    /// Typical input, A.
    pub(crate) fn input(&self) -> f64 {
        TORQUE / self.nominal.gain(JOINT)
    }

    /// Size of a unit at the joint, SI.
    fn unit(&self, unit: Unit) -> f64 {
        match unit {
            Unit::One | Unit::Share | Unit::Angle | Unit::Time | Unit::Ratio => 1.0,
            Unit::Torque => TORQUE,
            Unit::Input => self.input(),
            Unit::Speed => SPEED,
            Unit::Acceleration => SPEED * SPEED / RANGE,
            Unit::Range => RANGE,
            Unit::Inertia => 0.05,
            Unit::Stiffness => TORQUE / RANGE,
            Unit::Damping => TORQUE / SPEED,
            Unit::Drag => TORQUE / (SPEED * SPEED),
            Unit::Wave => 1.0 / RANGE,
            Unit::Compliance => RANGE / TORQUE,
            Unit::InverseInput => 1.0 / self.input(),
            Unit::InverseSquareInput => 1.0 / self.input().powi(2),
            Unit::Mass => 1.0,
            Unit::Force => TORQUE / 0.25,
        }
    }

    /// Parameters at which an effect is drawn, SI: those of the middle start of a search, amplitudes
    /// larger, within the ranges. Where all amplitudes start at zero they take a twentieth.
    pub(crate) fn size(&self, effect: &dyn Effect) -> Vec<f64> {
        let info = effect.info();
        let start = info.starts.get(info.starts.len() / 2).copied();
        let mut e: Vec<f64> = start.unwrap_or_default().to_vec();
        e.resize(info.parameters.len(), 0.0);
        let absent = info.amplitudes.iter().all(|&i| e[i] == 0.0);
        for (i, p) in info.parameters.iter().enumerate() {
            if info.amplitudes.contains(&i) {
                let start = if absent { 0.05 } else { e[i] };
                e[i] = (CLEAR * start).clamp(p.lower, 0.8 * p.upper);
            }
            e[i] *= self.unit(p.unit);
        }
        // Times at which an effect goes on and off: two of the six seconds drawn.
        for (k, &i) in effect.edges().iter().enumerate() {
            e[i] = [1.0, 2.0, 3.5, 5.0].get(k).copied().unwrap_or(1e5);
        }
        e
    }

    fn constants(&self) -> Constants<'_, f64> {
        Constants::new(&self.nominal, &self.theta)
    }

    /// Friction and forces at a motion.
    pub(crate) fn felt(
        &self,
        effect: Option<(&dyn Effect, &[f64])>,
        at: &Site<'_, f64>,
        memory: &[f64],
    ) -> Felt {
        let mut constants = self.constants();
        let level = constants.get(Constant::Coulomb(JOINT));
        let mut friction = Friction {
            forward: level,
            backward: level,
            viscous: constants.get(Constant::Viscous(JOINT)),
        };
        let (mut value, mut rate) = ([0.0; 2], [0.0; 2]);
        if let Some((effect, e)) = effect {
            let law = effect.plain();
            law.constants(e, JOINT, &mut constants);
            law.friction(e, at, memory, &mut friction);
            let mut forces = Forces {
                value: &mut value,
                rate: &mut rate,
            };
            law.force(e, at, memory, &mut forces, &constants);
        }
        let v = at.v[JOINT];
        let dry = if v > 0.0 {
            friction.forward
        } else if v < 0.0 {
            -friction.backward
        } else {
            0.0
        };
        Felt {
            dry,
            viscous: friction.viscous * v,
            level: friction.forward,
            own: value[JOINT] - rate[JOINT] * v,
            before: value[JOINT - 1] - rate[JOINT - 1] * at.v[JOINT - 1],
        }
    }

    /// Inertia that each joint feels, kg·m², and the torques that hold the arm, N·m, at a position.
    pub(crate) fn structure(
        &self,
        effect: Option<(&dyn Effect, &[f64])>,
        q: [f64; 2],
    ) -> ([f64; 2], [f64; 2]) {
        let mut constants = self.constants();
        if let Some((effect, e)) = effect {
            effect.plain().constants(e, JOINT, &mut constants);
        }
        let mut work = constants.prepared();
        let at = At {
            q: &q,
            v: &[0.0; 2],
            force: None,
        };
        let mut bias = [0.0; 2];
        self.nominal
            .links
            .evaluate(&mut work, &at, f64::sin_cos, &mut bias);
        let m = work.mass();
        (
            [
                m[0] + constants.get(Constant::Rotor(0)),
                m[2] + constants.get(Constant::Rotor(1)),
            ],
            bias,
        )
    }
}
