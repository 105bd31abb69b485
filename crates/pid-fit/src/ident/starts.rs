//! Several starts: drawing them, running them in parallel, grouping the optima they reach.

use super::outcome::{Callback, Optimum, Progress, Run};
use pid_nlp::solver::Iteration;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc;

/// Where the starts after the first one are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Sampling {
    /// Around the given start: factors 10^U(−0.5, 0.5) on it, and shifts by a third of the range
    /// where a range crosses zero.
    #[default]
    Around,
    /// A Latin hypercube in the bounds: every parameter visits every one of as many equal parts of
    /// its range as there are starts (M. McKay, R. Beckman, W. Conover 1979). Ranges of one sign
    /// whose ends differ by a factor of ten or more are divided in the logarithm; parameters
    /// without two finite bounds are drawn as by [`Sampling::Around`].
    LatinHypercube,
    /// A Sobol sequence in the bounds, scrambled as by A. Owen from the seed: any 2^k starts in a
    /// row from the first fill every pair of parameters evenly, not only each by itself. Ranges as
    /// in [`Sampling::LatinHypercube`].
    Sobol,
}

/// Seeded starts within the bounds, the given one first; `count` in all.
pub fn draw(
    sampling: Sampling,
    start: &[f64],
    lower: &[f64],
    upper: &[f64],
    count: usize,
    seed: u64,
) -> Vec<Vec<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut all = vec![start.to_vec()];
    let drawn = count.saturating_sub(1);
    for _ in 0..drawn {
        let around = (0..start.len()).map(|k| {
            let shift = random.random_range(-0.5..0.5);
            let value = if lower[k] < 0.0 && upper[k] > 0.0 && upper[k].is_finite() {
                start[k] + shift * 2.0 / 3.0 * (upper[k] - lower[k]).min(f64::MAX)
            } else {
                start[k] * 10f64.powf(shift)
            };
            value.max(lower[k]).min(upper[k])
        });
        all.push(around.collect());
    }
    if sampling == Sampling::Around {
        return all;
    }
    for k in 0..start.len() {
        let (low, high) = (lower[k], upper[k]);
        if !(low.is_finite() && high.is_finite() && low < high) {
            continue;
        }
        let logarithmic = low > 0.0 && high >= 10.0 * low;
        let mut order: Vec<usize> = (0..drawn).collect();
        order.shuffle(&mut random);
        for (index, (point, part)) in all[1..].iter_mut().zip(order).enumerate() {
            let share = match sampling {
                Sampling::Sobol => sobol(index, k, seed),
                _ => (part as f64 + random.random::<f64>()) / drawn as f64,
            };
            let value = if logarithmic {
                low * (high / low).powf(share)
            } else {
                low + share * (high - low)
            };
            point[k] = value.clamp(low, high);
        }
    }
    all
}

/// Coordinate of a point of the sequence, in [0, 1). Beyond the dimensions of the table, the same
/// ones are scrambled anew.
fn sobol(point: usize, coordinate: usize, seed: u64) -> f64 {
    const DIMENSIONS: usize = sobol_burley::NUM_DIMENSIONS as usize;
    let table = (coordinate / DIMENSIONS) as u64;
    let seed = ChaCha8Rng::seed_from_u64(seed ^ (table << 32)).random::<u32>();
    let (point, coordinate) = (point as u32, (coordinate % DIMENSIONS) as u32);
    f64::from(sobol_burley::sample(point, coordinate, seed))
}

/// Receives phase and iteration of one start.
pub(super) type Report<'a> = dyn FnMut(&'static str, &Iteration) -> ControlFlow<()> + 'a;

enum News<T> {
    Iteration(usize, &'static str, Iteration),
    Done(usize, T),
}

/// Solves from every start, several at a time; outcomes in the order of the starts, and whether the
/// callback asked to stop (those not yet begun are then left out).
pub(super) fn run_all<T: Send>(
    count: usize,
    callback: &mut Callback<'_>,
    solve: impl Fn(usize, &mut Report<'_>) -> T + Sync,
) -> (Vec<T>, bool) {
    if count == 1 {
        let mut stopped = false;
        let outcome = solve(0, &mut |phase, iteration| {
            let flow = callback(&Progress {
                start: 0,
                starts: 1,
                phase,
                iteration,
            });
            stopped |= flow.is_break();
            flow
        });
        return (vec![outcome], stopped);
    }
    let (next, stop) = (AtomicUsize::new(0), AtomicBool::new(false));
    let (sender, receiver) = mpsc::channel();
    let mut outcomes: Vec<(usize, T)> = Vec::new();
    std::thread::scope(|scope| {
        for _ in 0..rayon::current_num_threads().min(count) {
            let sender = sender.clone();
            let (next, stop, solve) = (&next, &stop, &solve);
            scope.spawn(move || {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= count || stop.load(Ordering::Relaxed) {
                        return;
                    }
                    let outcome = solve(index, &mut |phase, iteration| {
                        // If the receiver is gone, nobody asks for more.
                        let _ = sender.send(News::Iteration(index, phase, *iteration));
                        if stop.load(Ordering::Relaxed) {
                            ControlFlow::Break(())
                        } else {
                            ControlFlow::Continue(())
                        }
                    });
                    let _ = sender.send(News::Done(index, outcome));
                }
            });
        }
        drop(sender);
        for news in receiver {
            match news {
                News::Iteration(start, phase, iteration) => {
                    let flow = callback(&Progress {
                        start,
                        starts: count,
                        phase,
                        iteration: &iteration,
                    });
                    if flow.is_break() {
                        stop.store(true, Ordering::Relaxed);
                    }
                }
                News::Done(index, outcome) => outcomes.push((index, outcome)),
            }
        }
    });
    outcomes.sort_by_key(|(index, _)| *index);
    let stopped = stop.load(Ordering::Relaxed);
    (outcomes.into_iter().map(|(_, o)| o).collect(), stopped)
}

/// Runs within one optimum have objectives that differ by at most this share.
const SAME_OBJECTIVE: f64 = 1e-3;
/// Their motions differ by at most this share (RMS difference over the RMS of the motion about its
/// mean).
const SAME_MOTION: f64 = 1e-2;
/// A point counts up to this constraint violation.
const FEASIBLE: f64 = 1e-6;

/// Groups runs by the optimum they reached: one objective and one fitted motion. Parameters are not
/// compared, because redundant ones differ within an optimum. Runs count if they converged or at
/// least are feasible; `motions` holds the fitted states of each run, channels side by side.
pub fn optima(runs: &[Run], motions: &[Vec<f64>], channels: usize) -> Vec<Optimum> {
    let usable = |r: &&usize| {
        let run = &runs[**r];
        run.objective.is_finite() && run.check.primal_inf <= FEASIBLE
    };
    let all: Vec<usize> = (0..runs.len()).collect();
    let mut order: Vec<usize> = all.iter().filter(usable).copied().collect();
    order.sort_by(|&a, &b| runs[a].objective.total_cmp(&runs[b].objective));
    let mut found: Vec<Optimum> = Vec::new();
    for run in order {
        let j = runs[run].objective;
        let same = found.iter_mut().find(|o| {
            (j - o.objective).abs() <= SAME_OBJECTIVE * o.objective.abs().max(1e-12)
                && distance(&motions[o.runs[0]], &motions[run], channels) <= SAME_MOTION
        });
        match same {
            Some(optimum) => optimum.runs.push(run),
            None => found.push(Optimum {
                objective: j,
                runs: vec![run],
                share: 0.0,
            }),
        }
    }
    for optimum in &mut found {
        optimum.share = optimum.runs.len() as f64 / runs.len() as f64;
    }
    found
}

/// Largest RMS difference of a channel over its RMS about the mean.
fn distance(a: &[f64], b: &[f64], channels: usize) -> f64 {
    let mut worst = 0.0_f64;
    for c in 0..channels {
        let of = |x: &[f64]| -> Vec<f64> { x.iter().skip(c).step_by(channels).copied().collect() };
        let (a, b) = (of(a), of(b));
        let n = a.len() as f64;
        let mean = a.iter().sum::<f64>() / n;
        let spread: f64 = a.iter().map(|x| (x - mean) * (x - mean)).sum();
        let difference: f64 = a.iter().zip(&b).map(|(a, b)| (a - b) * (a - b)).sum();
        if difference > 0.0 {
            worst = worst.max((difference / spread.max(1e-300)).sqrt());
        }
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_latin_hypercube_visits_every_part_of_every_range_once() {
        let (lower, upper) = ([0.1, -2.0, 5.0, 1.0], [10.0, 2.0, 5.0, f64::INFINITY]);
        let start = [1.0, 0.0, 5.0, 2.0];
        let points = draw(Sampling::LatinHypercube, &start, &lower, &upper, 21, 4);
        assert_eq!(points[0], start);
        let part = |share: f64| (share * 20.0) as usize;
        let logarithmic = |p: &Vec<f64>| part((p[0] / 0.1).log10() / 2.0);
        let linear = |p: &Vec<f64>| part((p[1] + 2.0) / 4.0);
        for place in [&logarithmic as &dyn Fn(&Vec<f64>) -> usize, &linear] {
            let mut parts: Vec<usize> = points[1..].iter().map(place).collect();
            parts.sort_unstable();
            assert_eq!(parts, (0..20).collect::<Vec<_>>());
        }
        assert!(points.iter().all(|p| p[2] == 5.0 && p[3] >= 1.0));
        assert_eq!(
            points,
            draw(Sampling::LatinHypercube, &start, &lower, &upper, 21, 4)
        );
        assert_ne!(
            points,
            draw(Sampling::LatinHypercube, &start, &lower, &upper, 21, 5)
        );
    }

    /// Sixteen points: one in every sixteenth of each range, and one in each of the four by four
    /// cells of the first two parameters.
    #[test]
    fn a_sobol_sequence_fills_pairs_of_ranges_evenly() {
        let (lower, upper) = ([0.0, -2.0, 0.1], [1.0, 2.0, 10.0]);
        let start = [0.5, 0.0, 1.0];
        let points = draw(Sampling::Sobol, &start, &lower, &upper, 17, 4);
        assert_eq!(points[0], start);
        let shares = |p: &Vec<f64>| [p[0], (p[1] + 2.0) / 4.0, (p[2] / 0.1).log10() / 2.0];
        for k in 0..3 {
            let mut parts: Vec<usize> = points[1..]
                .iter()
                .map(|p| (shares(p)[k] * 16.0) as usize)
                .collect();
            parts.sort_unstable();
            assert_eq!(parts, (0..16).collect::<Vec<_>>(), "parameter {k}");
        }
        let cell = |x: f64| (x * 4.0) as usize;
        let mut cells: Vec<usize> = points[1..]
            .iter()
            .map(|p| 4 * cell(shares(p)[0]) + cell(shares(p)[1]))
            .collect();
        cells.sort_unstable();
        assert_eq!(cells, (0..16).collect::<Vec<_>>());
        let again = |seed| draw(Sampling::Sobol, &start, &lower, &upper, 17, seed);
        assert_eq!(points, again(4));
        assert_ne!(points, again(5));
    }

    #[test]
    fn starts_run_once_each_and_keep_their_order() {
        let mut heard = 0;
        let (outcomes, stopped) = run_all(
            9,
            &mut |_| {
                heard += 1;
                ControlFlow::Continue(())
            },
            |index, report| {
                let line = Iteration {
                    iteration: 0,
                    objective: index as f64,
                    primal_inf: 0.0,
                    dual_inf: 0.0,
                    mu: 0.1,
                    step: 0.0,
                    regularisation: 0.0,
                    alpha_dual: 1.0,
                    alpha: 1.0,
                    trials: 1,
                    kind: 'f',
                };
                let _ = report("solving", &line);
                index * index
            },
        );
        assert_eq!(outcomes, [0, 1, 4, 9, 16, 25, 36, 49, 64]);
        assert!(!stopped && heard == 9);
    }
}
