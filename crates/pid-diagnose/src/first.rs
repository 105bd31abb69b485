//! Velocities at the first sample of a record.
//!
//! A predictor starts from the first readings. Most records of experiments start at rest, and a derivative at an
//! end is the least certain one: a joint counts as moving only where the readings show it.
//!
//! How fast it then moves, readings alone tell badly: what a drive lets go of takes up its play at once, and
//! the slope after that is not the velocity with which the motion goes on. The velocities v of the moving joints are
//! those whose free run stays nearest to the first positions,
//!
//! ```text
//! minimise over v    Σ_{t < T} Σ_j ((q_j(t; v) − q̂_j(t)) / s_j)²,      T a quarter of a window of free runs
//! ```
//!
//! with s the deviation of the readings of a joint, by steps of Gauss and Newton with differences.

use nalgebra::{DMatrix, DVector};
use pid_data::Role;
use rayon::prelude::*;

use crate::case::{Case, Record};
use crate::excerpt::beginning;
use crate::fit::{Effort, Fit, Point, basis, fit};
use crate::gap::deviations;
use crate::hypothesis::Hypothesis;
use crate::predict::Runner;

/// Time that is looked at, s: motion of arms is a cubic for as long.
const LENGTH: f64 = 0.1;
/// Fewest readings: twice those that a cubic and its scatter need.
const FEWEST: usize = 10;
/// Share of the largest speed of a record below which a joint starts from rest: what is pushed at the first sample
/// bends the cubic by more than 5 % of it in one practice case, all of which start at rest.
const SLOW: f64 = 0.1;
/// A slope of so many of its deviations is no chance: readings are rounded and their noise is coloured, so this
/// is more than a quantile of the normal distribution.
const CERTAIN: f64 = 5.0;

/// Velocity at the first sample: the slope there of a cubic through the first readings `q`, `h` apart, NaN where
/// missing; zero where that slope is not certain, or hardly one beside the `largest` speed of the record.
pub(crate) fn velocity(q: &[f64], h: f64, largest: f64) -> f64 {
    let number = ((LENGTH / h).round() as usize).max(FEWEST).min(q.len());
    let length = number as f64 * h;
    let known: Vec<(f64, f64)> = (0..number)
        .map(|k| (k as f64 * h / length, q[k]))
        .filter(|(_, q)| q.is_finite())
        .collect();
    if known.len() < FEWEST {
        return 0.0;
    }
    let x = DMatrix::from_fn(known.len(), 4, |i, power| known[i].0.powi(power as i32));
    let first = known[0].1;
    let y = DVector::from_iterator(known.len(), known.iter().map(|(_, q)| q - first));
    let Some(inverse) = x.tr_mul(&x).cholesky().map(|c| c.inverse()) else {
        return 0.0;
    };
    let c = &inverse * x.tr_mul(&y);
    let left = (y - &x * &c).norm_squared() / (known.len() - 4) as f64;
    let deviation = (left * inverse[(1, 1)]).sqrt();
    let certain = c[1].abs() > CERTAIN * deviation.max(f64::EPSILON * first.abs());
    let slope = c[1] / length;
    match certain && slope.abs() > SLOW * largest {
        true => slope,
        false => 0.0,
    }
}

/// Share of a window of free runs that decides: what a drive lets go of is over after a tenth of it, and what the
/// model lacks shows later.
const SHARE: f64 = 0.25;
/// Steps of the nominal structure's fit, and of the velocities; on the drops of a servo 14 and 6 give the same digits.
const STEPS: (usize, usize) = (4, 4);
/// Step of a difference, in largest speeds.
const DIFFERENCE: f64 = 0.01;

/// A case with the velocities at the start of records as the nominal structure has them once it is fitted to the
/// records of `short`, a part of the case; `None` where all records start at rest.
pub(crate) fn by_free_runs(case: &Case, short: &Case) -> Option<Case> {
    let moves = |r: &Record| r.first_v.iter().any(|v| *v != 0.0);
    if !case.records.iter().any(moves) || !short.records.iter().any(|r| r.role == Role::Train) {
        return None;
    }
    let at = Point {
        theta: vec![0.0; case.nominal.size()],
        e: Vec::new(),
    };
    let effort = Effort::on_the_way(STEPS.0);
    let nominal = fit(short, &basis(short), &Hypothesis::default(), at, effort);
    Some(under(case, case.clone(), Model::of(&nominal)))
}

/// A model by which velocities at the start are found.
#[derive(Clone, Copy)]
pub(crate) struct Model<'a> {
    pub(crate) hypothesis: &'a Hypothesis,
    pub(crate) theta: &'a [f64],
    pub(crate) e: &'a [f64],
}

impl<'a> Model<'a> {
    pub(crate) fn of(fit: &'a Fit) -> Self {
        Model {
            hypothesis: &fit.hypothesis,
            theta: &fit.point.theta,
            e: &fit.point.e,
        }
    }
}

/// A case with the velocities at the start of records as its description has them.
pub(crate) fn as_described(case: Case) -> Case {
    let theta = vec![0.0; case.nominal.size()];
    let model = Model {
        hypothesis: &Hypothesis::default(),
        theta: &theta,
        e: &[],
    };
    under(&case, case.clone(), model)
}

/// `own` with the velocities at the start of those records that begin in motion by the readings, as `read` has them,
/// and from their first sample on, under a model of `own`.
pub(crate) fn under(read: &Case, own: Case, model: Model<'_>) -> Case {
    let of = |record: &Record| {
        let mut whole = read.records.iter();
        let whole = whole.find(|r| r.name == record.name && r.begin == record.begin)?;
        let moves = whole.first_v.iter().any(|v| *v != 0.0);
        let record = Record {
            first_v: whole.first_v.clone(),
            ..record.clone()
        };
        moves.then(|| nearest(&own, &record, model))
    };
    let found: Vec<Option<Vec<f64>>> = own.records.par_iter().map(of).collect();
    let mut out = own;
    for (record, found) in out.records.iter_mut().zip(found) {
        if let Some(first_v) = found {
            record.first_v = first_v;
        }
    }
    out
}

/// Velocities at the start of a record, of the joints that move there.
fn nearest(case: &Case, record: &Record, at: Model<'_>) -> Vec<f64> {
    let length = case.nominal.horizon.map_or(LENGTH, |s| SHARE * s);
    let number = ((length / record.h).round() as usize).max(FEWEST);
    let mut short = beginning(record, number + 1);
    let last = short.len() - 1;
    let size = deviations(record, case.n());
    let moving: Vec<usize> = (0..case.n())
        .filter(|j| record.first_v[*j] != 0.0)
        .collect();
    let mut left = |v: &DVector<f64>| {
        for (j, v) in moving.iter().zip(v.iter()) {
            short.first_v[*j] = *v;
        }
        let mut runner = Runner::<f64>::new(case, &short, at.hypothesis, at.theta, at.e);
        let start = runner.start(0);
        let mut out = Vec::with_capacity(last * case.n());
        runner.free(&start, 0, last, &mut |i, j, q, _| {
            let e = (q - short.smooth_q[j][i]) / size[j].0;
            out.push(if e.is_finite() { e } else { 1e3 });
        });
        DVector::from_vec(out)
    };
    let mut v = DVector::from_iterator(moving.len(), moving.iter().map(|j| record.first_v[*j]));
    let mut e = left(&v);
    for _ in 0..STEPS.1 {
        let mut slopes = DMatrix::zeros(e.len(), moving.len());
        for (i, j) in moving.iter().enumerate() {
            let step = DIFFERENCE * case.scale[*j].speed;
            let mut moved = v.clone();
            moved[i] += step;
            slopes.set_column(i, &((left(&moved) - &e) / step));
        }
        let Some(factor) = slopes.tr_mul(&slopes).cholesky() else {
            break;
        };
        let trial = &v - factor.solve(&slopes.tr_mul(&e));
        let there = left(&trial);
        if there.norm_squared() >= e.norm_squared() {
            break;
        }
        (v, e) = (trial, there);
    }
    let mut out = record.first_v.clone();
    for (j, v) in moving.iter().zip(v.iter()) {
        out[*j] = *v;
    }
    out
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    use super::{Model, nearest, velocity};
    use crate::bench::{SIZE, pendulum};
    use crate::fit::{Effort, Point, basis, fit};
    use crate::hypothesis::Hypothesis;

    fn read(at: impl Fn(f64) -> f64, (h, noise): (f64, f64), seed: u64) -> Vec<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut noisy = |x: f64| x + noise * random.sample::<f64, _>(StandardNormal);
        (0..200).map(|k| noisy(at(k as f64 * h))).collect()
    }

    /// Sines of known slope, at rates from 50 Hz to 1 kHz.
    #[test]
    fn a_moving_joint_starts_with_its_velocity() {
        for h in [0.02, 0.01, 0.004, 0.001] {
            let swing = |t: f64| 0.7 + 0.5 * (4.0 * t + 0.4).sin();
            let found = velocity(&read(swing, (h, 1e-5), 1), h, 2.0);
            let truth = 2.0 * 0.4_f64.cos();
            assert!(
                (found / truth - 1.0).abs() < 0.02,
                "{h}: {found} for {truth}"
            );
        }
    }

    /// Noise alone, and a joint that a torque sets in motion from rest.
    #[test]
    fn a_joint_at_rest_has_none() {
        for seed in 0..200 {
            let still = read(|_| -1.3, (0.002, 1e-3), seed);
            assert_eq!(velocity(&still, 0.002, 0.0), 0.0, "{seed}");
            let pushed = read(|t| 3.0 * t * t - 2.0 * t * t * t, (0.002, 1e-4), seed);
            assert_eq!(velocity(&pushed, 0.002, 0.0), 0.0, "{seed}");
        }
        assert_eq!(
            velocity(&[0.5; 100], 0.01, 0.0),
            0.0,
            "an encoder that shows one number"
        );
    }

    #[test]
    fn missing_readings_are_passed_over() {
        let mut q = read(|t| 2.0 * t, (0.005, 1e-5), 3);
        for k in [0, 3, 4] {
            q[k] = f64::NAN;
        }
        assert!((velocity(&q, 0.005, 2.0) - 2.0).abs() < 0.01);
        assert_eq!(velocity(&[f64::NAN; 50], 0.005, 1.0), 0.0);
        assert_eq!(velocity(&q[..8], 0.005, 2.0), 0.0, "too few");
        assert_eq!(
            velocity(&q, 0.005, 50.0),
            0.0,
            "hardly a motion of this record"
        );
    }

    #[test]
    fn what_a_drive_lets_go_of_is_no_velocity() {
        let none = Hypothesis::default();
        let case = pendulum(&none, &[], 2.0, &|_| {});
        let nominal = Point {
            theta: vec![0.0; SIZE],
            e: Vec::new(),
        };
        let at = fit(&case, &basis(&case), &none, nominal, Effort::full(0));
        let mut record = case.records[0].clone();
        let all = [&mut record.smooth_q, &mut record.smooth_v, &mut record.q];
        for x in all.into_iter().chain([&mut record.v, &mut record.u]) {
            x[0].drain(..300);
        }
        let truth = record.smooth_v[0][0];
        record.first_v = vec![truth + 1.0];
        let found = nearest(&case, &record, Model::of(&at))[0];
        assert!((found - truth).abs() < 1e-3, "{found} for {truth}");
        // A play of 10 mrad is taken up within 20 ms.
        for k in 0..10 {
            record.smooth_q[0][k] -= 0.001 * (10 - k) as f64;
        }
        let slope = velocity(&record.smooth_q[0], record.h, 6.0);
        let found = nearest(&case, &record, Model::of(&at))[0];
        assert!((found - truth).abs() < 0.2, "{found} for {truth}");
        assert!((slope - truth).abs() > 0.4, "{slope} for {truth}");
    }
}
