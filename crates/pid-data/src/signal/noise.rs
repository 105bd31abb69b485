//! Noise level of a channel, and a cut-off for it.

use super::Butterworth;

/// Standard deviation of white noise on one uniformly sampled channel, from its differences of fourth order.
///
/// ```text
/// σ² = Σ (Δ⁴ x_i)² / (70 (N − 4)),        Var Δ⁴ e = (1 + 16 + 36 + 16 + 1) σ²
/// ```
///
/// Motion that is smooth over five samples drops out. Other motion counts as noise, so the figure
/// is an upper bound for slowly sampled records. Coloured noise is underestimated. Samples
/// that are missing (NaN) drop out. NaN with fewer than five samples in a row.
pub fn noise_level(x: &[f64]) -> f64 {
    (mean(&fourth_differences(x)) / 70.0).sqrt()
}

/// As [`noise_level`], but single jumps (an input that switches, a stop) do not count. The largest
/// tenth of the squared differences is left out; the rest is divided by 0.623, the share of the
/// variance that normal noise then keeps. Where all but a tenth of the differences vanish, as in a
/// quantised channel at rest, all count.
pub fn noise_level_without_jumps(x: &[f64]) -> f64 {
    let mut differences = fourth_differences(x);
    let all = mean(&differences);
    let kept = (9 * differences.len()).div_ceil(10);
    differences.sort_by(f64::total_cmp);
    let most = mean(&differences[..kept]);
    let variance = if most > 1e-6 * all { most / 0.623 } else { all };
    (variance / 70.0).sqrt()
}

/// (Δ⁴ x_i)² where all five samples are there.
fn fourth_differences(x: &[f64]) -> Vec<f64> {
    x.windows(5)
        .map(|w| (w[0] - 4.0 * w[1] + 6.0 * w[2] - 4.0 * w[3] + w[4]).powi(2))
        .filter(|square| square.is_finite())
        .collect()
}

/// NaN of nothing.
fn mean(x: &[f64]) -> f64 {
    x.iter().sum::<f64>() / x.len() as f64
}

/// Lowest cut-off that is tried, as a share of the sampling rate.
const LOWEST: f64 = 0.005;
/// Highest cut-off that is tried: 80 % of half the rate.
const HIGHEST: f64 = 0.4;
/// Steps between them.
const STEPS: usize = 24;

/// A cut-off for one uniformly sampled channel: the lowest of a geometric ladder from 0.5 % to 40 %
/// of the sampling rate at which what the filter removes is no more than the noise,
///
/// ```text
/// rms(x − filtered x) ≤ 1.1 σ √(1 − 2 f_c / f_s),        σ from noise_level
/// ```
///
/// (the residual analysis of D. A. Winter, Biomechanics and Motor Control of Human Movement,
/// section 3.4.4, with σ from differences instead of a fitted line); fourth order, both ways. A
/// channel without noise keeps the highest.
pub fn choose_cutoff(x: &[f64], rate: f64) -> f64 {
    let sigma = noise_level(x);
    let ratio = (HIGHEST / LOWEST).powf(1.0 / STEPS as f64);
    let mut share = LOWEST;
    for _ in 0..STEPS {
        if let Ok(filter) = Butterworth::low_pass(4, share, 1.0) {
            let y = filter.both_ways(x);
            let sum: f64 = x.iter().zip(&y).map(|(x, y)| (x - y).powi(2)).sum();
            let rms = (sum / x.len() as f64).sqrt();
            if rms <= 1.1 * sigma * (1.0 - 2.0 * share).sqrt() {
                return share * rate;
            }
        }
        share *= ratio;
    }
    HIGHEST * rate
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    /// Normal noise of standard deviation 1, always the same.
    fn noise(n: usize) -> Vec<f64> {
        let random = ChaCha8Rng::seed_from_u64(12345);
        random.sample_iter(StandardNormal).take(n).collect()
    }

    fn motion(i: usize, n: usize) -> f64 {
        let s = i as f64 / n as f64;
        (6.0 * s).sin() + 0.5 * (40.0 * s).cos()
    }

    #[test]
    fn the_level_of_added_noise_is_found() {
        let n = 4000;
        for sigma in [1e-5, 1e-3, 1e-2] {
            let x: Vec<f64> = noise(n)
                .iter()
                .enumerate()
                .map(|(i, e)| motion(i, n) + sigma * e)
                .collect();
            let found = noise_level(&x);
            assert!((found / sigma - 1.0).abs() < 0.05, "{found} for {sigma}");
        }
        assert!(noise_level(&[1.0, 2.0]).is_nan());
    }

    #[test]
    fn readings_that_are_missing_hide_no_noise() {
        let n = 4000;
        let mut x: Vec<f64> = (noise(n).iter().enumerate())
            .map(|(i, e)| motion(i, n) + 1e-3 * e)
            .collect();
        for missing in x.iter_mut().step_by(97) {
            *missing = f64::NAN;
        }
        for found in [noise_level(&x), noise_level_without_jumps(&x)] {
            assert!((found / 1e-3 - 1.0).abs() < 0.1, "{found}");
        }
    }

    #[test]
    fn jumps_are_not_noise_and_quantisation_is_not_silence() {
        let n = 2000;
        let x: Vec<f64> = noise(n)
            .iter()
            .enumerate()
            .map(|(i, e)| 1e-3 * e + if (i / 100) % 2 == 0 { 1.0 } else { 0.0 })
            .collect();
        let found = noise_level_without_jumps(&x);
        assert!((found / 1e-3 - 1.0).abs() < 0.1, "{found}");
        // One step of 0.1 every 50 samples: most differences vanish.
        let x: Vec<f64> = (0..n).map(|i| 0.125 * (i / 50) as f64).collect();
        assert!(noise_level_without_jumps(&x) > 1e-3);
    }

    #[test]
    fn the_cut_off_follows_the_noise_and_keeps_the_motion() {
        let n = 4000;
        let cutoff = |sigma: f64| {
            let x: Vec<f64> = noise(n)
                .iter()
                .enumerate()
                .map(|(i, e)| motion(i, n) + sigma * e)
                .collect();
            let fc = choose_cutoff(&x, 1000.0);
            let y = Butterworth::low_pass(4, fc, 1000.0).unwrap().both_ways(&x);
            let inner = 100..n - 100;
            let error: f64 = inner
                .clone()
                .map(|i| (y[i] - motion(i, n)).powi(2))
                .sum::<f64>();
            (fc, (error / inner.len() as f64).sqrt())
        };
        let (low, error_noisy) = cutoff(1e-2);
        let (high, error_quiet) = cutoff(1e-6);
        assert!(low < high, "{low} {high}");
        assert!(error_noisy < 0.5 * 1e-2, "{error_noisy}");
        assert!(error_quiet < 1.0 * 1e-6, "{error_quiet}");
    }

    #[test]
    fn fast_motion_without_noise_is_not_cut() {
        // 7.16 Hz at 50 samples per second.
        let x: Vec<f64> = (0..300).map(|i| (0.9 * f64::from(i)).sin()).collect();
        let fc = choose_cutoff(&x, 50.0);
        assert!(fc > 9.0, "{fc}");
        let y = Butterworth::low_pass(4, fc, 50.0).unwrap().both_ways(&x);
        assert!(
            x[50..250]
                .iter()
                .zip(&y[50..250])
                .all(|(x, y)| (x - y).abs() < 0.06)
        );
    }
}
