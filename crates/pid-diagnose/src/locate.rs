//! Where the gap lives: the missing force of the nominal fit, joint by joint, and the quantity it
//! depends on.
//!
//! The missing force w(t) is that of [`pid_fit::gap::force`], under the nominal structure with its
//! fitted parameters, on the test records. How far it is a function of one quantity x (velocity,
//! position, load, time since the last reversal, time) is the correlation ratio of its class means,
//! adjusted for the number of classes,
//!
//! ```text
//! η² = 1 − (N − 1)/(N − K) · Σ (w − w̄_class)² / Σ (w − w̄)²
//! ```
//!
//! (R. A. Fisher, Statistical Methods for Research Workers, 1925, section 45; T. L. Kelley 1935 for
//! the adjustment), over K classes of equal number, apart for either direction of motion. Samples
//! at rest are left out, since dry friction takes any value there.

use pid_fit::gap::correlation_ratio;
use std::cell::RefCell;

use pid_data::{Dataset, Role};
use pid_fit::gap::force::{MissingForceError, States, missing_force};
use pid_interpret::Model;
use serde::{Deserialize, Serialize};

use crate::case::{Case, Velocity};
use crate::fit::Fit;
use crate::predict::{Runner, gains};

/// Classes per direction.
pub const CLASSES: usize = 10;
/// A joint is at rest below this share of its largest speed.
const REST: f64 = 0.02;
/// Time must explain this much more than any other quantity.
const TIME: f64 = 0.25;
/// Points kept of a curve.
const POINTS: usize = 500;
/// Points kept of a cloud.
const CLOUD: usize = 1500;

/// Why the missing force cannot be found.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LocateError {
    /// The structure has no usable equations.
    #[error("the nominal structure: {0}")]
    Model(#[from] pid_interpret::Error),
    /// A record.
    #[error(transparent)]
    Force(#[from] MissingForceError),
}

/// Quantities on which the missing force may depend.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Axis {
    /// Velocity of the joint.
    Velocity,
    /// Position of the joint.
    Position,
    /// Torque that the motion takes.
    Load,
    /// Time since the joint last changed direction.
    SinceReversal,
    /// Time since the start of the record.
    Time,
}

impl Axis {
    /// All of them.
    pub const ALL: [Axis; 5] = [
        Axis::Velocity,
        Axis::Position,
        Axis::Load,
        Axis::SinceReversal,
        Axis::Time,
    ];

    /// The quantity in words.
    pub fn words(self) -> &'static str {
        match self {
            Axis::Velocity => "velocity",
            Axis::Position => "position",
            Axis::Load => "load",
            Axis::SinceReversal => "time since the reversal",
            Axis::Time => "time",
        }
    }
}

/// One sample in motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// The quantities of [`Axis::ALL`], in that order.
    pub x: [f64; 5],
    /// Missing force, N·m or N.
    pub w: f64,
    /// Whether the joint moves in the positive direction.
    pub forward: bool,
}

/// A class of samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Class {
    /// Number of samples.
    pub number: f64,
    /// Mean of the quantity.
    pub at: f64,
    /// Mean of the force.
    pub mean: f64,
    /// Standard deviation of the force within the class.
    pub spread: f64,
    /// Direction.
    pub forward: bool,
}

/// Missing force over time in one record.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// The record.
    pub record: String,
    /// Time, s.
    pub t: Vec<f64>,
    /// Missing force.
    pub w: Vec<f64>,
    /// Two standard deviations.
    pub band: Vec<f64>,
}

/// One joint.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct JointForce {
    /// Root mean square of the missing force, N·m or N.
    pub rms: f64,
    /// The same relative to the joint's typical torque.
    pub relative: f64,
    /// η² for each of [`Axis::ALL`].
    pub explained: [f64; 5],
    /// Over time.
    pub curves: Vec<Curve>,
    /// Samples in motion, thinned.
    pub samples: Vec<Sample>,
}

impl JointForce {
    /// The quantity that explains most. Any force is a function of time, so time counts only where
    /// it explains much more.
    pub fn regime(&self) -> (Axis, f64) {
        let time = self.explained[Axis::Time as usize];
        let best = Axis::ALL
            .into_iter()
            .filter(|a| *a != Axis::Time)
            .map(|a| (a, self.explained[a as usize]))
            .max_by(|a, b| a.1.total_cmp(&b.1));
        match best {
            Some((axis, x)) if x + TIME > time => (axis, x),
            _ => (Axis::Time, time),
        }
    }
}

/// Where the gap lives.
#[derive(Debug, Clone, PartialEq)]
pub struct MissingForce {
    /// Every joint, base to tip.
    pub joints: Vec<JointForce>,
}

impl MissingForce {
    /// Share of each joint in the squared missing force, in units of the typical torques.
    pub fn shares(&self) -> Vec<f64> {
        let sum: f64 = self.joints.iter().map(|j| j.relative.powi(2)).sum();
        self.joints
            .iter()
            .map(|j| j.relative.powi(2) / sum.max(1e-300))
            .collect()
    }
    /// The joint with the largest share, from 0.
    pub fn worst(&self) -> usize {
        let shares = self.shares();
        (0..shares.len())
            .max_by(|&a, &b| shares[a].total_cmp(&shares[b]))
            .unwrap_or(0)
    }
}

/// Finds the missing force of the nominal fit on the test records of the case's data set.
///
/// # Errors
/// If the structure has no equations that can be evaluated, or the smoother cannot follow a record.
pub fn locate(case: &Case, base: &Fit, dataset: &Dataset) -> Result<MissingForce, LocateError> {
    let n = case.n();
    let model = Model::new(case.nominal.description.robot())?;
    let p = case.nominal.parameters(&base.point.theta);
    let mut joints = vec![JointForce::default(); n];
    let (mut squares, mut count) = (vec![0.0; n], 0.0);
    for e in dataset.with_role(Role::Test) {
        let force = missing_force(&model, &p, dataset, e, States::NONE)?;
        count += force.t.len() as f64;
        for (j, out) in joints.iter_mut().enumerate() {
            let column = |x: &[f64]| -> Vec<f64> { x.iter().skip(j).step_by(n).copied().collect() };
            let (q, v, w) = (column(&force.q), column(&force.v), column(&force.w));
            let (load, band) = (column(&force.total), column(&force.band));
            squares[j] += w.iter().map(|x| x * x).sum::<f64>();
            let rest = REST * case.scale[j].speed;
            let mut reversal = force.t.first().copied().unwrap_or(0.0);
            for k in 0..w.len() {
                if k > 0 && v[k] * v[k - 1] <= 0.0 {
                    reversal = force.t[k];
                }
                if v[k].abs() > rest {
                    let t = force.t[k];
                    out.samples.push(Sample {
                        x: [v[k], q[k], load[k], t - reversal, t],
                        w: w[k],
                        forward: v[k] > 0.0,
                    });
                }
            }
            out.curves.push(Curve {
                record: e.name.clone(),
                t: decimated(&force.t, POINTS),
                w: decimated(&w, POINTS),
                band: decimated(&band, POINTS),
            });
        }
    }
    Ok(summed(case, joints, &squares, count))
}

/// Size and regimes of the samples of a joint; thins the samples.
fn summed(case: &Case, mut joints: Vec<JointForce>, squares: &[f64], count: f64) -> MissingForce {
    for (j, out) in joints.iter_mut().enumerate() {
        out.rms = (squares[j] / f64::max(count, 1.0)).sqrt();
        out.relative = out.rms / case.scale[j].torque;
        for axis in Axis::ALL {
            out.explained[axis as usize] = ratio(&out.samples, axis);
        }
        let every = out.samples.len().div_ceil(CLOUD).max(1);
        out.samples = out.samples.iter().step_by(every).copied().collect();
    }
    MissingForce { joints }
}

/// Bandwidth of the observer behind [`rest`], rad/s.
const REST_BANDWIDTH: f64 = 30.0;
/// The first so many seconds of a record depend on its start and are left out.
const SETTLING: f64 = 0.2;

/// The force that a fit still misses, its effects included, on the test records.
///
/// An observer of disturbances runs on the simulation itself and follows the readings (K. Ohnishi, M.
/// Shibata, T. Murakami, IEEE/ASME Trans. Mechatronics 1(1), 1996), so every effect of the library is
/// included.
pub fn residual_force(case: &Case, fit: &Fit) -> MissingForce {
    let mut joints = vec![JointForce::default(); case.n()];
    let (mut squares, mut count) = (vec![0.0; case.n()], 0.0);
    for record in residuals(case, fit, Role::Test) {
        count += record.t.len() as f64;
        for ((j, out), own) in joints.iter_mut().enumerate().zip(&record.joints) {
            let slow = REST * case.scale[j].speed;
            let mut reversal = record.t.first().copied().unwrap_or(0.0);
            for (k, &t) in record.t.iter().enumerate() {
                if k > 0 && own.v[k] * own.v[k - 1] <= 0.0 {
                    reversal = t;
                }
                squares[j] += own.force[k] * own.force[k];
                if own.v[k].abs() > slow {
                    out.samples.push(Sample {
                        x: [own.v[k], own.q[k], own.load[k], t - reversal, t],
                        w: own.force[k],
                        forward: own.v[k] > 0.0,
                    });
                }
            }
            let t = decimated(&record.t, POINTS);
            out.curves.push(Curve {
                record: record.name.clone(),
                band: vec![0.0; t.len()],
                t,
                w: decimated(&own.force, POINTS),
            });
        }
    }
    summed(case, joints, &squares, count)
}

/// Motion of a joint and the force that a fit misses there, at the samples of a record, SI.
#[derive(Debug, Clone, Default)]
pub(crate) struct JointResidual {
    /// Position and velocity of the drive side.
    pub(crate) q: Vec<f64>,
    pub(crate) v: Vec<f64>,
    /// Torque that the gear passes.
    pub(crate) load: Vec<f64>,
    /// Missing force.
    pub(crate) force: Vec<f64>,
}

/// Missing forces of a record.
#[derive(Debug, Clone)]
pub(crate) struct Residual {
    /// The record.
    name: String,
    /// Time since its start, s.
    pub(crate) t: Vec<f64>,
    /// Joint by joint.
    pub(crate) joints: Vec<JointResidual>,
}

/// The force that a fit still misses, its effects included, on the records of a role.
///
/// An observer with gain K_v on the velocity follows the readings ε. For that it needs the force
/// `I K_v ε / h` beside the model's own (an observer of disturbances: K. Ohnishi, M. Shibata, T.
/// Murakami, IEEE/ASME Trans. Mechatronics 1(1), 1996), up to its bandwidth of 30 rad/s. It runs on
/// the simulation itself.
pub(crate) fn residuals(case: &Case, fit: &Fit, role: Role) -> Vec<Residual> {
    let n = case.n();
    let case = crate::levels::with_bandwidth(case, REST_BANDWIDTH);
    let (theta, e) = (&fit.point.theta, &fit.point.e);
    let of = |record: &crate::case::Record| {
        let gains = gains((&case, record), &fit.hypothesis, theta, e);
        let length = record.len();
        let motion = RefCell::new(vec![[0.0; 3]; length * n]);
        let mut errors = vec![[0.0; 2]; length * n];
        Runner::<f64>::new(&case, record, &fit.hypothesis, theta, e).predict(
            &gains,
            &mut |k, j, channel, x| errors[k * n + j][channel] = x,
            &mut |k, state| {
                for j in 0..n {
                    motion.borrow_mut()[k * n + j] =
                        [state.drive_v[j], state.drive_q[j], state.load[j]];
                }
            },
        );
        let motion = motion.into_inner();
        let first = ((SETTLING / record.h) as usize).min(length - 1);
        let joint = |j: usize| {
            let g = &gains[j];
            let mut out = JointResidual::default();
            for k in first..length {
                let [x0, x1] = errors[k * n + j];
                let eq = x0 / g.whiten[0][0];
                let ev = match case.velocity[j] {
                    Velocity::Measured => (x1 - eq * g.whiten[1][0]) / g.whiten[1][1],
                    _ => 0.0,
                };
                let [v, q, load] = motion[k * n + j];
                out.q.push(q);
                out.v.push(v);
                out.load.push(load);
                let pulled = g.rows[1][0] * eq + g.rows[1][1] * ev;
                out.force.push(case.scale[j].inertia * pulled / record.h);
            }
            out
        };
        Residual {
            name: record.name.clone(),
            t: (first..length).map(|k| k as f64 * record.h).collect(),
            joints: (0..n).map(joint).collect(),
        }
    };
    let records = case.records.iter().filter(|r| r.role == role);
    records.map(of).collect()
}

/// Means over blocks.
fn decimated(x: &[f64], most: usize) -> Vec<f64> {
    let block = x.len().div_ceil(most).max(1);
    x.chunks(block)
        .map(|c| c.iter().sum::<f64>() / c.len() as f64)
        .collect()
}

/// Classes of equal number along a quantity, apart for either direction.
pub fn classes(samples: &[Sample], axis: Axis) -> Vec<Class> {
    let mut out = Vec::new();
    for forward in [true, false] {
        let mut own: Vec<(f64, f64)> = samples
            .iter()
            .filter(|s| s.forward == forward)
            .map(|s| (s.x[axis as usize], s.w))
            .collect();
        own.sort_by(|a, b| a.0.total_cmp(&b.0));
        let size = own.len().div_ceil(CLASSES).max(1);
        for part in own.chunks(size) {
            let number = part.len() as f64;
            let mean = part.iter().map(|p| p.1).sum::<f64>() / number;
            let square = part.iter().map(|p| (p.1 - mean).powi(2)).sum::<f64>();
            out.push(Class {
                number,
                at: part.iter().map(|p| p.0).sum::<f64>() / number,
                mean,
                spread: (square / number).sqrt(),
                forward,
            });
        }
    }
    out
}

/// η², at least 0.
fn ratio(samples: &[Sample], axis: Axis) -> f64 {
    let n = samples.len() as f64;
    let mean = samples.iter().map(|s| s.w).sum::<f64>() / n;
    let total: f64 = samples.iter().map(|s| (s.w - mean).powi(2)).sum();
    let classes = classes(samples, axis);
    let within: f64 = classes.iter().map(|c| c.number * c.spread * c.spread).sum();
    correlation_ratio(within, total, n, classes.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn sample(v: f64, q: f64, w: f64) -> Sample {
        Sample {
            x: [v, q, 0.3 * q, 1.0, 2.0],
            w,
            forward: v > 0.0,
        }
    }

    #[test]
    fn a_force_of_velocity_is_explained_by_velocity_alone() {
        let samples: Vec<Sample> = (0..4000)
            .map(|i| {
                let x = f64::from(i);
                let (v, q) = ((0.37 * x).sin(), (0.011 * x).cos());
                sample(v, q, -0.5 * v * v.abs())
            })
            .collect();
        let [v, q, ..] = Axis::ALL.map(|a| ratio(&samples, a));
        assert!(v > 0.97, "{v}");
        // The direction alone explains half of it, and this share is the same for every quantity.
        assert!(q < 0.85, "{q}");
        let c = classes(&samples, Axis::Velocity);
        assert_eq!(c.len(), 2 * CLASSES);
        for class in c {
            assert!((class.mean + 0.5 * class.at * class.at.abs()).abs() < 0.01);
        }
    }

    #[test]
    fn noise_is_explained_by_nothing() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut uniform = || random.random_range(-0.5..0.5);
        let samples: Vec<Sample> = (0..3000)
            .map(|_| sample(uniform(), uniform(), uniform()))
            .collect();
        for axis in [Axis::Velocity, Axis::Position, Axis::Load] {
            assert!(ratio(&samples, axis) < 0.02);
        }
    }
}
