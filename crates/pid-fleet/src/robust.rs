//! Location and spread of values that are known to different precision, against outliers.
//!
//! `y_i = μ + b_i + e_i` with `b_i` of the spread τ between units and `e_i` of a known variance `v_i`. Both are
//! solutions of Huber's equations (proposal 2; P. J. Huber, Ann. Math. Statist. 35, 1964) for the values in their own
//! deviations `z_i = (y_i − μ)/√(τ² + v_i)`:
//!
//! ```text
//! Σ ψ(z_i)/√(τ² + v_i) = 0        Σ ψ(z_i)² = (n − 1) κ,     ψ(z) = max(−c, min(c, z)),  κ = E ψ² of a normal z
//! ```
//!
//! With ψ(z) = z these are those of R. C. Paule and J. Mandel, J. Res. NBS 87, 1982.

/// Where ψ is cut.
const CUT: f64 = 1.5;
/// Efficiency of the location on normal values at this cut, relative to the mean.
const EFFICIENCY: f64 = 0.964;
/// Halvings of the interval that holds the spread.
const HALVINGS: usize = 80;
/// Least variance: equal values that are said to be exact have one too.
const LEAST: f64 = 1e-200;
/// Passes of the location.
const PASSES: usize = 50;

/// What many values have in common.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Common {
    /// Location μ.
    pub mean: f64,
    /// Its standard deviation.
    pub deviation: f64,
    /// Spread τ between the values, beyond what their own deviations explain.
    pub spread: f64,
}

/// Location and spread of `values` whose own variances are `variances`; `None` of fewer than three values or of any
/// that is not finite.
pub fn common(values: &[f64], variances: &[f64]) -> Option<Common> {
    let finite = |x: &[f64]| x.iter().all(|x| x.is_finite());
    if values.len() < 3 || !finite(values) || !finite(variances) {
        return None;
    }
    let n = values.len() as f64;
    let target = (n - 1.0) * second_moment(CUT);
    let start = median(values);
    let excess = |square: f64| {
        let mean = location(values, variances, square, start);
        squares(values, variances, square, mean) - target
    };
    let spread_square = root(excess, scale(values, start));
    let mean = location(values, variances, spread_square, start);
    let precision: f64 = variances.iter().map(|v| 1.0 / (spread_square + v)).sum();
    Some(Common {
        mean,
        deviation: (EFFICIENCY * precision).sqrt().recip(),
        spread: spread_square.sqrt(),
    })
}

/// Variance that values about zero have beyond their own variances, in the same way.
pub fn excess(values: &[f64], variances: &[f64]) -> f64 {
    let target = values.len() as f64 * second_moment(CUT);
    let missing = |square: f64| squares(values, variances, square, 0.0) - target;
    match values.len() {
        0..3 => 0.0,
        _ => root(missing, scale(values, 0.0)),
    }
}

/// The zero of a falling function of a variance, 0 if it is not positive there; `size` is a typical square root.
fn root(f: impl Fn(f64) -> f64, size: f64) -> f64 {
    // A negative or undefined excess leaves nothing to explain.
    let explained = f(0.0) > 0.0;
    if !explained {
        return 0.0;
    }
    let (mut low, mut high) = (0.0, size * size);
    while f(high) > 0.0 && high.is_finite() {
        (low, high) = (high, 4.0 * high);
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        match f(middle) > 0.0 {
            true => low = middle,
            false => high = middle,
        }
    }
    0.5 * (low + high)
}

/// Location for a given spread: reweighted means from a start.
fn location(values: &[f64], variances: &[f64], square: f64, start: f64) -> f64 {
    let mut mean = start;
    for _ in 0..PASSES {
        let (mut sum, mut total) = (0.0, 0.0);
        for (y, v) in values.iter().zip(variances) {
            let variance = (square + v).max(LEAST);
            let z = (y - mean).abs() / variance.sqrt();
            let weight = (CUT / z).min(1.0) / variance;
            sum += weight * y;
            total += weight;
        }
        let next = sum / total;
        let moved = (next - mean).abs();
        mean = next;
        if moved <= 1e-14 * mean.abs() {
            break;
        }
    }
    mean
}

fn squares(values: &[f64], variances: &[f64], square: f64, mean: f64) -> f64 {
    let each = values.iter().zip(variances).map(|(y, v)| {
        let deviation = (square + v).max(LEAST).sqrt();
        ((y - mean) / deviation).clamp(-CUT, CUT).powi(2)
    });
    each.sum()
}

/// Median of distances from a place, at least a rounding of it.
fn scale(values: &[f64], from: f64) -> f64 {
    let distances: Vec<f64> = values.iter().map(|y| (y - from).abs()).collect();
    median(&distances).max(1e-12 * from.abs()).max(1e-300)
}

/// Median; 0 of nothing.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => 0.0,
        n if n % 2 == 1 => sorted[n / 2],
        n => 0.5 * (sorted[n / 2 - 1] + sorted[n / 2]),
    }
}

/// E ψ(z)² of a normal z.
fn second_moment(cut: f64) -> f64 {
    let density = (-0.5 * cut * cut).exp() / (2.0 * std::f64::consts::PI).sqrt();
    let beyond = 0.5 * libm::erfc(cut / 2.0_f64.sqrt());
    (1.0 - 2.0 * beyond) - 2.0 * cut * density + 2.0 * cut * cut * beyond
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    /// Values about 3 with the spread 0.2, deviations from 0.05 to 0.3, and a share far away.
    fn drawn(n: usize, outliers: usize, seed: u64) -> (Vec<f64>, Vec<f64>) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { random.sample(StandardNormal) };
        let (mut values, mut variances) = (Vec::new(), Vec::new());
        for i in 0..n {
            let own = 0.05 + 0.25 * (i % 6) as f64 / 5.0;
            let far = if i < outliers { 4.0 } else { 0.0 };
            values.push(3.0 + 0.2 * normal() + own * normal() + far);
            variances.push(own * own);
        }
        (values, variances)
    }

    #[test]
    fn mean_and_spread_are_those_of_the_hierarchy() {
        let (values, variances) = drawn(4000, 0, 1);
        let found = common(&values, &variances).expect("enough values");
        assert!((found.mean - 3.0).abs() < 0.015, "{found:?}");
        assert!((found.spread - 0.2).abs() < 0.012, "{found:?}");
        // The deviation of the location is that over many draws.
        let means: Vec<f64> = (0..300)
            .map(|seed| {
                let (values, variances) = drawn(60, 0, 100 + seed);
                let found = common(&values, &variances).expect("enough values");
                (found.mean - 3.0) / found.deviation
            })
            .collect();
        let square: f64 = means.iter().map(|z| z * z).sum::<f64>() / 300.0;
        assert!((0.8..1.25).contains(&square), "{square}");
    }

    #[test]
    fn five_per_cent_far_away_move_neither_much() {
        let (values, variances) = drawn(4000, 200, 2);
        let found = common(&values, &variances).expect("enough values");
        assert!((found.mean - 3.0).abs() < 0.04, "{found:?}");
        assert!((found.spread - 0.2).abs() < 0.06, "{found:?}");
    }

    #[test]
    fn no_spread_is_found_where_there_is_none() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let values: Vec<f64> = (0..2000)
            .map(|_| 0.1 * random.sample::<f64, _>(StandardNormal))
            .collect();
        let found = common(&values, &vec![0.01; 2000]).expect("enough values");
        assert!(found.spread < 0.025, "{found:?}");
        let beyond = excess(&values, &vec![0.0075; 2000]);
        assert!((beyond - 0.0025).abs() < 0.0012, "{beyond}");
    }

    #[test]
    fn two_values_or_none_have_nothing_in_common() {
        assert_eq!(common(&[1.0, 2.0], &[0.1, 0.1]), None);
        assert_eq!(common(&[1.0, 2.0, f64::NAN], &[0.1; 3]), None);
        let equal = common(&[2.0; 5], &[0.0; 5]).expect("equal values");
        assert!((equal.mean - 2.0).abs() < 1e-9 && equal.spread < 1e-9);
    }
}
