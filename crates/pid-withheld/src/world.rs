//! The simulated robot: rigid links with rotors, gears, dry friction by impulses, causes by their
//! definitions.
//!
//! Symplectic Euler at 0.1 ms: `v⁺ = v + δ M⁻¹ (τ − b) − M⁻¹ λ` with friction impulses
//! `λ ∈ δ·level·Sgn(v⁺)` by projected Gauss-Seidel sweeps (J. J. Moreau, Unilateral contact and dry
//! friction in finite freedom dynamics, 1988), then `q⁺ = q + δ v⁺`. Read as leap-frog: velocities
//! belong to the middle between two positions (E. Hairer, C. Lubich, G. Wanner, Acta Numerica 12,
//! 2003, section 1), so that the inputs of a step are those from half a step before to half a step
//! after, and a velocity is read half a step on. Taken at the ends of the step, delays and lags
//! would be short by 0.05 to 0.1 ms.

use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::causes::{Cause, Kind};
use crate::linkage::{Linkage, Surroundings};
use crate::plant::Plant;
use crate::rigid::add_point;

/// Integration step, s.
pub(crate) const STEP: f64 = 1e-4;
/// Time constant of the torque that loads the gear's friction, s: the torque of the step itself
/// would be an algebraic loop.
const LOAD_FADE: f64 = 1e-3;
/// Sweeps over the friction impulses.
const SWEEPS: usize = 60;

/// The robot with its causes, at one moment.
pub(crate) struct World<'a> {
    plant: Plant<f64>,
    causes: &'a [Cause],
    n: usize,
    /// Row of each joint's rotor: its own where the joint is rigid.
    rotor: Vec<usize>,
    /// Positions, links and then rotors.
    pub(crate) q: DVector<f64>,
    /// Velocities.
    pub(crate) v: DVector<f64>,
    applied: Vec<f64>,
    /// Inputs of the step before, and accelerations.
    last: Vec<f64>,
    acceleration: DVector<f64>,
    bristle: Vec<f64>,
    load: Vec<f64>,
    dropped: usize,
    kept: f64,
    linkage: Linkage<f64>,
    mass: Vec<f64>,
    bias: Vec<f64>,
}

/// A robot at one moment, joint by joint: what a run with other causes goes on from.
#[derive(Debug, Clone)]
pub(crate) struct Moment {
    /// Position and velocity of the links.
    link: Vec<(f64, f64)>,
    /// The same of the rotors.
    rotor: Vec<(f64, f64)>,
    applied: Vec<f64>,
    last: Vec<f64>,
    bristle: Vec<f64>,
    load: Vec<f64>,
}

impl<'a> World<'a> {
    /// At rest at `q` under the inputs that hold it.
    pub(crate) fn new(mut plant: Plant<f64>, causes: &'a [Cause], q: &[f64]) -> Self {
        let n = q.len();
        let mut rotor: Vec<usize> = (0..n).collect();
        let mut rows = n;
        for c in causes {
            match c.kind {
                Kind::JointElasticity { .. } | Kind::Backlash { .. } => {
                    rotor[c.joint] = rows;
                    rows += 1;
                }
                Kind::UnmodelledRotorInertia { extra } => plant.rotor[c.joint] += extra,
                Kind::Payload { mass } => {
                    let tool = plant.tool;
                    add_point(&mut plant.bodies[n - 1], mass, tool);
                }
                Kind::BaseTilt { x, y } => plant.gravity = tilted(plant.gravity, x, y),
                _ => {}
            }
        }
        let mut world = World {
            linkage: plant.linkage(),
            plant,
            causes,
            n,
            q: DVector::from_fn(rows, |i, _| if i < n { q[i] } else { 0.0 }),
            v: DVector::zeros(rows),
            applied: vec![0.0; n],
            last: vec![0.0; n],
            acceleration: DVector::zeros(rows),
            bristle: vec![0.0; n],
            load: vec![0.0; n],
            dropped: 0,
            kept: 0.0,
            mass: vec![0.0; n * n],
            bias: vec![0.0; n],
            rotor,
        };
        for j in 0..n {
            let r = world.rotor[j];
            world.q[r] = q[j];
        }
        world.around(None, 0.0);
        world.load.copy_from_slice(&world.bias);
        for j in 0..n {
            world.applied[j] = world.bias[j] / world.plant.gain[j];
            world.last[j] = world.applied[j];
        }
        world
    }

    /// Angle of the rotor and its speed: what a motor-side encoder turns with.
    pub(crate) fn encoder(&self, j: usize) -> (f64, f64) {
        let r = self.rotor[j];
        (self.q[r], self.v[r] + 0.5 * STEP * self.acceleration[r])
    }

    /// The present moment.
    pub(crate) fn moment(&self) -> Moment {
        let row = |r: usize| (self.q[r], self.v[r]);
        Moment {
            link: (0..self.n).map(row).collect(),
            rotor: self.rotor.iter().map(|&r| row(r)).collect(),
            applied: self.applied.clone(),
            last: self.last.clone(),
            bristle: self.bristle.clone(),
            load: self.load.clone(),
        }
    }

    /// Goes on from a moment of a robot with more causes, each joint moved by a position and a
    /// velocity. A joint that is rigid here is where its rotor is.
    pub(crate) fn resume(&mut self, moment: &Moment, moved: &[(f64, f64)]) {
        for (j, moved) in moved.iter().enumerate() {
            for (r, from) in [(j, moment.link[j]), (self.rotor[j], moment.rotor[j])] {
                self.q[r] = from.0 + moved.0;
                self.v[r] = from.1 + moved.1;
            }
        }
        self.applied.copy_from_slice(&moment.applied);
        self.last.copy_from_slice(&moment.last);
        self.bristle.copy_from_slice(&moment.bristle);
        self.load.copy_from_slice(&moment.load);
    }

    fn around(&mut self, push: Option<[f64; 3]>, t: f64) {
        let mut gravity = self.plant.gravity;
        for c in self.causes {
            if let Kind::ShakenBase {
                amplitude,
                frequency,
            } = c.kind
            {
                // In the axes of a base that accelerates, gravity is less its acceleration.
                let wave = (std::f64::consts::TAU * frequency * t).sin();
                for (g, a) in gravity.iter_mut().zip(amplitude) {
                    *g -= a * wave;
                }
            }
        }
        let surroundings = Surroundings {
            gravity,
            tip_force: push,
        };
        let n = self.n;
        let motion = (&self.q.as_slice()[..n], &self.v.as_slice()[..n]);
        self.linkage
            .mass_and_bias(&surroundings, motion, &mut self.mass, &mut self.bias);
    }

    /// Once per sample, before the steps: what the drive makes of a command.
    pub(crate) fn command(&mut self, u: &mut [f64], random: &mut ChaCha8Rng) {
        for c in self.causes {
            if let Kind::DroppedCommands {
                probability,
                length,
            } = c.kind
            {
                if self.dropped == 0 && random.random_bool(probability.min(0.2)) {
                    self.dropped = length;
                }
                if self.dropped > 0 {
                    self.dropped -= 1;
                    u[c.joint] = self.kept;
                } else {
                    self.kept = u[c.joint];
                }
            }
        }
    }

    /// One step under the inputs `u` (noise included) at time `t` since the record began.
    pub(crate) fn step(&mut self, u: &[f64], t: f64) {
        let rows = self.q.len();
        let push = self.causes.iter().find_map(|c| match c.kind {
            Kind::ExternalForce { force, windows } => windows
                .iter()
                .any(|w| w[0] <= t && t < w[1])
                .then_some(force),
            _ => None,
        });
        self.around(push, t);
        let mut m = DMatrix::zeros(rows, rows);
        let mut f = DVector::zeros(rows);
        let mut level = vec![0.0; rows];
        for i in 0..self.n {
            f[i] -= self.bias[i];
            for k in 0..self.n {
                m[(i, k)] = self.mass[i * self.n + k];
            }
        }
        for j in 0..self.n {
            let r = self.rotor[j];
            m[(r, r)] += self.plant.rotor[j];
            level[r] = self.drive(j, u, t, &mut f);
        }
        // The free motion, then the impulses of dry friction.
        let Some(factor) = m.cholesky() else {
            return;
        };
        let inverse = factor.inverse();
        let free = &self.v + &inverse * &f * STEP;
        let next = stopped(free, &inverse, &level);
        let acceleration = (&next - &self.v) / STEP;
        for j in 0..self.n {
            let mut through = self.bias[j];
            for k in 0..self.n {
                through += self.mass[j * self.n + k] * acceleration[k];
            }
            self.load[j] += STEP / LOAD_FADE * (through - self.load[j]);
        }
        self.acceleration.copy_from(&acceleration);
        self.v = next;
        self.q.axpy(STEP, &self.v, 1.0);
    }

    /// Adds the forces of a drive and of the causes that act at it; returns the level of its dry
    /// friction.
    fn drive(&mut self, j: usize, inputs: &[f64], t: f64, f: &mut DVector<f64>) -> f64 {
        let r = self.rotor[j];
        let u = inputs[j];
        let mut drive = Drive {
            coulomb: self.plant.coulomb[j],
            viscous: self.plant.viscous[j],
            input: 0.5 * (self.last[j] + u),
            limit: f64::INFINITY,
            lag: None,
        };
        self.last[j] = u;
        for c in self.causes {
            if c.joint == j {
                self.rub(&c.kind, j, t, &mut drive, f);
                drive.distort(&c.kind, t);
            }
            if let Kind::SupplySag { loss, at } = c.kind {
                let taken: f64 = inputs.iter().map(|u| u.abs()).sum();
                drive.input *= (1.0 - loss * taken / at).max(0.0);
            }
            self.push(c, j, t, f);
        }
        // The lag at the ends of the step; its mean acts.
        let before = self.applied[j];
        let after = match drive.lag {
            Some(time) => drive.input + (before - drive.input) * (-STEP / time).exp(),
            None => drive.input,
        };
        self.applied[j] = after;
        let acts = if drive.lag.is_some() {
            0.5 * (before + after)
        } else {
            after
        };
        let torque = (self.plant.gain[j] * acts).clamp(-drive.limit, drive.limit);
        f[r] += torque - drive.viscous * self.v[r];
        drive.coulomb
    }

    /// Friction of the drive `j` as a cause at it changes it.
    fn rub(&mut self, kind: &Kind, j: usize, t: f64, drive: &mut Drive, f: &mut DVector<f64>) {
        let r = self.rotor[j];
        let v = self.v[r];
        match *kind {
            Kind::Stribeck { ratio, speed } => {
                drive.coulomb *= 1.0 + (ratio - 1.0) * (-(v / speed).powi(2)).exp();
            }
            Kind::CoulombAsymmetry { asymmetry } => {
                f[r] -= asymmetry * (self.plant.coulomb[j] + self.plant.viscous[j] * v.abs());
            }
            Kind::LoadDependentFriction { coefficient } => {
                drive.coulomb += coefficient * self.load[j].abs();
            }
            Kind::QuadraticDrag { drag } => f[r] -= drag * v * v.abs(),
            Kind::PreslidingHysteresis { range } => {
                let old = self.bristle[j];
                let new = (old + STEP * v) / (1.0 + STEP * v.abs() / range);
                self.bristle[j] = new;
                f[r] -= self.plant.coulomb[j] / range * (new + 1e-3 * (new - old) / STEP);
                drive.coulomb = 0.0;
            }
            Kind::FrictionDrift { excess, time } => {
                let factor = 1.0 + excess * (-t.max(0.0) / time).exp();
                drive.coulomb *= factor;
                drive.viscous *= factor;
            }
            _ => {}
        }
    }

    /// What a cause, at whichever joint, does at the drive `j` and its link.
    fn push(&self, c: &Cause, j: usize, t: f64, f: &mut DVector<f64>) {
        let here = c.joint == j;
        let r = self.rotor[j];
        let (q, v) = (self.q[r], self.v[r]);
        match c.kind {
            Kind::Cogging {
                amplitude,
                wave,
                phase,
            } if here => {
                f[r] += amplitude * (wave * q + phase).sin();
            }
            Kind::JointElasticity { stiffness, damping } if here => {
                let torque = stiffness * (q - self.q[j]) + damping * (v - self.v[j]);
                f[r] -= torque;
                f[j] += torque;
            }
            Kind::Backlash {
                gap,
                stiffness,
                damping,
            } if here => {
                let x = q - self.q[j];
                let over = x - x.clamp(-0.5 * gap, 0.5 * gap);
                // As a tendon's spring with a dead band: the damper works throughout.
                let torque = stiffness * over + damping * (v - self.v[j]);
                f[r] -= torque;
                f[j] += torque;
            }
            Kind::JointCoupling {
                stiffness,
                ratio,
                rest,
            } => {
                let other = if c.joint > 0 { c.joint - 1 } else { 1 };
                let stretch = self.q[c.joint] + ratio * self.q[other] - rest;
                if here {
                    f[j] -= stiffness * stretch;
                } else if j == other {
                    f[j] -= stiffness * ratio * stretch;
                }
            }
            Kind::GearMesh {
                amplitude,
                waves,
                phase,
            } if here => {
                let other = self.rotor[j - 1];
                f[r] += amplitude * (waves[0] * q + waves[1] * self.q[other] + phase).sin();
            }
            Kind::Hose {
                stiffness,
                ratio,
                slack,
            } if here => {
                let tight = (self.q[j] + ratio * self.q[j - 1] - slack).max(0.0);
                f[j] -= stiffness * tight;
                f[j - 1] -= stiffness * ratio * tight;
            }
            Kind::Spring { stiffness, rest } if here => {
                f[j] -= stiffness * (self.q[j] - rest);
            }
            Kind::SoftStop { from, stiffness } if here && q > from => {
                f[r] -= (stiffness * (q - from) + 0.02 * stiffness * v).max(0.0);
            }
            Kind::MainsHum {
                amplitude,
                frequency,
            } if here => {
                f[r] += amplitude * (std::f64::consts::TAU * frequency * t).sin();
            }
            _ => {}
        }
    }
}

/// One drive within a step.
struct Drive {
    /// Level of dry friction.
    coulomb: f64,
    viscous: f64,
    /// The input, half a step before to half a step after.
    input: f64,
    /// Largest torque or force.
    limit: f64,
    /// Time constant of the actuator, s.
    lag: Option<f64>,
}

impl Drive {
    /// What a cause does to the input.
    fn distort(&mut self, kind: &Kind, t: f64) {
        match *kind {
            Kind::ActuatorLag { time } => self.lag = Some(time),
            Kind::TorqueSaturation { limit } => self.limit = limit,
            Kind::GainErrorNonlinear { droop, at } => {
                self.input /= 1.0 + droop * (self.input / at).powi(2);
            }
            Kind::CurrentOffset { offset } => self.input += offset,
            Kind::GainFade { loss, time } => {
                self.input *= 1.0 - loss * (1.0 - (-t.max(0.0) / time).exp());
            }
            Kind::DriveDeadZone { half_width } => {
                self.input = self.input.signum() * (self.input.abs() - half_width).max(0.0);
            }
            _ => {}
        }
    }
}

/// The free velocities after the impulses of dry friction: projected Gauss-Seidel sweeps.
fn stopped(free: DVector<f64>, inverse: &DMatrix<f64>, level: &[f64]) -> DVector<f64> {
    let mut next = free;
    let mut impulse = vec![0.0; level.len()];
    for _ in 0..SWEEPS {
        let mut change = 0.0_f64;
        for i in 0..level.len() {
            if level[i] <= 0.0 {
                continue;
            }
            let bound = level[i] * STEP;
            let wanted = (impulse[i] + next[i] / inverse[(i, i)]).clamp(-bound, bound);
            let d: f64 = wanted - impulse[i];
            if d != 0.0 {
                impulse[i] = wanted;
                next.axpy(-d, &inverse.column(i), 1.0);
                change = change.max(d.abs() / bound);
            }
        }
        if change < 1e-9 {
            break;
        }
    }
    next
}

/// Gravity in the axes of a base turned by (x, y) rad: Rodrigues' formula with the opposite angle.
fn tilted(g: [f64; 3], x: f64, y: f64) -> [f64; 3] {
    let angle = x.hypot(y);
    if angle == 0.0 {
        return g;
    }
    let e = [x / angle, y / angle, 0.0];
    let cross = [
        e[1] * g[2] - e[2] * g[1],
        e[2] * g[0] - e[0] * g[2],
        e[0] * g[1] - e[1] * g[0],
    ];
    let along = e[0] * g[0] + e[1] * g[1] + e[2] * g[2];
    [0, 1, 2]
        .map(|i| g[i] * angle.cos() - cross[i] * angle.sin() + e[i] * along * (1.0 - angle.cos()))
}
