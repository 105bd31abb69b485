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

use super::causes::{Cause, Kind};
use super::linkage::{Linkage, Surroundings};
use super::plant::Plant;
use super::rigid::add_point;

/// Integration step, s.
pub(super) const STEP: f64 = 1e-4;
/// Time constant of the torque that loads the gear's friction, s: the torque of the step itself
/// would be an algebraic loop.
const LOAD_FADE: f64 = 1e-3;
/// Sweeps over the friction impulses.
const SWEEPS: usize = 60;

/// The robot with its causes, at one moment.
pub(super) struct World<'a> {
    plant: Plant<f64>,
    causes: &'a [Cause],
    n: usize,
    /// Row of each joint's rotor: its own where the joint is rigid.
    rotor: Vec<usize>,
    /// Positions, links and then rotors.
    pub(super) q: DVector<f64>,
    /// Velocities.
    pub(super) v: DVector<f64>,
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

impl<'a> World<'a> {
    /// At rest at `q` under the inputs that hold it.
    pub(super) fn new(mut plant: Plant<f64>, causes: &'a [Cause], q: &[f64]) -> Self {
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
        world.around(None);
        world.load.copy_from_slice(&world.bias);
        for j in 0..n {
            world.applied[j] = world.bias[j] / world.plant.gain[j];
            world.last[j] = world.applied[j];
        }
        world
    }

    /// Angle of the rotor and its speed: what a motor-side encoder turns with.
    pub(super) fn encoder(&self, j: usize) -> (f64, f64) {
        let r = self.rotor[j];
        (self.q[r], self.v[r] + 0.5 * STEP * self.acceleration[r])
    }

    fn around(&mut self, push: Option<[f64; 3]>) {
        let surroundings = Surroundings {
            gravity: self.plant.gravity,
            tip_force: push,
        };
        let n = self.n;
        let motion = (&self.q.as_slice()[..n], &self.v.as_slice()[..n]);
        self.linkage
            .mass_and_bias(&surroundings, motion, &mut self.mass, &mut self.bias);
    }

    /// Once per sample, before the steps: what the drive makes of a command.
    pub(super) fn command(&mut self, u: &mut [f64], random: &mut ChaCha8Rng) {
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
    pub(super) fn step(&mut self, u: &[f64], t: f64) {
        let n = self.n;
        let rows = self.q.len();
        let push = self.causes.iter().find_map(|c| match c.kind {
            Kind::ExternalForce { force, windows } => windows
                .iter()
                .any(|w| w[0] <= t && t < w[1])
                .then_some(force),
            _ => None,
        });
        self.around(push);
        let mut m = DMatrix::zeros(rows, rows);
        let mut f = DVector::zeros(rows);
        let mut level = vec![0.0; rows];
        for i in 0..n {
            f[i] -= self.bias[i];
            for k in 0..n {
                m[(i, k)] = self.mass[i * n + k];
            }
        }
        for j in 0..n {
            let r = self.rotor[j];
            m[(r, r)] += self.plant.rotor[j];
            let (mut coulomb, mut viscous) = (self.plant.coulomb[j], self.plant.viscous[j]);
            let (q, v) = (self.q[r], self.v[r]);
            let mut input = 0.5 * (self.last[j] + u[j]);
            self.last[j] = u[j];
            let mut limit = f64::INFINITY;
            let mut lag = None;
            for c in self.causes {
                let here = c.joint == j;
                match c.kind {
                    Kind::Stribeck { ratio, speed } if here => {
                        coulomb *= 1.0 + (ratio - 1.0) * (-(v / speed).powi(2)).exp();
                    }
                    Kind::CoulombAsymmetry { asymmetry } if here => {
                        f[r] -=
                            asymmetry * (self.plant.coulomb[j] + self.plant.viscous[j] * v.abs());
                    }
                    Kind::LoadDependentFriction { coefficient } if here => {
                        coulomb += coefficient * self.load[j].abs();
                    }
                    Kind::QuadraticDrag { drag } if here => f[r] -= drag * v * v.abs(),
                    Kind::PreslidingHysteresis { range } if here => {
                        let old = self.bristle[j];
                        let new = (old + STEP * v) / (1.0 + STEP * v.abs() / range);
                        self.bristle[j] = new;
                        f[r] -= self.plant.coulomb[j] / range * (new + 1e-3 * (new - old) / STEP);
                        coulomb = 0.0;
                    }
                    Kind::Cogging {
                        amplitude,
                        wave,
                        phase,
                    } if here => {
                        f[r] += amplitude * (wave * q + phase).sin();
                    }
                    Kind::FrictionDrift { excess, time } if here => {
                        let factor = 1.0 + excess * (-t.max(0.0) / time).exp();
                        coulomb *= factor;
                        viscous *= factor;
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
                    Kind::ActuatorLag { time } if here => lag = Some(time),
                    Kind::TorqueSaturation { limit: l } if here => limit = l,
                    Kind::GainErrorNonlinear { droop, at } if here => {
                        input /= 1.0 + droop * (input / at).powi(2);
                    }
                    Kind::CurrentOffset { offset } if here => input += offset,
                    Kind::DriveDeadZone { half_width } if here => {
                        input = input.signum() * (input.abs() - half_width).max(0.0);
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
            // The lag at the ends of the step; its mean acts.
            let before = self.applied[j];
            let after = match lag {
                Some(time) => input + (before - input) * (-STEP / time).exp(),
                None => input,
            };
            self.applied[j] = after;
            let acts = if lag.is_some() {
                0.5 * (before + after)
            } else {
                after
            };
            f[r] += (self.plant.gain[j] * acts).clamp(-limit, limit) - viscous * v;
            level[r] = coulomb;
        }
        // The free motion, then the impulses of dry friction.
        let Some(factor) = m.clone().cholesky() else {
            return;
        };
        let inverse = factor.inverse();
        let free = &self.v + &inverse * &f * STEP;
        let mut next = free;
        let mut impulse = vec![0.0; rows];
        for _ in 0..SWEEPS {
            let mut change = 0.0_f64;
            for i in 0..rows {
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
        let acceleration = (&next - &self.v) / STEP;
        for j in 0..n {
            let mut through = self.bias[j];
            for k in 0..n {
                through += self.mass[j * n + k] * acceleration[k];
            }
            self.load[j] += STEP / LOAD_FADE * (through - self.load[j]);
        }
        self.acceleration.copy_from(&acceleration);
        self.v = next;
        self.q.axpy(STEP, &self.v, 1.0);
    }
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
