//! What a fit leaves: are its innovations noise?
//!
//! Noise is spread evenly in time and over frequencies; a cause that was taken for noise, because the level of the noise was not
//! stated, is not. Two figures are taken from the whitened innovations ε of every record, joint and channel, of all roles:
//!
//! ```text
//! burst = max over windows of 40 ms of mean ε² / mean of ε² over the record
//! line  = max over frequencies up to 60 Hz of |Σ ε_k exp(−iωkh)|² / (N mean of ε²)
//! ```
//!
//! For white noise a line exceeds z with probability e^(−z) per frequency (R. A. Fisher, Proc. R. Soc. A 125, 1929), and the sum
//! of m squares in a window is chi-squared with m degrees of freedom.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::case::Case;
use crate::fit::Fit;

/// Length of a window, s.
const WINDOW: f64 = 0.04;
/// Fewest samples of a window.
const FEWEST: usize = 10;
/// Highest frequency, Hz.
const HIGHEST: f64 = 60.0;

/// Figures of what is left; the largest over joints and channels of their median over records, and over records.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Residue {
    /// Largest mean square of a window over that of its record.
    pub burst: f64,
    /// Largest line of a spectrum over its mean, the median over the records.
    pub line: f64,
    /// Sum of squared correlations of neighbours up to ten samples apart, times the number of samples and over ten, the median
    /// over the records: 1 for white noise.
    pub memory: f64,
    /// Root mean square of these correlations.
    #[serde(default)]
    pub correlation: f64,
    /// Mean squared innovation on the test records over that on the train records.
    pub unseen: f64,
}

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
            let train = record.role == pid_runtime::data::Role::Train;
            (i, train, record.h, all)
        })
        .collect()
}

/// Takes the figures at a fit.
pub(super) fn residue(case: &Case, fit: &Fit) -> Residue {
    let series = series(case, fit);
    let mut out = Residue::default();
    for channel in 0..2 * case.n() {
        let (mut lines, mut memories, mut correlations) = (Vec::new(), Vec::new(), Vec::new());
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
            lines.push(line(x, *h, mean));
            let memory = memory(x, square);
            memories.push(memory);
            correlations.push((memory / x.len() as f64).sqrt());
        }
        out.line = out.line.max(median(&mut lines));
        out.memory = out.memory.max(median(&mut memories));
        out.correlation = out.correlation.max(median(&mut correlations));
        let [test, train] = level.map(|(s, n)| if n > 0.0 { s / n } else { 0.0 });
        if train > 0.0 {
            out.unseen = out.unseen.max(test / train);
        }
    }
    out
}

fn burst(x: &[f64], h: f64, mean: f64) -> f64 {
    let m = ((WINDOW / h) as usize).max(FEWEST);
    x.chunks_exact(m)
        .map(|w| w.iter().map(|x| x * x).sum::<f64>() / m as f64 / mean)
        .fold(0.0, f64::max)
}

fn line(x: &[f64], h: f64, mean: f64) -> f64 {
    let n = x.len();
    let step = 1.0 / (n as f64 * h);
    let many = ((HIGHEST.min(0.4 / h)) / step) as usize;
    (1..many)
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
        .fold(0.0, f64::max)
}

fn memory(x: &[f64], square: f64) -> f64 {
    let lags = 10;
    (1..=lags)
        .map(|l| {
            let r: f64 = x.iter().zip(&x[l..]).map(|(a, b)| a * b).sum::<f64>() / square;
            r * r
        })
        .sum::<f64>()
        * x.len() as f64
        / lags as f64
}

fn median(x: &mut [f64]) -> f64 {
    x.sort_by(f64::total_cmp);
    x.get(x.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::{burst, line, memory};
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
        assert!(line(&x, 1e-3, square / 4000.0) < 14.0);
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
        let seen = line(&x, 1e-3, square / 4000.0);
        assert!((25.0..60.0).contains(&seen), "{seen}");
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
}
