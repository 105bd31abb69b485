//! What a fit leaves: are its innovations noise?
//!
//! Noise is spread evenly in time and over frequencies; a cause that was taken for noise, because
//! the level of the noise was not stated, is not. Two figures are taken from the whitened
//! innovations ε of every record, joint and channel, of all roles:
//!
//! ```text
//! burst = max over windows of 40 ms of mean ε² / mean of ε² over the record
//! line  = max over frequencies up to 60 Hz of |Σ ε_k exp(−iωkh)|² / (N mean of ε²)
//! ```
//!
//! A third one tells a hum from noise that is coloured: the same line over its neighbourhood, whose
//! mean is that of exponential numbers with the median of the [`NEAR`] lines on either side.
//!
//! For white noise a line exceeds z with probability e^(−z) per frequency (R. A. Fisher, Proc. R.
//! Soc. A 125, 1929), and the sum of m squares in a window is chi-squared with m degrees of
//! freedom.

use rayon::prelude::*;

use crate::case::Case;
use crate::diagnosis::{Extent, Residue};
use crate::fit::Fit;

/// Length of a window, s.
const WINDOW: f64 = 0.04;
/// Fewest samples of a window.
const FEWEST: usize = 10;
/// Correlations of neighbours, up to so many samples apart.
pub(super) const LAGS: usize = 10;
/// Highest frequency, Hz.
const HIGHEST: f64 = 60.0;
/// Lines on either side that a hum is compared with: their median scatters by a quarter.
const NEAR: usize = 15;

/// Innovations of one joint and channel of a record.
fn series(case: &Case, fit: &Fit) -> Vec<(usize, bool, f64, Vec<Vec<f64>>)> {
    case.records
        .par_iter()
        .zip(&fit.gains)
        .enumerate()
        .map(|(i, (record, gains))| {
            let mut all = vec![Vec::with_capacity(record.len()); 2 * case.n()];
            fit.runner(case, record).predict(
                gains,
                &mut |_, j, c, x| all[2 * j + c].push(if x.is_finite() { x } else { 0.0 }),
                &mut |_, _| {},
            );
            let train = record.role == pid_data::Role::Train;
            (i, train, record.h, all)
        })
        .collect()
}

/// Takes the figures at a fit.
pub(super) fn residue(case: &Case, fit: &Fit) -> Residue {
    let series = series(case, fit);
    let mut out = Residue::default();
    for channel in 0..2 * case.n() {
        let (mut lines, mut hums) = (Vec::new(), Vec::new());
        let (mut memories, mut correlations) = (Vec::new(), Vec::new());
        let mut level = [(0.0, 0.0); 2];
        for (_, train, h, all) in &series {
            let x = &all[channel];
            let square: f64 = x.iter().map(|x| x * x).sum();
            if x.len() < 10 * FEWEST || square <= 0.0 {
                continue;
            }
            let mean = square / x.len() as f64;
            level[usize::from(*train)].0 += square;
            level[usize::from(*train)].1 += x.len() as f64;
            out.burst = out.burst.max(burst(x, *h, mean));
            let spectrum = spectrum(x, *h, mean);
            lines.push(line(&spectrum));
            hums.push(hum(&spectrum));
            out.of = extended(out.of, x.len(), *h);
            let memory = memory(x, square);
            memories.push(memory);
            correlations.push((memory / x.len() as f64).sqrt());
        }
        out.line = out.line.max(median(&mut lines));
        out.hum = out.hum.max(median(&mut hums));
        out.memory = out.memory.max(median(&mut memories));
        out.correlation = out.correlation.max(median(&mut correlations));
        let [test, train] = level.map(|(s, n)| if n > 0.0 { s / n } else { 0.0 });
        if train > 0.0 {
            out.unseen = out.unseen.max(test / train);
        }
    }
    out
}

/// With a series of n samples.
fn extended(of: Extent, n: usize, h: f64) -> Extent {
    let samples = window(h);
    Extent {
        frequencies: of.frequencies.max(frequencies(n, h) as f64),
        windows: of.windows.max((n / samples) as f64),
        samples: if of.samples > 0.0 {
            of.samples.min(samples as f64)
        } else {
            samples as f64
        },
    }
}

/// Samples of a window.
fn window(h: f64) -> usize {
    ((WINDOW / h) as usize).max(FEWEST)
}

fn burst(x: &[f64], h: f64, mean: f64) -> f64 {
    let m = window(h);
    x.chunks_exact(m)
        .map(|w| w.iter().map(|x| x * x).sum::<f64>() / m as f64 / mean)
        .fold(0.0, f64::max)
}

/// Number of frequencies of a series of n samples that are looked at, from 1/(n h) on.
fn frequencies(n: usize, h: f64) -> usize {
    let step = 1.0 / (n as f64 * h);
    ((HIGHEST.min(0.4 / h) / step) as usize).saturating_sub(1)
}

/// Lines of the spectrum over their mean, from the lowest frequency on.
fn spectrum(x: &[f64], h: f64, mean: f64) -> Vec<f64> {
    let n = x.len();
    (1..=frequencies(n, h))
        .map(|i| {
            // G. Goertzel, Amer. Math. Monthly 65, 1958.
            let w = std::f64::consts::TAU * i as f64 / n as f64;
            let c = 2.0 * w.cos();
            let (mut a, mut b) = (0.0, 0.0);
            for x in x {
                let s = x + c * a - b;
                (b, a) = (a, s);
            }
            (a * a + b * b - c * a * b) / (n as f64 * mean)
        })
        .collect()
}

/// The largest line.
fn line(spectrum: &[f64]) -> f64 {
    spectrum.iter().copied().fold(0.0, f64::max)
}

/// The largest line over its neighbourhood.
fn hum(spectrum: &[f64]) -> f64 {
    let last = spectrum.len();
    let over = |(i, line): (usize, &f64)| {
        let near = i.saturating_sub(NEAR)..(i + NEAR + 1).min(last);
        let mean = median(&mut spectrum[near].to_vec()) / std::f64::consts::LN_2;
        line / mean.max(f64::MIN_POSITIVE)
    };
    spectrum.iter().enumerate().map(over).fold(0.0, f64::max)
}

fn memory(x: &[f64], square: f64) -> f64 {
    (1..=LAGS)
        .map(|l| {
            let r: f64 = x.iter().zip(&x[l..]).map(|(a, b)| a * b).sum::<f64>() / square;
            r * r
        })
        .sum::<f64>()
        * x.len() as f64
        / LAGS as f64
}

fn median(x: &mut [f64]) -> f64 {
    x.sort_by(f64::total_cmp);
    x.get(x.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::{LAGS, burst, frequencies, hum, line, memory, spectrum, window};
    use crate::criteria::Criteria;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    fn noise(n: usize) -> Vec<f64> {
        let random = ChaCha8Rng::seed_from_u64(7);
        random.sample_iter(StandardNormal).take(n).collect()
    }

    #[test]
    fn white_noise_has_no_lines_bursts_or_memory() {
        let x = noise(4000);
        let square: f64 = x.iter().map(|x| x * x).sum();
        let lines = spectrum(&x, 1e-3, square / 4000.0);
        assert!(line(&lines) < 14.0 && hum(&lines) < 24.0);
        assert!(burst(&x, 1e-3, square / 4000.0) < 2.5);
        let m = memory(&x, square);
        assert!((0.2..2.5).contains(&m), "{m}");
    }

    #[test]
    fn a_hum_is_a_line_of_a_quarter_of_its_square_times_the_samples() {
        // A²/4 N over the mean square 1 + A²/2, A = 0.2.
        let x: Vec<f64> = noise(4000)
            .iter()
            .enumerate()
            .map(|(i, x)| x + 0.2 * (std::f64::consts::TAU * 7.0 * i as f64 / 1000.0).sin())
            .collect();
        let square: f64 = x.iter().map(|x| x * x).sum();
        let lines = spectrum(&x, 1e-3, square / 4000.0);
        assert!(hum(&lines) > 0.5 * line(&lines));
        let seen = line(&lines);
        assert!((25.0..60.0).contains(&seen), "{seen}");
    }

    #[test]
    fn coloured_noise_has_lines_but_no_hum() {
        // First-order noise: its lowest lines are 65 times the mean of all, and alike.
        let mut last = 0.0;
        let x: Vec<f64> = noise(8000)
            .iter()
            .map(|w| {
                last = 0.97 * last + w;
                last
            })
            .collect();
        let square: f64 = x.iter().map(|x| x * x).sum();
        let lines = spectrum(&x, 2e-3, square / 8000.0);
        assert!(line(&lines) > 100.0, "{}", line(&lines));
        assert!(hum(&lines) < 24.0, "{}", hum(&lines));
    }

    #[test]
    fn a_burst_of_three_deviations_shows() {
        let mut x = noise(4000);
        for x in &mut x[2000..2040] {
            *x *= 3.0;
        }
        let square: f64 = x.iter().map(|x| x * x).sum();
        assert!(burst(&x, 1e-3, square / 4000.0) > 5.0);
    }

    /// Share of series of n samples of white noise with a property; fixed seed.
    fn share_of(series: usize, n: usize, property: impl Fn(&[f64]) -> bool) -> f64 {
        let mut random = ChaCha8Rng::seed_from_u64(0x1e57);
        let hits = (0..series).filter(|_| {
            let x: Vec<f64> = (0..n).map(|_| random.sample(StandardNormal)).collect();
            property(&x)
        });
        hits.count() as f64 / series as f64
    }

    /// Whether a share of `series` independent ones is that of a probability, within four standard
    /// deviations.
    fn agrees(share: f64, probability: f64, series: usize) -> bool {
        let std = (probability * (1.0 - probability) / series as f64).sqrt();
        (share - probability).abs() < 4.0 * std
    }

    fn squares(x: &[f64]) -> f64 {
        x.iter().map(|x| x * x).sum()
    }

    /// The quantiles of [`Criteria`] are those of simulated white noise, at a probability that 2000
    /// series can tell.
    #[test]
    fn null_distribution_of_lines_and_memory() {
        let (many, h) = (2000, 2e-3);
        let often = Criteria {
            rare: 0.05,
            ..Criteria::default()
        };
        let limit = often.line(frequencies(500, h) as f64);
        let lines = share_of(many, 500, |x| {
            line(&spectrum(x, h, squares(x) / 500.0)) > limit
        });
        assert!(agrees(lines, 0.05, many), "{lines}");
        let limit = often.memory(LAGS as f64);
        let memories = share_of(many, 500, |x| memory(x, squares(x)) > limit);
        assert!(agrees(memories, 0.05, many), "{memories}");
    }

    /// The windows of a record are divided by its own mean square: a little less than independent
    /// chi-squared numbers.
    #[test]
    fn null_distribution_of_bursts() {
        let (many, n, h) = (3000, 3500, 2e-3);
        let often = Criteria {
            rare: 0.05,
            ..Criteria::default()
        };
        let limit = often.burst(window(h) as f64, (n / window(h)) as f64);
        let bursts = share_of(many, n, |x| burst(x, h, squares(x) / n as f64) > limit);
        assert!((0.03..0.06).contains(&bursts), "{bursts}");
    }

    /// A size is the amplitude of least squares over its standard deviation.
    #[test]
    fn null_distribution_of_sizes() {
        let many = 20_000;
        let criteria = Criteria::default();
        let sine: Vec<f64> = (0..500).map(|k| (0.1 * k as f64).sin()).collect();
        let size = |x: &[f64]| {
            let product: f64 = x.iter().zip(&sine).map(|(a, b)| a * b).sum();
            product / squares(&sine).sqrt()
        };
        let beyond = |limit: f64| share_of(many, 500, |x| size(x).abs() > limit);
        let above = |limit: f64| share_of(many, 500, |x| size(x) > limit);
        let (rare, chance) = (criteria.rare, criteria.chance);
        assert!(agrees(beyond(criteria.size()), rare, many));
        assert!(agrees(beyond(criteria.second_size()), chance, many));
        assert!(agrees(above(criteria.decrease()), chance, many));
    }

    /// What the documentation of [`Criteria`] says of its quantiles for a record of 7 s at 500 Hz.
    #[test]
    fn null_distribution_in_figures() {
        let criteria = Criteria::default();
        let (n, h) = (3500, 2e-3);
        let near = |x: f64, stated: f64| (x - stated).abs() < 0.05;
        assert!(near(criteria.size(), 3.0) && near(criteria.second_size(), 1.96));
        assert!(near(criteria.decrease(), 1.64));
        assert!(near(criteria.line(frequencies(n, h) as f64), 12.0));
        assert!(near(criteria.memory(LAGS as f64), 2.7));
        let samples = window(h);
        assert_eq!((samples, n / samples), (20, 175));
        assert!(near(criteria.burst(20.0, 175.0), 2.9));
    }
}
