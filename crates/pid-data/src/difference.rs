//! Finds velocities that are differences of the positions beside them.

use std::fmt;

/// A velocity counts as made from the positions if it differs from a difference by at most 1e-3 of
/// its spread (root mean square).
const EQUAL: f64 = 1e-3;
/// It must also be 30 times closer to that difference than to every other one: a smooth motion
/// without noise is near all of them.
const ALONE: f64 = 1.0 / 30.0;
/// A joint with fewer samples is not judged.
const FEWEST: usize = 20;

/// How a velocity was made from positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Difference {
    /// `(q_k − q_{k−1}) / (t_k − t_{k−1})`: half a step late.
    Backward,
    /// `(q_{k+1} − q_k) / (t_{k+1} − t_k)`: half a step early.
    Forward,
    /// `(q_{k+1} − q_{k−1}) / (t_{k+1} − t_{k−1})`.
    Central,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Difference::Backward => "backward",
            Difference::Forward => "forward",
            Difference::Central => "central",
        })
    }
}

/// Names the difference of the positions that a velocity equals up to the rounding of the file.
/// Takes samples (t, q, v) of one joint, NaN where missing.
pub(super) fn made_by(samples: &[(f64, f64, f64)]) -> Option<Difference> {
    let known = samples.windows(5).filter_map(|w| {
        let [a, b, c, d, e] = [w[0], w[1], w[2], w[3], w[4]];
        let chord = |x: (f64, f64, f64), y: (f64, f64, f64)| (y.1 - x.1) / (y.0 - x.0);
        let central = chord(b, d);
        // A smooth motion's own slope to fourth order: no difference may pass for it.
        let smooth = (4.0 * central - chord(a, e)) / 3.0;
        let row = [chord(b, c), chord(c, d), central, smooth, c.2];
        row.iter().all(|x| x.is_finite()).then_some(row)
    });
    let known: Vec<[f64; 5]> = known.collect();
    if known.len() < FEWEST {
        return None;
    }
    let mean = |f: &dyn Fn(&[f64; 5]) -> f64| known.iter().map(f).sum::<f64>() / known.len() as f64;
    let centre = mean(&|row| row[4]);
    let spread = mean(&|row| (row[4] - centre).powi(2)).sqrt();
    let left = [0, 1, 2, 3].map(|i| mean(&|row| (row[i] - row[4]).powi(2)).sqrt());
    let kinds = [
        Difference::Backward,
        Difference::Forward,
        Difference::Central,
    ];
    kinds.into_iter().enumerate().find_map(|(i, kind)| {
        let others = (0..left.len()).filter(|k| *k != i);
        let next = others.fold(f64::INFINITY, |a, k| a.min(left[k]));
        (left[i] < EQUAL * spread && left[i] < ALONE * next).then_some(kind)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two tones at 1 kHz, positions as a file with seven digits after the point has them,
    /// velocities by a rule.
    fn samples(rule: impl Fn(&[f64], usize) -> f64) -> Vec<(f64, f64, f64)> {
        let h = 1e-3;
        let t = |k: usize| h * k as f64;
        let q: Vec<f64> = (0..500)
            .map(|k| (7.0 * t(k)).sin() + 0.3 * (31.0 * t(k)).cos())
            .map(|q| (1e7 * q).round() / 1e7)
            .collect();
        (1..499).map(|k| (t(k), q[k], rule(&q, k))).collect()
    }

    #[test]
    fn every_difference_is_told_by_its_name() {
        let back = |q: &[f64], k: usize| (q[k] - q[k - 1]) / 1e-3;
        let forth = |q: &[f64], k: usize| (q[k + 1] - q[k]) / 1e-3;
        assert_eq!(made_by(&samples(back)), Some(Difference::Backward));
        assert_eq!(made_by(&samples(forth)), Some(Difference::Forward));
        let central = samples(|q, k| 0.5 * (back(q, k) + forth(q, k)));
        assert_eq!(made_by(&central), Some(Difference::Central));
    }

    #[test]
    fn a_velocity_of_its_own_is_no_difference() {
        let own = |_: &[f64], k: usize| {
            let t = 1e-3 * k as f64;
            7.0 * (7.0 * t).cos() - 9.3 * (31.0 * t).sin()
        };
        assert_eq!(made_by(&samples(own)), None, "the motion's own");
        let late = |q: &[f64], k: usize| 0.5 * (q[k] - q[k.max(2) - 2]) / 1e-3;
        assert_eq!(made_by(&samples(late)), None, "over two steps");
        assert_eq!(made_by(&samples(|_, _| 0.0)), None, "at rest");
        assert_eq!(made_by(&samples(|_, _| f64::NAN)), None, "missing");
        let back = |q: &[f64], k: usize| (q[k] - q[k - 1]) / 1e-3;
        assert_eq!(made_by(&samples(back)[..20]), None, "too short");
    }
}
