//! The controller: the nominal robot's inverse dynamics as feedforward and proportional-derivative
//! feedback.

use rand_chacha::ChaCha8Rng;

use crate::motion::{Motion, reference};
use crate::plant::{PER_JOINT, Plant};
use crate::robot::{Joint, Robot};
use crate::setup::Setup;

/// Largest natural frequency of the closed loop, rad/s.
const FREQUENCY: f64 = 18.0;
/// The same per sample rate: a slow loop must be softer.
const PER_RATE: f64 = 0.2;
/// Damping ratio of the closed loop.
const DAMPING: f64 = 0.8;
/// Largest command, in largest usual torques.
const LIMIT: f64 = 2.0;

/// Largest command of a joint's controller.
pub(crate) fn limit(joint: &Joint) -> f64 {
    LIMIT * joint.torque / joint.gain
}

/// The controller with its reference motion.
pub(crate) struct Controller<'a> {
    robot: &'a Robot,
    model: Plant<f64>,
    /// Inertia by which the feedback of each joint is scaled.
    weights: Vec<f64>,
    /// Positions to be reached, joint by joint.
    wanted: Vec<Vec<f64>>,
    /// Samples of rest before the motion.
    hold: usize,
    h: f64,
    /// Natural frequency of the closed loop, rad/s.
    frequency: f64,
}

impl<'a> Controller<'a> {
    pub(crate) fn new(
        setup: &Setup<'a>,
        motion: Motion,
        (hold, samples): (usize, usize),
        random: &mut ChaCha8Rng,
    ) -> Self {
        let robot = setup.robot;
        let h = 1.0 / robot.rate;
        let theta = vec![0.0; robot.joints.len() * PER_JOINT];
        Self {
            robot,
            model: Plant::new(setup.nominal, &theta),
            weights: robot.inertia(setup.nominal),
            wanted: robot
                .joints
                .iter()
                .map(|j| reference(motion, &j.room, samples, h, random))
                .collect(),
            hold,
            h,
            frequency: FREQUENCY.min(PER_RATE * robot.rate),
        }
    }

    /// Position that the joint `j` is to have at the `k`-th sample, rest included.
    pub(crate) fn target(&self, j: usize, k: usize) -> f64 {
        let wanted = &self.wanted[j];
        wanted[k.saturating_sub(self.hold).min(wanted.len() - 1)]
    }

    /// Inputs at the `k`-th sample; the controller works on the readings of positions and on derived
    /// velocities.
    pub(crate) fn command(&self, k: usize, q: &[f64], derived: &[f64]) -> Vec<f64> {
        let (n, h) = (q.len(), self.h);
        let target = |j: usize, k: usize| self.target(j, k);
        let slope = |j: usize| (target(j, k + 1) - target(j, k.saturating_sub(1))) / (2.0 * h);
        let bend = |j: usize| {
            (target(j, k + 1) - 2.0 * target(j, k) + target(j, k.saturating_sub(1))) / (h * h)
        };
        let position: Vec<f64> = (0..n).map(|j| target(j, k)).collect();
        let rates: Vec<f64> = (0..n).map(slope).collect();
        let (m, bias) = self.model.mass_and_bias(&position, &rates);
        let mut u = vec![0.0; n];
        for j in 0..n {
            let mut torque = bias[j] + self.model.rotor[j] * bend(j);
            for i in 0..n {
                torque += m[(j, i)] * bend(i);
            }
            let w = self.frequency;
            torque += self.weights[j]
                * (w * w * (position[j] - q[j]) + 2.0 * DAMPING * w * (rates[j] - derived[j]));
            let joint = &self.robot.joints[j];
            let limit = limit(joint);
            u[j] = (torque / joint.gain).clamp(-limit, limit);
        }
        u
    }
}
