//! Records with unequal steps, brought to equal ones.
//!
//! The predictor steps with one sample time. A reading that was taken beside its time is moved
//! there along the motion around it,
//!
//! ```text
//! x(s) = x_i + f(s) − f(t_i),        f: parabola by least squares through the readings within three samples of t_i,
//! ```
//!
//! which keeps the noise of every reading as it is: straight lines between readings would smooth it
//! by half. A time without a reading within half a step has none: a lost row stays lost. A held
//! input is averaged over each new step, which keeps its impulse,
//!
//! ```text
//! ū_k = 1/h ∫ u(t) dt  over  [t₀ + k h, t₀ + (k + 1) h].
//! ```

/// Largest deviation from equal steps, in steps, that is left alone. A motion of v moves by 0.002 v
/// h meanwhile: half the quantum of a 16-bit encoder at one turn a second and 500 Hz.
const TOLERATED: f64 = 2e-3;
/// Readings on either side of one that its parabola takes in.
const AROUND: usize = 3;

/// Equal times with the mean step of `t`, if these stray from equal steps.
pub(crate) fn needed(t: &[f64]) -> Option<Vec<f64>> {
    let (first, last) = (*t.first()?, *t.last()?);
    let n = t.len();
    let steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
    let mut sorted = steps.clone();
    sorted.sort_by(f64::total_cmp);
    let median = *sorted.get(sorted.len() / 2)?;
    // A pause counts the rows that it lost, so that it does not stretch the step of the others. The
    // median alone would not do: where stamps are uneven it is not the mean, and over thousands of
    // rows their difference adds up to whole steps.
    let count: usize = (steps.iter())
        .map(|step| ((step / median).round() as usize).max(1))
        .sum();
    let h = (last - first) / count as f64;
    let strays = (0..n).any(|k| (t[k] - first - k as f64 * h).abs() > TOLERATED * h);
    strays.then(|| (0..=count).map(|k| first + k as f64 * h).collect())
}

/// Readings at the times `at`, each from the nearest one, moved along the motion; missing (NaN)
/// where that one is missing or more than half a step away.
pub(crate) fn readings(t: &[f64], x: &[f64], at: &[f64]) -> Vec<f64> {
    let half = 0.5 * (at[1] - at[0]);
    let mut i = 0;
    at.iter()
        .map(|&s| {
            while i + 1 < t.len() && (t[i + 1] - s).abs() <= (t[i] - s).abs() {
                i += 1;
            }
            if (t[i] - s).abs() > half * (1.0 + 1e-9) || !x[i].is_finite() {
                return f64::NAN;
            }
            x[i] + moved(t, x, i, s)
        })
        .collect()
}

/// f(s) − f(t_i) of the parabola around reading `i`; of a line, or nothing, where too few readings are near.
fn moved(t: &[f64], x: &[f64], i: usize, s: f64) -> f64 {
    let near = i.saturating_sub(AROUND)..(i + AROUND + 1).min(t.len());
    let step = (t[near.end - 1] - t[near.start]) / (near.len() - 1).max(1) as f64;
    // Sums of powers of the scaled distance from t_i; a pause in the record parts what is near from
    // what is not.
    let (mut power, mut moment) = ([0.0; 5], [0.0; 3]);
    for k in near.filter(|&k| x[k].is_finite()) {
        let d = (t[k] - t[i]) / step;
        if d.abs() > 2.0 * AROUND as f64 {
            continue;
        }
        let mut p = 1.0;
        for (n, sum) in power.iter_mut().enumerate() {
            *sum += p;
            if n < 3 {
                moment[n] += p * (x[k] - x[i]);
            }
            p *= d;
        }
    }
    let d = (s - t[i]) / step;
    let matrix = nalgebra::Matrix3::from_fn(|r, c| power[r + c]);
    let fit = (power[0] >= 5.0)
        .then(|| matrix.cholesky())
        .flatten()
        .map(|l| l.solve(&nalgebra::Vector3::from(moment)));
    fit.map_or(0.0, |f| f[1] * d + f[2] * d * d)
}

/// An input at the times `at` on straight lines between its samples.
pub(crate) fn lines(t: &[f64], u: &[f64], at: &[f64]) -> Vec<f64> {
    pid_data::signal::resample(t, u, at, pid_data::signal::Interpolation::Linear)
}

/// Mean over each new step of an input that holds its value until the next sample.
pub(crate) fn held(t: &[f64], u: &[f64], at: &[f64]) -> Vec<f64> {
    let end = at.len() - 1;
    let mut i = 0;
    (0..at.len())
        .map(|k| {
            if k == end {
                return u[u.len() - 1];
            }
            let (from, to) = (at[k], at[k + 1]);
            while i + 1 < t.len() && t[i + 1] <= from {
                i += 1;
            }
            let (mut sum, mut left, mut j) = (0.0, from, i);
            while left < to {
                let right = t.get(j + 1).map_or(to, |x| x.min(to));
                sum += u[j] * (right - left);
                left = right;
                j = (j + 1).min(t.len() - 1);
            }
            sum / (to - from)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn uneven() -> Vec<f64> {
        let mut t = vec![0.0];
        for k in 0..200 {
            t.push(t[k] + 0.01 * (1.0 + 0.3 * (1.7 * k as f64).sin() + 0.05));
        }
        t
    }

    #[test]
    fn equal_steps_are_left_alone() {
        let t: Vec<f64> = (0..100).map(|k| 0.5 + 0.001 * f64::from(k)).collect();
        assert!(needed(&t).is_none());
        assert!(needed(&uneven()).is_some());
    }

    #[test]
    fn the_impulse_of_an_input_is_kept() {
        let t = uneven();
        let u: Vec<f64> = (0..t.len()).map(|k| (0.31 * k as f64).sin()).collect();
        let at = needed(&t).expect("uneven");
        let mean = held(&t, &u, &at);
        let before: f64 = t.windows(2).zip(&u).map(|(w, u)| (w[1] - w[0]) * u).sum();
        let after: f64 = at
            .windows(2)
            .zip(&mean)
            .map(|(w, u)| (w[1] - w[0]) * u)
            .sum();
        assert!((before - after).abs() < 1e-12, "{before} {after}");
        assert_eq!(at.len(), mean.len());
    }

    #[test]
    fn a_parabola_stays_one() {
        let t = uneven();
        let f = |t: f64| 2.0 - 3.0 * t + 0.7 * t * t;
        let x: Vec<f64> = t.iter().map(|&t| f(t)).collect();
        let at = needed(&t).expect("uneven");
        let y = readings(&t, &x, &at);
        assert!(y.iter().filter(|y| y.is_finite()).count() > at.len() * 9 / 10);
        for (s, y) in at.iter().zip(y).filter(|(_, y)| y.is_finite()) {
            assert!((y - f(*s)).abs() < 1e-11, "{s}: {y}");
        }
    }

    #[test]
    fn a_lost_row_and_a_missing_reading_stay_missing() {
        let mut t: Vec<f64> = (0..200)
            .map(|k| 0.002 * (f64::from(k) + 0.1 * (1.3 * f64::from(k)).sin()))
            .collect();
        let mut x: Vec<f64> = t.iter().map(|t| (5.0 * t).sin()).collect();
        let truth = x.clone();
        x[50] = f64::NAN;
        t.remove(120);
        x.remove(120);
        let at = needed(&t).expect("uneven");
        let y = readings(&t, &x, &at);
        let missing: Vec<usize> = (0..y.len()).filter(|&k| y[k].is_nan()).collect();
        assert_eq!(missing, [50, 120]);
        assert_eq!(y.len(), truth.len());
    }

    #[test]
    fn moving_a_reading_keeps_its_noise() {
        // Readings late by up to 12 % of a step, with white noise of deviation 1 on a motion of 40 a step.
        use rand::{RngExt, SeedableRng};
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let t: Vec<f64> = (0..20_000)
            .map(|k| f64::from(k) + 0.05 + 0.07 * random.random::<f64>())
            .collect();
        let motion = |t: f64| 4e4 * (1e-3 * t).sin();
        let x: Vec<f64> = t
            .iter()
            .map(|&t| motion(t) + (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0)
            .collect();
        let at = needed(&t).expect("late");
        let e: Vec<f64> = at
            .iter()
            .zip(readings(&t, &x, &at))
            .filter(|(_, y)| y.is_finite())
            .map(|(s, y)| y - motion(*s))
            .collect();
        let n = e.len() as f64;
        let square = e.iter().map(|e| e * e).sum::<f64>() / n;
        let next = e.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / n / square;
        assert!((square - 1.0).abs() < 0.05, "{square}");
        assert!(next.abs() < 0.03, "{next}");
    }
}
