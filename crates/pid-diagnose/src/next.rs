//! The next experiment: the motion, within limits, that separates two rivals best, and by how much.
//!
//! Candidate motions are sums of sines, fast and slow ones, within the positions, speeds and
//! torques that the records (or the stated limits) show to be safe. Each runs in closed loop on the
//! robot as rival A describes it; rival B then predicts the readings. With ε the whitened
//! innovations of B,
//!
//! ```text
//! Λ = ½ ( |ε|² − εᵀ J (H + JᵀJ)⁻¹ Jᵀ ε )
//! ```
//!
//! is the expected logarithm of the likelihood ratio after B is refitted to old and new records
//! together. J are the derivatives of ε in B's parameters, H the curvature from the old records (W.
//! J. Hunter, A. M. Reiner, Designs for discriminating between two rival models, Technometrics 7,
//! 1965, with the old records as prior). The lesser of both directions counts. Many motions are
//! ranked by |ε|² alone, the best ones by Λ; small changes improve the winner.

use std::f64::consts::TAU;

use pid_data::{GainFactors, Role};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::case::{Case, Record};
use pid_interpret::links;

use crate::constants::{Constant, Constants};
use crate::effect::Commands;
use crate::fit::{Direction, Fit, all_gains, gram, linearise, value};
use crate::predict::Runner;
use crate::simulate::{Machine, State};
use crate::substeps::Substeps;

/// Length of a motion, s.
const LENGTH: f64 = 8.0;
/// Time in which a motion starts from rest and comes to rest, s.
const EDGE: f64 = 0.5;
/// Points in the shortest period of a motion at which its limits are checked: the bound between
/// them then costs less than a hundredth of the amplitude. And most points of a piece, however fast
/// its sines are.
const POINTS: f64 = 32.0;
const MOST_POINTS: f64 = 20_000.0;
/// Sines per joint.
const SINES: usize = 5;
/// Motions that are drawn, and those of them that are judged with refits.
const DRAWN: (usize, usize) = (24, 4);
/// Changes tried on the winner.
const CHANGES: usize = 16;
/// A motion may use this share of the positions, speeds and torques seen (or stated).
const SAFE: f64 = 0.95;
/// Seed of the draws.
const SEED: u64 = 0x9e1f;
/// Largest log-likelihood ratio that is stated: beyond it the motion decides anyway.
const ENOUGH: f64 = 1e6;

/// Limits of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// Lowest and highest position, rad or m.
    pub position: (f64, f64),
    /// Largest speed.
    pub speed: f64,
    /// Largest torque or force.
    pub torque: f64,
}

/// A motion that separates two rivals.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Experiment {
    /// The two rivals, as `effect:joint`; `none` for the nominal structure.
    pub rivals: (String, String),
    /// Expected logarithm of the likelihood ratio in favour of the right rival, after refits: if
    /// the first is right, if the second is.
    pub log_odds: (f64, f64),
    /// Limits that the motion keeps.
    pub limits: Vec<Limits>,
    /// Sample time, s.
    pub sample_time: f64,
    /// Reference positions, one row per sample.
    pub q: Vec<Vec<f64>>,
    /// Reference velocities.
    pub v: Vec<Vec<f64>>,
}

impl Experiment {
    /// The lesser of both directions.
    pub fn least(&self) -> f64 {
        self.log_odds.0.min(self.log_odds.1)
    }

    /// As a table `t,q1,…,dq1,…`, SI units.
    pub fn to_csv(&self) -> String {
        let n = self.limits.len();
        let mut text = String::from("t");
        for name in ["q", "dq"] {
            for j in 1..=n {
                text.push_str(&format!(",{name}{j}"));
            }
        }
        text.push('\n');
        for (k, (q, v)) in self.q.iter().zip(&self.v).enumerate() {
            text.push_str(&format!("{:.6}", k as f64 * self.sample_time));
            for x in q.iter().chain(v) {
                text.push_str(&format!(",{x:.8}"));
            }
            text.push('\n');
        }
        text
    }
}

/// Sines of one joint: amplitude, frequency in Hz, phase; about a middle.
#[derive(Debug, Clone)]
struct Wave {
    middle: f64,
    sines: Vec<(f64, f64, f64)>,
}

impl Wave {
    /// Position, velocity and acceleration; starts and ends at rest, within [`EDGE`].
    fn at(&self, t: f64) -> (f64, f64, f64) {
        let (mut q, mut v, mut a) = (0.0, 0.0, 0.0);
        for &(size, hz, phase) in &self.sines {
            let w = TAU * hz;
            let (s, c) = (w * t + phase).sin_cos();
            q += size * s;
            v += size * w * c;
            a -= size * w * w * s;
        }
        // A window that is flat but for its ends: s = x² (3 − 2x).
        let x = (t / EDGE).min((LENGTH - t) / EDGE).clamp(0.0, 1.0);
        let sign = if t < 0.5 * LENGTH { 2.0 } else { -2.0 };
        let inside = x > 0.0 && x < 1.0;
        let s = x * x * (3.0 - 2.0 * x);
        let ds = if inside {
            6.0 * x * (1.0 - x) * sign
        } else {
            0.0
        };
        let dds = if inside { (6.0 - 12.0 * x) * 4.0 } else { 0.0 };
        (
            self.middle + s * q,
            s * v + ds * q,
            s * a + 2.0 * ds * v + dds * q,
        )
    }

    /// Bounds on the second derivatives of position, velocity and acceleration: for sums of sines
    /// of at most `S_k = Σ a ωᵏ` in the k-th derivative, and within the window, whose derivatives
    /// are at most 3, 24 and 96 per second and its powers, by the rule of Leibniz.
    fn curvatures(&self, windowed: bool) -> [f64; 3] {
        let s: [f64; 5] = std::array::from_fn(|k| {
            let sines = self.sines.iter();
            sines.map(|s| s.0.abs() * (TAU * s.1).powi(k as i32)).sum()
        });
        if windowed {
            [
                s[2] + 6.0 * s[1] + 24.0 * s[0],
                s[3] + 9.0 * s[2] + 72.0 * s[1] + 96.0 * s[0],
                s[4] + 12.0 * s[3] + 144.0 * s[2] + 384.0 * s[1],
            ]
        } else {
            [s[2], s[3], s[4]]
        }
    }

    /// Scaled so that positions, speeds and accelerations stay within their limits, at all times
    /// and not on a grid alone: between two points d apart a function exceeds the larger of its
    /// values there by at most d²/8 of its second derivative.
    fn within(mut self, limits: &Limits, acceleration: f64) -> Self {
        let half = 0.5 * (limits.position.1 - limits.position.0);
        let fastest = self.sines.iter().map(|s| s.1.abs()).fold(0.0, f64::max);
        let mut over: f64 = 1e-300;
        // The acceleration jumps where the window begins and ends: the pieces between are taken
        // without their ends.
        for (from, to) in [(0.0, EDGE), (EDGE, LENGTH - EDGE), (LENGTH - EDGE, LENGTH)] {
            let windowed = to - from <= EDGE;
            let (from, to) = (from + 1e-9, to - 1e-9);
            let points = (POINTS * fastest * (to - from)).clamp(POINTS, MOST_POINTS);
            let distance = (to - from) / points.ceil();
            let [q_more, v_more, a_more] = self
                .curvatures(windowed)
                .map(|c| c * distance * distance / 8.0);
            for k in 0..=points.ceil() as usize {
                let (q, v, a) = self.at(from + distance * k as f64);
                over = over
                    .max(((q - self.middle).abs() + q_more) / half)
                    .max((v.abs() + v_more) / limits.speed)
                    .max((a.abs() + a_more) / acceleration);
            }
        }
        for s in &mut self.sines {
            s.0 /= over;
        }
        self
    }
}

/// Limits from the description, or from the records where it states none.
pub fn limits(case: &Case) -> Vec<Limits> {
    (0..case.n())
        .map(|j| {
            let seen = case.records.iter().flat_map(|r| r.smooth_q[j].iter());
            let (low, high) = seen.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &x| {
                (a.min(x), b.max(x))
            });
            let (low, high) = case.nominal.joints[j].limits.unwrap_or((low, high));
            let (middle, half) = (0.5 * (low + high), 0.5 * SAFE * (high - low).max(1e-9));
            Limits {
                position: (middle - half, middle + half),
                speed: SAFE * case.scale[j].speed,
                torque: SAFE * case.scale[j].torque,
            }
        })
        .collect()
}

fn draw(case: &Case, limits: &[Limits], slow: bool, random: &mut ChaCha8Rng) -> Vec<Wave> {
    (0..case.n())
        .map(|j| {
            let l = &limits[j];
            let half = 0.5 * (l.position.1 - l.position.0);
            // The frequency at which range and speed are used up together.
            let natural = l.speed / (TAU * half);
            let top = if slow { natural } else { 3.0 * natural };
            let sines = (0..SINES)
                .map(|_| {
                    let hz = top * random.random_range(0.08..1.0);
                    (
                        random.random_range(0.2..1.0) / (1.0 + hz / natural),
                        hz,
                        random.random_range(0.0..TAU),
                    )
                })
                .collect();
            Wave {
                middle: 0.5 * (l.position.0 + l.position.1),
                sines,
            }
            .within(l, bound(case, l, j))
        })
        .collect()
}

/// Acceleration that half the torque gives.
fn bound(case: &Case, limits: &Limits, j: usize) -> f64 {
    0.5 * limits.torque / case.scale[j].inertia
}

fn changed(case: &Case, limits: &[Limits], from: &[Wave], random: &mut ChaCha8Rng) -> Vec<Wave> {
    from.iter()
        .enumerate()
        .map(|(j, w)| {
            let mut w = w.clone();
            for s in &mut w.sines {
                s.0 *= random.random_range(0.6..1.6);
                s.1 *= random.random_range(0.8..1.25);
                s.2 += random.random_range(-0.6..0.6);
            }
            w.within(&limits[j], bound(case, &limits[j], j))
        })
        .collect()
}

/// Position, velocity and acceleration of the reference of every joint.
type Reference = Vec<(f64, f64, f64)>;

/// Inputs that lead a robot along a reference: the torque of the nominal parameters of a fit, and a
/// loop on the states of the drives.
struct Controller<'a> {
    case: &'a Case,
    limits: &'a [Limits],
    feed: Constants<'a, f64>,
    work: links::Work<f64>,
    bias: Vec<f64>,
}

impl Controller<'_> {
    /// Inputs at a reference; `state`: that of the robot, or none before it moves.
    fn inputs(&mut self, reference: &Reference, state: Option<&State<f64>>) -> Vec<f64> {
        let q: Vec<f64> = reference.iter().map(|r| r.0).collect();
        let v: Vec<f64> = reference.iter().map(|r| r.1).collect();
        let at = links::At {
            q: &q,
            v: &v,
            force: None,
        };
        let links = &self.case.nominal.links;
        links.evaluate(&mut self.work, &at, f64::sin_cos, &mut self.bias);
        let (mass, feed) = (self.work.mass(), &self.feed);
        let command = |j: usize| {
            if self.case.nominal.description.servo(j).is_some() {
                // The loop of the drive leads it.
                return q[j];
            }
            let limits = &self.limits[j];
            let mut torque = self.bias[j] + feed.get(Constant::Rotor(j)) * reference[j].2;
            for (i, r) in reference.iter().enumerate() {
                let (row, column) = (i.max(j), i.min(j));
                torque += mass[row * (row + 1) / 2 + column] * r.2;
            }
            torque += feed.get(Constant::Viscous(j)) * v[j]
                + feed.get(Constant::Coulomb(j)) * (v[j] / (0.02 * limits.speed)).tanh();
            // A stiff loop of 5 Hz, well damped.
            let (w, inertia) = (TAU * 5.0, self.case.scale[j].inertia);
            let (at, rate) = state.map_or((q[j], v[j]), |s| (s.drive_q[j], s.drive_v[j]));
            torque += inertia * (w * w * (q[j] - at) + 1.6 * w * (v[j] - rate));
            let most = limits.torque / SAFE;
            torque.clamp(-most, most) / feed.get(Constant::Gain(j))
        };
        (0..reference.len()).map(command).collect()
    }
}

/// Runs the motion in closed loop on the robot as a fit describes it, with the readings of its
/// sensors; `None` if it diverges.
fn run(case: &Case, fit: &Fit, waves: &[Wave], limits: &[Limits]) -> Option<Record> {
    let n = case.n();
    let h = case.records[0].h;
    let samples = (LENGTH / h) as usize;
    let constants = Constants::<f64>::new(&case.nominal, &fit.point.theta);
    let mut controller = Controller {
        case,
        limits,
        work: constants.prepared(),
        feed: constants.clone(),
        bias: vec![0.0; n],
    };
    let mut machine =
        Machine::<f64>::beside(&case.known, constants, &fit.hypothesis, fit.point.e.clone());
    let geared = machine.gears.iter().any(Option::is_some);
    let steps = Substeps::of(&case.nominal, h, geared, 1);
    let dt = h / steps.number() as f64;
    let mut u = vec![vec![0.0; samples]; n];
    let mut state = None;
    for k in 0..samples {
        let reference: Reference = waves.iter().map(|w| w.at(k as f64 * h)).collect();
        let command = controller.inputs(&reference, state.as_ref());
        for (u, x) in u.iter_mut().zip(&command) {
            u[k] = *x;
        }
        let s = state.get_or_insert_with(|| {
            let q: Vec<f64> = reference.iter().map(|r| r.0).collect();
            let v: Vec<f64> = reference.iter().map(|r| r.1).collect();
            machine.rest(&q, &v, &command)
        });
        for i in 0..steps.number() {
            let commands: Vec<Commands<'_>> = (0..n)
                .map(|j| Commands {
                    u: &u[j][..=k],
                    h,
                    linear: false,
                    begin: 0.0,
                    t: k as f64 * h + i as f64 * dt,
                    dt,
                })
                .collect();
            machine.step(s, &commands, steps.links(h, i));
        }
        if s.q.iter().chain(&s.v).any(|x| x.is_nan() || x.abs() > 1e6) {
            return None;
        }
    }
    let first: Vec<f64> = waves.iter().map(|w| w.at(0.0).0).collect();
    recorded(case, fit, u, &first)
}

/// What the sensors of the robot read while it answers to inputs from rest at `first`; `None` if it
/// diverges.
fn recorded(case: &Case, fit: &Fit, u: Vec<Vec<f64>>, first: &[f64]) -> Option<Record> {
    let (n, h, samples) = (case.n(), case.records[0].h, u[0].len());
    let constant = |x: &[f64]| x.iter().map(|&x| vec![x; samples]).collect::<Vec<_>>();
    let still = vec![0.0; n];
    let mut record = Record {
        name: "next".to_owned(),
        role: Role::Train,
        h,
        uneven: false,
        begin: 0.0,
        q: constant(first),
        v: constant(&still),
        u,
        smooth_q: constant(first),
        smooth_v: constant(&still),
        first_v: still.clone(),
        gain_factors: GainFactors::default(),
        whole: None,
    };
    let plain = record.clone();
    let mut runner = Runner::<f64>::new(
        case,
        &plain,
        &fit.hypothesis,
        &fit.point.theta,
        &fit.point.e,
    );
    let start = runner.start(0);
    let fade: Vec<f64> = (0..n)
        .map(|j| runner.velocity_fade(j).unwrap_or(0.0))
        .collect();
    let mut shown = vec![0.0; n];
    runner.free(&start, 0, samples - 1, &mut |k, j, q, v| {
        shown[j] = fade[j] * shown[j] + (1.0 - fade[j]) * v;
        record.q[j][k] = q;
        record.v[j][k] = shown[j];
        record.smooth_q[j][k] = q;
        record.smooth_v[j][k] = v;
    });
    let finite = record.q.iter().flatten().all(|x| x.is_finite());
    finite.then_some(record)
}

/// The case with one record in place of its own.
fn alone(case: &Case, record: Record) -> Case {
    Case {
        records: vec![record],
        ..case.clone()
    }
}

/// ½ |ε|² of a fit on one record.
fn misfit(case: &Case, fit: &Fit) -> f64 {
    let gains = all_gains(case, &fit.hypothesis, &fit.point);
    0.5 * value(case, &fit.hypothesis, &fit.point, &gains, Role::Train).total()
}

/// Λ of a fit on one record that another rival made.
fn after_refit(case: &Case, fit: &Fit) -> Option<f64> {
    let size = case.nominal.size();
    let unit = nalgebra::DMatrix::<f64>::identity(size, size);
    let mut directions: Vec<Direction<'_>> = (0..size)
        .map(|i| Direction::Theta(&unit.as_slice()[i * size..(i + 1) * size]))
        .collect();
    directions.extend((0..fit.point.e.len()).map(Direction::Effect));
    let gains = all_gains(case, &fit.hypothesis, &fit.point);
    let lin = linearise(
        case,
        &fit.hypothesis,
        &fit.point,
        &gains,
        Role::Train,
        &directions,
    );
    if fit.quadratic.h.nrows() != directions.len() {
        return None;
    }
    let mut h = &fit.quadratic.h + gram(&lin.j);
    for i in 0..h.nrows() {
        if h[(i, i)] <= 0.0 {
            h[(i, i)] = 1.0;
        }
        h[(i, i)] *= 1.0 + 1e-9;
    }
    let g = lin.j.tr_mul(&lin.r);
    let won = g.dot(&h.cholesky()?.solve(&g));
    Some(0.5 * (lin.r.norm_squared() - won).max(0.0))
}

/// Both directions of a measure: rival B on A's motion and A on B's.
fn both(
    case: &Case,
    (a, b): (&Fit, &Fit),
    waves: &[Wave],
    limits: &[Limits],
    measure: &dyn Fn(&Case, &Fit) -> Option<f64>,
) -> Option<(f64, f64)> {
    let first = measure(&alone(case, run(case, a, waves, limits)?), b)?;
    let second = measure(&alone(case, run(case, b, waves, limits)?), a)?;
    Some((first.min(ENOUGH), second.min(ENOUGH)))
}

/// Finds the motion that separates two fits of a case; `None` where no motion can be run on both.
pub fn separate(case: &Case, a: &Fit, b: &Fit) -> Option<Experiment> {
    let limits = limits(case);
    // The records play no part, and copying them with every motion would be waste.
    let bare = alone(case, case.records.first()?.clone());
    let least = |x: (f64, f64)| x.0.min(x.1);
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let drawn: Vec<Vec<Wave>> = (0..DRAWN.0)
        .map(|i| draw(case, &limits, i % 3 == 0, &mut random))
        .collect();
    let mut ranked: Vec<(Vec<Wave>, f64)> = drawn
        .into_par_iter()
        .filter_map(|w| {
            let x = both(&bare, (a, b), &w, &limits, &|c, f| Some(misfit(c, f)))?;
            Some((w, least(x)))
        })
        .collect();
    ranked.sort_by(|x, y| y.1.total_cmp(&x.1));
    ranked.truncate(DRAWN.1);
    let judged: Vec<(Vec<Wave>, (f64, f64))> = ranked
        .into_par_iter()
        .filter_map(|(w, _)| {
            let x = both(&bare, (a, b), &w, &limits, &after_refit)?;
            Some((w, x))
        })
        .collect();
    let (mut best, mut odds) = judged
        .into_iter()
        .max_by(|x, y| least(x.1).total_cmp(&least(y.1)))?;
    for _ in 0..CHANGES / DRAWN.1 {
        if least(odds) >= ENOUGH {
            break;
        }
        let tries: Vec<Vec<Wave>> = (0..DRAWN.1)
            .map(|_| changed(case, &limits, &best, &mut random))
            .collect();
        let found = tries
            .into_par_iter()
            .filter_map(|w| {
                let x = both(&bare, (a, b), &w, &limits, &after_refit)?;
                Some((w, x))
            })
            .collect::<Vec<_>>();
        for (w, x) in found {
            if least(x) > least(odds) {
                (best, odds) = (w, x);
            }
        }
    }
    let h = case.records[0].h;
    let rows: Vec<Vec<(f64, f64, f64)>> = (0..(LENGTH / h) as usize)
        .map(|k| best.iter().map(|w| w.at(k as f64 * h)).collect())
        .collect();
    Some(Experiment {
        rivals: (label(a), label(b)),
        log_odds: odds,
        limits,
        sample_time: h,
        q: rows
            .iter()
            .map(|r| r.iter().map(|x| x.0).collect())
            .collect(),
        v: rows
            .iter()
            .map(|r| r.iter().map(|x| x.1).collect())
            .collect(),
    })
}

fn label(fit: &Fit) -> String {
    if fit.hypothesis.terms.is_empty() {
        return "none".to_owned();
    }
    let terms: Vec<String> = fit.hypothesis.terms.iter().map(|t| t.label()).collect();
    terms.join(" + ")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Between the points of any grid, and where the window jumps, on motions as they are drawn.
    #[test]
    fn limits_hold_at_all_times_and_are_used() {
        let limits = Limits {
            position: (-0.4, 1.0),
            speed: 2.0,
            torque: 1.0,
        };
        let mut random = ChaCha8Rng::seed_from_u64(4);
        for _ in 0..20 {
            let sines = (0..SINES)
                .map(|_| {
                    let phase = random.random_range(0.0..TAU);
                    (
                        random.random_range(0.2..1.0),
                        random.random_range(0.1..3.0),
                        phase,
                    )
                })
                .collect();
            let wave = Wave { middle: 0.3, sines }.within(&limits, 9.0);
            let mut used: f64 = 0.0;
            for k in 0..400_000 {
                let (q, v, a) = wave.at(LENGTH * (f64::from(k) + 0.37) / 4e5);
                used = used.max((q - 0.3).abs() / 0.7).max(v.abs() / 2.0);
                used = used.max(a.abs() / 9.0);
            }
            assert!((0.95..=1.0).contains(&used), "{used}");
        }
    }
}
