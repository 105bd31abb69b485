//! When a signal acts: the misfit between two channels while one of them is shifted in time.
//!
//! Least squares over the shift τ, with columns whose sizes are free at every shift:
//!
//! ```text
//! left(τ)² = min_c  Σ_k (y_k − s(t_k − τ) − Σ_i c_i x_ik)² / Σ_k s(t_k)²
//! ```
//!
//! (G. C. Carter, Proceedings of the IEEE 75(2), 1987, on the coherent estimation of delays). All
//! channels pass the same symmetric window first. The deviation of the best shift is that of a
//! Gauss-Newton step there, its residuals counted by their own correlation.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use crate::levels::shared;

/// Width of the moving average, s. It runs twice over every channel.
const WINDOW: f64 = 0.02;
/// Shifts reach this far to either side, s, and at least [`SAMPLES`] samples.
const REACH: f64 = 0.1;
const SAMPLES: f64 = 5.0;
/// Shifts of a curve to either side.
const STEPS: i32 = 40;
/// Most samples of all records together.
const MOST: usize = 20_000;
/// Steps of the golden section about the best shift of the curve.
const GOLDEN: usize = 30;
/// A shift beyond this many deviations is no chance.
const SURE: f64 = 4.0;
/// A shift is worth a word if it takes away at least this share of the squares left.
const WORTH: f64 = 0.3;

/// A channel that varies by less than this share of its size stands still.
const STILL: f64 = 1e-9;

/// Channels of one record at equal times.
#[derive(Debug, Clone)]
pub struct Channels {
    /// Sample time, s.
    pub h: f64,
    /// The fixed channel y. Samples that are not numbers do not count, nor do those within a window
    /// of them.
    pub still: Vec<f64>,
    /// The shifted channel s.
    pub shifted: Vec<f64>,
    /// Columns of free size, x.
    pub beside: Vec<Vec<f64>>,
}

/// Shift of one channel against others.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Alignment {
    /// The shift with the least misfit, s; positive where the signal acts or shows late.
    pub delay: f64,
    /// Its standard deviation, s; `None` where the motion does not determine it, or where the best
    /// shift is the largest that was tried.
    pub std: Option<f64>,
    /// The shift that the description states, s.
    pub stated: f64,
    /// Root mean square misfit at the stated shift, relative to the size of the channel.
    pub left: f64,
    /// Share of the squared misfit at the stated shift that the best one takes away.
    pub gain: f64,
    /// What a first-order lag does in place of the shift.
    #[serde(skip)]
    pub lag: Option<Lag>,
    /// Shifts, s, and the misfit at each, relative to the size of the channel.
    #[serde(skip)]
    pub curve: Vec<(f64, f64)>,
    /// Sizes of the columns at the best shift.
    #[serde(skip)]
    pub columns: Vec<f64>,
}

/// The first-order lag of a channel with the least misfit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lag {
    /// Its time constant, s.
    pub time_constant: f64,
    /// Twice the logarithm of the likelihood of the shift over that of the lag: negative where the
    /// lag describes the channel better.
    pub for_shift: f64,
}

impl Alignment {
    /// Whether the signal shows later than stated beyond chance, however little that is.
    pub fn late(&self) -> bool {
        self.later_than(self.stated)
    }

    /// Whether the signal shows later than after a `delay` (s) beyond chance.
    pub fn later_than(&self, delay: f64) -> bool {
        self.std.is_some_and(|s| self.delay - delay > SURE * s)
    }

    /// Whether the shift differs from the stated one beyond chance and by enough to matter.
    pub fn noticeable(&self) -> bool {
        self.std
            .is_some_and(|s| (self.delay - self.stated).abs() > SURE * s && self.gain > WORTH)
    }
}

/// A moving average of an odd number of samples, run twice; near the ends it takes the samples
/// there are.
fn averaged(x: &[f64], width: usize) -> Vec<f64> {
    let once = |x: &[f64]| -> Vec<f64> {
        let half = width / 2;
        (0..x.len())
            .map(|k| {
                let reach = half.min(k).min(x.len() - 1 - k);
                let part = &x[k - reach..=k + reach];
                part.iter().sum::<f64>() / part.len() as f64
            })
            .collect()
    };
    once(&once(x))
}

/// Data by which a shift is judged.
struct Problem {
    records: Vec<(Channels, Vec<usize>)>,
    still: DVector<f64>,
    columns: DMatrix<f64>,
    /// Orthonormal columns of the same span.
    basis: DMatrix<f64>,
    size: f64,
}

impl Problem {
    fn new(records: Vec<Channels>, reach: f64) -> Option<Self> {
        let total: usize = records.iter().map(|r| r.still.len()).sum();
        let every = total.div_ceil(MOST).max(1);
        let records: Vec<(Channels, Vec<usize>)> = records
            .into_iter()
            .map(|r| {
                let width = 2 * ((0.5 * WINDOW / r.h).round() as usize) + 1;
                let own = |x: &Vec<f64>| averaged(x, width);
                let margin = (reach / r.h).ceil() as usize + width;
                let last = r.still.len().saturating_sub(margin);
                let r = Channels {
                    h: r.h,
                    still: own(&r.still),
                    shifted: own(&r.shifted),
                    beside: r.beside.iter().map(own).collect(),
                };
                let known = |k: &usize| r.still[*k].is_finite();
                let at = (margin..last).step_by(every).filter(known).collect();
                (r, at)
            })
            .collect();
        let gather = |f: &dyn Fn(&Channels, usize) -> f64| -> Vec<f64> {
            records
                .iter()
                .flat_map(|(r, at)| at.iter().map(|&k| f(r, k)))
                .collect()
        };
        let still = DVector::from_vec(gather(&|r, k| r.still[k]));
        let number = records.first()?.0.beside.len();
        if still.len() < 10 * (number + 2) {
            return None;
        }
        let columns = (0..number).flat_map(|i| gather(&|r, k| r.beside[i][k]));
        let columns = DMatrix::from_iterator(still.len(), number, columns);
        let basis = orthonormal(&columns);
        let own = gather(&|r, k| r.shifted[k]);
        let mean = own.iter().sum::<f64>() / own.len() as f64;
        let size = own.iter().map(|x| (x - mean).powi(2)).sum::<f64>().sqrt();
        let whole = own.iter().map(|x| x * x).sum::<f64>().sqrt();
        (size > STILL * whole).then_some(Problem {
            records,
            still,
            columns,
            basis,
            size,
        })
    }

    /// s(t − τ), straight between samples.
    fn shifted(&self, tau: f64) -> DVector<f64> {
        let all = self.records.iter().flat_map(|(r, at)| {
            at.iter().map(move |&k| {
                let x = k as f64 - tau / r.h;
                let i = x.floor();
                let part = x - i;
                let s = &r.shifted;
                (1.0 - part) * s[i as usize] + part * s[(i as usize + 1).min(s.len() - 1)]
            })
        });
        DVector::from_iterator(self.still.len(), all)
    }

    /// s after a first-order lag, exact for a channel that is constant between samples.
    fn lagged(&self, time_constant: f64) -> DVector<f64> {
        let all = self.records.iter().flat_map(|(r, at)| {
            let fade = (-r.h / time_constant).exp();
            let mut x = r.shifted.first().copied().unwrap_or(0.0);
            let mut late = Vec::with_capacity(r.shifted.len());
            for s in &r.shifted {
                x = fade * x + (1.0 - fade) * s;
                late.push(x);
            }
            at.iter().map(move |&k| late[k])
        });
        DVector::from_iterator(self.still.len(), all)
    }

    /// The lag with the least misfit, against the residual of a shift with `number` independent
    /// samples.
    fn lag(&self, reach: f64, shift: f64, number: f64) -> Lag {
        let square = |t: f64| self.beside(&self.still - self.lagged(t)).norm_squared();
        let range = ((1e-2 * reach).ln(), reach.ln());
        let time_constant = golden(GOLDEN, range, |log| square(log.exp())).exp();
        Lag {
            time_constant,
            for_shift: number * (square(time_constant) / shift.max(1e-300)).ln(),
        }
    }

    fn beside(&self, x: DVector<f64>) -> DVector<f64> {
        let share = self.basis.tr_mul(&x);
        x - &self.basis * share
    }

    fn residual(&self, tau: f64) -> DVector<f64> {
        self.beside(&self.still - self.shifted(tau))
    }

    fn left(&self, tau: f64) -> f64 {
        self.residual(tau).norm() / self.size
    }
}

/// Orthonormal columns of the same span; columns that add nothing are left out.
fn orthonormal(columns: &DMatrix<f64>) -> DMatrix<f64> {
    let mut kept: Vec<DVector<f64>> = Vec::new();
    for c in columns.column_iter() {
        let (mut x, size) = (c.clone_owned(), c.norm());
        // Twice is enough (W. Kahan in B. N. Parlett, The Symmetric Eigenvalue Problem, 1980, section 6.9).
        for _ in 0..2 {
            for k in &kept {
                let share = k.dot(&x);
                x.axpy(-share, k, 1.0);
            }
        }
        let rest = x.norm();
        if rest > 1e-9 * size && rest > 0.0 {
            kept.push(x / rest);
        }
    }
    if kept.is_empty() {
        return DMatrix::zeros(columns.nrows(), 0);
    }
    DMatrix::from_columns(&kept)
}

/// Finds the shift of `shifted` with the least misfit beside the columns, all records together, and
/// compares it with `stated`. `None` where records are too short or the channel does not move.
pub fn align(records: Vec<Channels>, stated: f64) -> Option<Alignment> {
    let h = records.iter().map(|r| r.h).fold(0.0, f64::max);
    let reach = REACH.max(SAMPLES * h).max(2.0 * stated.abs());
    let step = reach / f64::from(STEPS);
    let problem = Problem::new(records, reach)?;
    let curve: Vec<(f64, f64)> = (-STEPS..=STEPS)
        .map(|i| step * f64::from(i))
        .map(|tau| (tau, problem.left(tau)))
        .collect();
    let best = (0..curve.len()).min_by(|&a, &b| curve[a].1.total_cmp(&curve[b].1))?;
    let inside = best > 0 && best + 1 < curve.len();
    let delay = match inside {
        true => golden(GOLDEN, (curve[best - 1].0, curve[best + 1].0), |tau| {
            problem.left(tau)
        }),
        false => curve[best].0,
    };
    let residual = problem.residual(delay);
    // Within a step of the curve the shift acts as its derivative does.
    let slope = problem
        .beside((problem.shifted(delay + 0.5 * step) - problem.shifted(delay - 0.5 * step)) / step);
    let freedom = (residual.len() - problem.basis.ncols() - 1) as f64;
    let runs = shared(residual.as_slice());
    let level = residual.norm_squared() / freedom * runs;
    let std = (level / slope.norm_squared()).sqrt();
    let before = problem.left(stated);
    let target = &problem.still - problem.shifted(delay);
    // Sizes of the columns by the normal equations: they are few.
    let gram = problem.columns.tr_mul(&problem.columns).svd(true, true);
    let sizes = gram.solve(&problem.columns.tr_mul(&target), 1e-12);
    Some(Alignment {
        delay,
        std: (inside && std.is_finite() && std < reach).then_some(std),
        stated,
        left: before,
        gain: if before > 0.0 {
            (1.0 - (problem.left(delay) / before).powi(2)).max(0.0)
        } else {
            0.0
        },
        columns: sizes.map(|c| c.as_slice().to_vec()).unwrap_or_default(),
        lag: (delay > 0.0).then(|| problem.lag(reach, residual.norm_squared(), freedom / runs)),
        curve,
    })
}

/// Golden section: the place of the minimum of a function with one minimum between two places.
pub(crate) fn golden(steps: usize, (mut a, mut b): (f64, f64), f: impl Fn(f64) -> f64) -> f64 {
    let ratio = 0.5 * (5f64.sqrt() - 1.0);
    for _ in 0..steps {
        let (c, d) = (b - ratio * (b - a), a + ratio * (b - a));
        if f(c) < f(d) {
            b = d;
        } else {
            a = c;
        }
    }
    0.5 * (a + b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Draw;

    const H: f64 = 2e-3;

    fn motion(t: f64) -> f64 {
        (7.0 * t).sin() + 0.5 * (17.0 * t + 1.0).sin() + 0.2 * (31.0 * t).cos()
    }

    /// Channels of which the shifted one acts late, beside a slow disturbance of known shape and
    /// noise.
    fn channels(late: f64, noise: f64, seed: u64) -> Channels {
        let mut draw = Draw::new(seed);
        let t = (0..3000).map(|k| f64::from(k) * H);
        Channels {
            h: H,
            still: t
                .clone()
                .map(|t| motion(t - late) + 0.8 * t.cos() + noise * draw.next())
                .collect(),
            shifted: t.clone().map(motion).collect(),
            beside: vec![t.map(f64::cos).collect()],
        }
    }

    #[test]
    fn a_shift_is_found_between_samples_and_its_deviation_holds() {
        for late in [-0.013, 0.0, 0.0047, 0.06] {
            let (mut inside, tries) = (0, 20);
            for seed in 0..tries {
                let found = align(vec![channels(late, 0.05, seed)], 0.0).expect("enough samples");
                let std = found.std.expect("determined");
                assert!((found.delay - late).abs() < 1e-3, "{late}: {}", found.delay);
                assert!((found.columns[0] - 0.8).abs() < 0.02, "{:?}", found.columns);
                assert_eq!(found.noticeable(), late != 0.0);
                inside += u32::from((found.delay - late).abs() < 2.0 * std);
            }
            assert!(inside >= 16, "{late}: {inside} of {tries}");
        }
    }

    #[test]
    fn a_lag_is_told_from_a_shift() {
        let shift = align(vec![channels(0.02, 0.05, 3)], 0.0).expect("enough samples");
        assert!(shift.lag.expect("late").for_shift > 100.0, "{shift:?}");
        let mut late = channels(0.0, 0.05, 3);
        let (fade, mut x) = ((-H / 0.03_f64).exp(), 0.0);
        for (y, s) in late.still.iter_mut().zip(&late.shifted) {
            x = fade * x + (1.0 - fade) * s;
            *y += x - s;
        }
        let lag = align(vec![late], 0.0).expect("enough samples").lag;
        let lag = lag.expect("late");
        assert!(lag.for_shift < -100.0, "{lag:?}");
        assert!((lag.time_constant - 0.03).abs() < 1e-3, "{lag:?}");
    }

    #[test]
    fn golden_section_ends_at_the_least_value() {
        let found = golden(60, (-3.0, 8.0), |x| (x - 1.7).powi(4) + 0.2);
        assert!((found - 1.7).abs() < 1e-3, "{found}");
    }

    #[test]
    fn a_channel_that_stands_still_or_is_short_has_no_shift() {
        let mut still = channels(0.0, 0.0, 1);
        still.shifted.fill(0.7);
        assert_eq!(align(vec![still], 0.0), None);
        let mut short = channels(0.0, 0.0, 1);
        for x in [&mut short.still, &mut short.shifted, &mut short.beside[0]] {
            x.truncate(60);
        }
        assert_eq!(align(vec![short], 0.0), None);
    }

    #[test]
    fn a_stated_shift_is_no_news() {
        let found = align(vec![channels(0.02, 0.02, 3)], 0.02).expect("enough samples");
        assert!(!found.noticeable());
        assert!((found.delay - 0.02).abs() < 1e-3);
        // Noise of 0.02 beside a motion of this size.
        let of_noise = 0.02 / (0.5_f64 * (1.0 + 0.25 + 0.04)).sqrt();
        assert!(found.left < of_noise, "{} {of_noise}", found.left);
        let off = align(vec![channels(0.02, 0.02, 3)], 0.0).expect("enough samples");
        assert!(off.left > 5.0 * of_noise, "{}", off.left);
    }
}
