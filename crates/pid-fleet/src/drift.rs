//! Since when a unit changes: steps and ramps by likelihood ratio.
//!
//! Several quantities of one unit over its logs, each value with a known deviation. Under the null hypothesis nothing
//! changes: every quantity has one mean. Under the alternative a shape `x(t)` is added to every quantity with an
//! amplitude of its own, a step `t > t₀` or a ramp `max(0, t − t₀)`. For one quantity and one shape
//!
//! ```text
//! T = (Σ w x̃ y)² / Σ w x̃²,     x̃ = x − Σ w x / Σ w,  w = 1/σ²
//! ```
//!
//! is χ² of one degree of freedom under the null. The largest T over all steps, ramps and quantities is compared with
//! the union bound over `quantities × (2 n − 5)` such values of n logs: between `n − 3` steps, and ramps whose onsets
//! within one interval of logs count once. A test by simulation holds the bound.

use serde::{Deserialize, Serialize};

use crate::standing_out::chi_square_tail;

/// Logs that a change is seen in, and that are there before it.
const BEFORE_AND_AFTER: usize = 2;
/// Fewest logs of a unit that a change can be told from.
pub const FEWEST: usize = 2 * BEFORE_AND_AFTER;
/// Onsets of ramps that are tried per interval of logs.
const ONSETS: usize = 8;
/// Rounds by which the best onset is refined.
const ROUNDS: usize = 6;

/// How a unit changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// At once, between two logs.
    Step,
    /// Evenly from the onset on.
    Ramp,
}

/// A change of a unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// Its shape.
    pub shape: Shape,
    /// When it begins: the middle between two logs for a step.
    pub onset: f64,
    /// Earliest and latest onset that the logs allow: both logs about a step; for a ramp, where the likelihood is
    /// within that of 95 % (χ² of one degree of freedom).
    pub between: (f64, f64),
    /// The largest T.
    pub statistic: f64,
    /// Probability of such a T where nothing changes, by the union bound; with any one log left out.
    pub p: f64,
    /// What each quantity changes by from its level before to the last log, and the deviation of that.
    pub by: Vec<(f64, f64)>,
    /// Level of each quantity before the onset, and its deviation.
    pub before: Vec<(f64, f64)>,
}

/// The logs of a unit in the order of time.
#[derive(Debug, Clone, Copy)]
pub struct Series<'a> {
    /// Times.
    pub times: &'a [f64],
    /// Values, quantity by quantity.
    pub values: &'a [Vec<f64>],
    /// Deviations of the values.
    pub deviations: &'a [Vec<f64>],
}

/// A shape with its onset.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    shape: Shape,
    onset: f64,
}

impl Candidate {
    fn at(&self, t: f64) -> f64 {
        match self.shape {
            Shape::Step if t > self.onset => 1.0,
            Shape::Step => 0.0,
            Shape::Ramp => (t - self.onset).max(0.0),
        }
    }
}

/// The change that explains a unit best; `None` with too few logs. Whether it is one is said by its `p`.
pub fn change(series: Series<'_>) -> Option<Change> {
    let n = series.times.len();
    if n < FEWEST || series.values.is_empty() {
        return None;
    }
    let best = best(series)?;
    let (_, largest) = likelihood(series, best);
    let mut p = bound(series, largest);
    // A single odd log is no change: what is left without any of them has to stand out.
    if p < 1.0 && n > FEWEST {
        for left_out in 0..n {
            let kept = without(series, left_out);
            let (_, least) = likelihood(kept.series(), best);
            p = p.max(bound(kept.series(), least));
        }
    }
    let last = best.at(series.times[n - 1]);
    let fits: Vec<[f64; 4]> = (0..series.values.len())
        .map(|k| fit(series, best, k))
        .collect();
    Some(Change {
        shape: best.shape,
        onset: best.onset,
        between: between(series, best),
        statistic: largest,
        p,
        by: fits.iter().map(|f| (last * f[2], last * f[3])).collect(),
        before: fits.iter().map(|f| (f[0], f[1])).collect(),
    })
}

/// Probability bound of a T.
fn bound(series: Series<'_>, statistic: f64) -> f64 {
    let shapes = (2 * series.times.len()).saturating_sub(5).max(1);
    (chi_square_tail(statistic) * (shapes * series.values.len()) as f64).min(1.0)
}

/// The shape that explains all quantities together best.
fn best(series: Series<'_>) -> Option<Candidate> {
    let t = series.times;
    let n = t.len();
    let first = BEFORE_AND_AFTER - 1;
    let steps = (first..n - BEFORE_AND_AFTER).map(|k| Candidate {
        shape: Shape::Step,
        onset: 0.5 * (t[k] + t[k + 1]),
    });
    let ramps = (first..n - BEFORE_AND_AFTER).flat_map(|k| {
        (0..ONSETS).map(move |i| Candidate {
            shape: Shape::Ramp,
            onset: t[k] + (t[k + 1] - t[k]) * i as f64 / ONSETS as f64,
        })
    });
    let start = Candidate {
        shape: Shape::Ramp,
        onset: t[0],
    };
    let all = steps.chain(ramps).chain([start]);
    let total = |c: &Candidate| likelihood(series, *c).0;
    let mut best = all.max_by(|a, b| total(a).total_cmp(&total(b)))?;
    if best.shape == Shape::Ramp {
        let mut width = (t[n - 1] - t[0]) / n as f64 / ONSETS as f64;
        for _ in 0..ROUNDS {
            let near = [-1.0, -0.5, 0.0, 0.5, 1.0].map(|s| Candidate {
                onset: (best.onset + s * width).clamp(t[0], t[n - BEFORE_AND_AFTER]),
                ..best
            });
            best = near
                .into_iter()
                .max_by(|a, b| total(a).total_cmp(&total(b)))?;
            width *= 0.5;
        }
    }
    Some(best)
}

/// T of all quantities together, and the largest of one.
fn likelihood(series: Series<'_>, candidate: Candidate) -> (f64, f64) {
    let each = (0..series.values.len()).map(|k| {
        let [_, _, amplitude, deviation] = fit(series, candidate, k);
        match deviation > 0.0 && deviation.is_finite() {
            true => (amplitude / deviation).powi(2),
            false => 0.0,
        }
    });
    each.fold((0.0, 0.0), |(sum, most), t| (sum + t, most.max(t)))
}

/// Level before, its deviation, amplitude, its deviation of a quantity.
fn fit(series: Series<'_>, candidate: Candidate, quantity: usize) -> [f64; 4] {
    let rows = series.times.iter().zip(&series.values[quantity]);
    let rows = rows.zip(&series.deviations[quantity]);
    let (mut w, mut wx, mut wxx, mut wy, mut wxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    // Values relative to the first keep their digits.
    let origin = series.values[quantity][0];
    for ((&t, &y), &s) in rows {
        let (x, y, own) = (candidate.at(t), y - origin, 1.0 / (s * s));
        w += own;
        wx += own * x;
        wxx += own * x * x;
        wy += own * y;
        wxy += own * x * y;
    }
    let determinant = w * wxx - wx * wx;
    let determined = determinant > 1e-12 * w * wxx;
    if !determined {
        return [origin + wy / w, w.sqrt().recip(), 0.0, f64::INFINITY];
    }
    let amplitude = (w * wxy - wx * wy) / determinant;
    [
        origin + (wy - wx * amplitude) / w,
        (wxx / determinant).sqrt(),
        amplitude,
        (w / determinant).sqrt(),
    ]
}

/// Quantile of χ² of one degree of freedom at 95 %.
const WITHIN: f64 = 3.841;

/// Where the onset may lie.
fn between(series: Series<'_>, best: Candidate) -> (f64, f64) {
    let t = series.times;
    let after = t
        .partition_point(|t| *t <= best.onset)
        .clamp(1, t.len() - 1);
    if best.shape == Shape::Step {
        return (t[after - 1], t[after]);
    }
    let top = likelihood(series, best).0;
    let width = (t[t.len() - 1] - t[0]) / 400.0;
    let reach = |direction: f64| {
        let inside = |onset: f64| {
            let here = Candidate { onset, ..best };
            (t[0]..=t[t.len() - 1]).contains(&onset) && likelihood(series, here).0 >= top - WITHIN
        };
        let steps = (1..).map(|k| best.onset + direction * width * f64::from(k));
        steps.take_while(|onset| inside(*onset)).last()
    };
    (
        reach(-1.0).unwrap_or(best.onset),
        reach(1.0).unwrap_or(best.onset),
    )
}

/// A series that owns its numbers.
struct Kept {
    times: Vec<f64>,
    values: Vec<Vec<f64>>,
    deviations: Vec<Vec<f64>>,
}

impl Kept {
    fn series(&self) -> Series<'_> {
        Series {
            times: &self.times,
            values: &self.values,
            deviations: &self.deviations,
        }
    }
}

fn without(series: Series<'_>, left_out: usize) -> Kept {
    let cut = |x: &[f64]| -> Vec<f64> {
        let rows = x.iter().enumerate().filter(|(i, _)| *i != left_out);
        rows.map(|(_, x)| *x).collect()
    };
    Kept {
        times: cut(series.times),
        values: series.values.iter().map(|x| cut(x)).collect(),
        deviations: series.deviations.iter().map(|x| cut(x)).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    const QUANTITIES: usize = 4;
    const SIGMA: f64 = 0.1;

    fn times(n: usize) -> Vec<f64> {
        (0..n).map(|k| 30.0 * k as f64).collect()
    }

    fn found(times: &[f64], seed: u64, added: impl Fn(usize, f64) -> f64) -> Change {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let values: Vec<Vec<f64>> = (0..QUANTITIES)
            .map(|q| {
                let noise = |t: &f64, z: f64| 5.0 + SIGMA * z + added(q, *t);
                times
                    .iter()
                    .map(|t| noise(t, random.sample(StandardNormal)))
                    .collect()
            })
            .collect();
        let deviations = vec![vec![SIGMA; times.len()]; QUANTITIES];
        change(Series {
            times,
            values: &values,
            deviations: &deviations,
        })
        .expect("enough logs")
    }

    #[test]
    fn the_bound_holds_where_nothing_changes() {
        let times = times(10);
        let draws = 2000;
        let p: Vec<f64> = (0..draws)
            .map(|seed| found(&times, seed, |_, _| 0.0).p)
            .collect();
        for level in [0.2, 0.05, 0.01] {
            let share = p.iter().filter(|p| **p <= level).count() as f64 / draws as f64;
            assert!(share <= level, "{share} at {level}");
        }
    }

    #[test]
    fn a_ramp_is_found_with_its_onset() {
        let times = times(10);
        let grows = |q: usize, t: f64| match q {
            2 => 0.015 * (t - 100.0).max(0.0),
            _ => 0.0,
        };
        for seed in 0..20 {
            let change = found(&times, seed, grows);
            assert!(change.p < 1e-6 && change.shape == Shape::Ramp, "{change:?}");
            assert!((change.onset - 100.0).abs() < 25.0, "{change:?}");
            assert!(change.between.0 <= change.onset && change.onset <= change.between.1);
            let (by, deviation) = change.by[2];
            assert!((by - 2.55).abs() < 4.0 * deviation, "{change:?}");
            assert!((change.before[2].0 - 5.0).abs() < 5.0 * change.before[2].1);
        }
    }

    #[test]
    fn a_step_lies_between_its_logs() {
        let times = times(10);
        for seed in 0..20 {
            let change = found(
                &times,
                seed,
                |q, t| {
                    if q == 1 && t > 140.0 { -1.0 } else { 0.0 }
                },
            );
            assert!(change.p < 1e-6 && change.shape == Shape::Step, "{change:?}");
            assert_eq!(change.between, (120.0, 150.0));
            assert_eq!(change.onset, 135.0);
        }
    }

    #[test]
    fn one_odd_log_is_no_change() {
        let times = times(10);
        for odd in [0.0, 150.0, 270.0] {
            let change = found(&times, 7, |q, t| if q == 0 && t == odd { 3.0 } else { 0.0 });
            assert!(change.p > 0.05, "{odd}: {change:?}");
        }
        let few = vec![vec![0.0; 3]];
        let short = Series {
            times: &[0.0, 1.0, 2.0],
            values: &few,
            deviations: &few,
        };
        assert_eq!(change(short), None);
    }
}
