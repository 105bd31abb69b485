//! Records with unequal steps, brought to equal ones.
//!
//! The predictor steps with one sample time. Readings are taken from the straight line between their neighbours; a held input is
//! averaged over each new step, which keeps its impulse,
//!
//! ```text
//! ū_k = 1/h ∫ u(t) dt  over  [t₀ + k h, t₀ + (k + 1) h]
//! ```

/// Largest deviation from equal steps, in steps, that is left alone.
const TOLERATED: f64 = 0.25;

/// Equal times with the mean step of `t`, if these stray from equal steps by more than a quarter of one.
pub fn needed(t: &[f64]) -> Option<Vec<f64>> {
    let (first, last) = (*t.first()?, *t.last()?);
    let n = t.len();
    let mut steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_by(f64::total_cmp);
    let median = *steps.get(steps.len() / 2)?;
    let strays = (0..n).any(|k| (t[k] - first - k as f64 * median).abs() > TOLERATED * median);
    // A pause in the record must not stretch the step: the median counts the samples.
    let count = (((last - first) / median).round() as usize).max(1);
    let h = (last - first) / count as f64;
    strays.then(|| (0..=count).map(|k| first + k as f64 * h).collect())
}

/// Readings at the times `at`, on straight lines; missing where a neighbour is missing.
pub fn readings(t: &[f64], x: &[f64], at: &[f64]) -> Vec<f64> {
    let mut i = 0;
    at.iter()
        .map(|&s| {
            while i + 2 < t.len() && t[i + 1] < s {
                i += 1;
            }
            let share = ((s - t[i]) / (t[i + 1] - t[i])).clamp(0.0, 1.0);
            match share {
                0.0 => x[i],
                1.0 => x[i + 1],
                _ => x[i] * (1.0 - share) + x[i + 1] * share,
            }
        })
        .collect()
}

/// Mean over each new step of an input that holds its value until the next sample.
pub fn held(t: &[f64], u: &[f64], at: &[f64]) -> Vec<f64> {
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
    fn a_line_stays_a_line_and_a_hole_a_hole() {
        let t = uneven();
        let mut x: Vec<f64> = t.iter().map(|t| 2.0 - 3.0 * t).collect();
        let at = needed(&t).expect("uneven");
        for (s, y) in at.iter().zip(readings(&t, &x, &at)) {
            assert!((y - (2.0 - 3.0 * s)).abs() < 1e-12);
        }
        x[50] = f64::NAN;
        let y = readings(&t, &x, &at);
        let missing = y.iter().filter(|y| y.is_nan()).count();
        assert!((1..=3).contains(&missing), "{missing}");
    }
}
