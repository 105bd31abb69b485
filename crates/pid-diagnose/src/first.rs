//! Velocities at the first sample of a record.
//!
//! A predictor starts from the first readings. Most records of experiments start at rest, and a derivative at an
//! end is the least certain one: a joint counts as moving only where the readings show it.

use nalgebra::{DMatrix, DVector};

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

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    use super::velocity;

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
}
