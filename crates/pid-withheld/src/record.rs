//! One record under a controller with the nominal robot's inverse dynamics as feedforward and
//! proportional-derivative feedback.

use std::fmt::Write as _;

use pid_interpret::nominal::Nominal;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::causes::{Cause, Kind};
use crate::motion::{LENGTH, Motion, reference};
use crate::plant::{PER_JOINT, Plant};
use crate::robot::{Robot, VELOCITY_HZ};
use crate::world::{STEP, World};

/// Time at rest before a record, s.
const HOLDING: f64 = 0.6;

/// Whose records are made.
pub(crate) struct Setup<'a> {
    /// Drives, sensors and motions.
    pub(crate) robot: &'a Robot,
    /// What the controller knows.
    pub(crate) nominal: &'a Nominal,
    /// The robot as it is, without its causes.
    pub(crate) plant: &'a Plant<f64>,
    /// What is withheld.
    pub(crate) causes: &'a [Cause],
    /// `measured`, `derived` or `absent`.
    pub(crate) velocity: &'a str,
}

/// Position and speed of the encoders at the ends of the steps so far: step by step, joint by joint.
type History = Vec<Vec<(f64, f64)>>;

/// Normal number of mean 0 and standard deviation 1.
fn normal(random: &mut ChaCha8Rng) -> f64 {
    random.sample(StandardNormal)
}

/// The text of one record.
pub(crate) fn record(setup: &Setup<'_>, motion: Motion, random: &mut ChaCha8Rng) -> String {
    let Setup { robot, causes, .. } = *setup;
    let n = robot.joints.len();
    let h = 1.0 / robot.rate;
    let hold = (HOLDING * robot.rate) as usize;
    let samples = (LENGTH * robot.rate) as usize + 1;
    let per_sample = (h / STEP).round() as usize;
    let controller = Controller::new(setup, motion, (hold, samples), random);
    let start: Vec<f64> = (0..n).map(|j| controller.target(j, 0)).collect();
    let mut world = World::new(setup.plant.clone(), causes, &start);
    let mut sensors = Sensors::new(setup, h);
    let mut history: History = vec![(0..n).map(|j| world.encoder(j)).collect()];
    let mut commands: Vec<Vec<f64>> = Vec::new();
    let mut text = header(n, setup.velocity);
    for k in 0..hold + samples {
        let (q, v) = sensors.read(&history, random);
        let mut u = controller.command(k, &q, &sensors.filtered);
        commands.push(u.clone());
        if k >= hold {
            let t = (k - hold) as f64 * h;
            write_row(
                &mut text,
                t,
                &q,
                (setup.velocity != "absent").then_some(&v),
                &u,
            );
        }
        world.command(&mut u, random);
        let noise: Vec<f64> = robot
            .joints
            .iter()
            .map(|j| robot.drive_noise * j.torque / j.gain * normal(random))
            .collect();
        for s in 0..per_sample {
            let t = (k as f64 - hold as f64) * h + s as f64 * STEP;
            let mut applied = u.clone();
            delay(
                &mut applied,
                causes,
                &commands,
                k as f64 * h + s as f64 * STEP,
                h,
            );
            for (a, e) in applied.iter_mut().zip(&noise) {
                *a += e;
            }
            world.step(&applied, t);
            history.push((0..n).map(|j| world.encoder(j)).collect());
        }
    }
    text
}

/// Late inputs: what arrives in the step that begins at the time `from` since the first command;
/// `h`: sample time, s.
fn delay(applied: &mut [f64], causes: &[Cause], commands: &[Vec<f64>], from: f64, h: f64) {
    for c in causes {
        if let Kind::InputDelay { delay } = c.kind {
            // The mean over the step, in which the command may change.
            let at = |t: f64| {
                let i = ((t - delay) / h + 1e-9).floor().max(0.0) as usize;
                (i, commands[i.min(commands.len() - 1)][c.joint])
            };
            let ((_, before), (i, after)) = (at(from), at(from + STEP));
            let share = ((from + STEP - delay - i as f64 * h) / STEP).clamp(0.0, 1.0);
            applied[c.joint] = before + (after - before) * share;
        }
    }
}

/// The names of the columns.
fn header(n: usize, velocity: &str) -> String {
    let mut text = String::from("t");
    for (head, some) in [("q", true), ("dq", velocity != "absent"), ("u", true)] {
        for j in 0..n {
            if some {
                // Writing to a string cannot fail.
                let _ = write!(text, ",{head}{}", j + 1);
            }
        }
    }
    text.push('\n');
    text
}

/// One sample.
fn write_row(text: &mut String, t: f64, q: &[f64], v: Option<&Vec<f64>>, u: &[f64]) {
    let _ = write!(text, "{t:.6}");
    for x in q {
        let _ = write!(text, ",{x:.7}");
    }
    for x in v.into_iter().flatten() {
        let _ = write!(text, ",{x:.6}");
    }
    for x in u {
        let _ = write!(text, ",{x:.7}");
    }
    text.push('\n');
}

/// Encoders and velocities, with what is wrong about them.
struct Sensors<'a> {
    setup: &'a Setup<'a>,
    h: f64,
    /// Forgetting of the filter behind a derived velocity, per sample.
    fade: f64,
    /// Derived velocities.
    filtered: Vec<f64>,
    /// Velocities behind a lag.
    shown: Vec<f64>,
    previous: Vec<Option<f64>>,
}

impl<'a> Sensors<'a> {
    fn new(setup: &'a Setup<'a>, h: f64) -> Self {
        let n = setup.robot.joints.len();
        Self {
            setup,
            h,
            fade: (-std::f64::consts::TAU * VELOCITY_HZ * h).exp(),
            filtered: vec![0.0; n],
            shown: vec![0.0; n],
            previous: vec![None; n],
        }
    }

    /// Readings of positions and velocities at the end of the last step.
    fn read(&mut self, history: &History, random: &mut ChaCha8Rng) -> (Vec<f64>, Vec<f64>) {
        let n = self.previous.len();
        let (mut q, mut v) = (vec![0.0; n], vec![0.0; n]);
        for j in 0..n {
            let (x, w) = self.encoder(history, j);
            let joint = &self.setup.robot.joints[j];
            let measured = self.setup.velocity == "measured";
            let noisy = x + joint.q_noise * normal(random);
            q[j] = (noisy / joint.q_step).round() * joint.q_step;
            let difference = (q[j] - self.previous[j].unwrap_or(q[j])) / self.h;
            self.previous[j] = Some(q[j]);
            self.filtered[j] = self.fade * self.filtered[j] + (1.0 - self.fade) * difference;
            let mut read = if measured { w } else { self.filtered[j] };
            let lag = self.setup.causes.iter().find_map(|c| match c.kind {
                Kind::VelocityFilterLag { time } if c.joint == j => Some((-self.h / time).exp()),
                _ => None,
            });
            if let Some(a) = lag {
                self.shown[j] = a * self.shown[j] + (1.0 - a) * read;
                read = self.shown[j];
            }
            if measured {
                read += joint.v_noise * normal(random);
            }
            v[j] = read;
        }
        (q, v)
    }

    /// Position and speed that reach the reading: late, shifted, eccentric.
    fn encoder(&self, history: &History, j: usize) -> (f64, f64) {
        let causes = self.setup.causes;
        let now = history.len() - 1;
        let delay = causes
            .iter()
            .find_map(|c| match c.kind {
                Kind::SensorDelay { delay } if c.joint == j => Some(delay / STEP),
                _ => None,
            })
            .unwrap_or(0.0);
        let at = (now as f64 - delay).max(0.0);
        let (i, s) = (at.floor() as usize, at.fract());
        let ((qa, va), (qb, vb)) = (history[i][j], history[(i + 1).min(now)][j]);
        let (mut x, mut w) = (qa * (1.0 - s) + qb * s, va * (1.0 - s) + vb * s);
        for c in causes.iter().filter(|c| c.joint == j) {
            match c.kind {
                Kind::EncoderOffset { offset } => x += offset,
                Kind::EncoderEccentricity { amplitude, phase } => {
                    w *= 1.0 + amplitude * (x + phase).cos();
                    x += amplitude * (x + phase).sin();
                }
                _ => {}
            }
        }
        (x, w)
    }
}

/// The controller with its reference motion.
struct Controller<'a> {
    robot: &'a Robot,
    model: Plant<f64>,
    /// Inertia by which the feedback of each joint is scaled.
    weights: Vec<f64>,
    /// Positions to be reached, joint by joint.
    wanted: Vec<Vec<f64>>,
    /// Samples of rest before the motion.
    hold: usize,
    h: f64,
}

impl<'a> Controller<'a> {
    fn new(
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
        }
    }

    /// Position that the joint `j` is to have at the `k`-th sample, rest included.
    fn target(&self, j: usize, k: usize) -> f64 {
        let wanted = &self.wanted[j];
        wanted[k.saturating_sub(self.hold).min(wanted.len() - 1)]
    }

    /// Inputs at the `k`-th sample; the controller works on the readings of positions and on derived
    /// velocities.
    fn command(&self, k: usize, q: &[f64], derived: &[f64]) -> Vec<f64> {
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
            // Natural frequency, rad/s, and damping ratio of the closed loop.
            let (w, damping) = (18.0, 0.8);
            torque += self.weights[j]
                * (w * w * (position[j] - q[j]) + 2.0 * damping * w * (rates[j] - derived[j]));
            let limit = 2.0 * self.robot.joints[j].torque;
            u[j] = torque.clamp(-limit, limit) / self.robot.joints[j].gain;
        }
        u
    }
}
