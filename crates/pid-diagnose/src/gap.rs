//! The gap: free-run error on records that were never fitted.
//!
//! Each record is cut into windows of the stated horizon; from the read state at the start of a
//! window the model runs freely under the recorded inputs. Per joint the root mean square error of
//! position and of velocity (as the drive would report it) is divided by the standard deviation of
//! the read channel in that record; the gap is the root mean square over joints, channels and
//! records.
//!
//! This is not the free-run error of [`pid_fit::gap::metrics`]: that one is in SI units, of any
//! model, and starts from recorded states. Here windows start from the state of the predictor,
//! since hypotheses have states that no sensor reads, and errors are relative to the motion, so
//! that joints and channels can be summed up.

use pid_data::Role;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::case::{Case, Record, Velocity, smoothed};
use crate::effect::Pick;
use crate::hypothesis::Hypothesis;
use crate::initial;
use crate::nominal::EncoderSide;
use crate::predict::{Runner, gains};
use crate::simulate::State;

/// An error beyond this, relative to the motion, counts as this.
const LARGEST: f64 = 9.9;

/// The gap of one model.
#[derive(Debug, Clone, PartialEq)]
pub struct Gap {
    /// Over everything.
    pub total: f64,
    /// Per joint and channel (position, velocity), root mean square over records; `None` where a
    /// velocity is not recorded.
    pub joints: Vec<(f64, Option<f64>)>,
    /// Squared normalised error of each window, all joints and channels: what an interval is drawn from.
    pub windows: Vec<f64>,
    /// The same joint by joint, `[joint][window]`: what an effect of one joint is judged by.
    pub joint_windows: Vec<Vec<f64>>,
}

/// The windows of one record: its number of samples and the states the predictor has at their starts.
pub(crate) struct Windows {
    pub(crate) length: usize,
    pub(crate) starts: Vec<State<f64>>,
    /// Position and velocity that the predictor has of each joint, at every sample.
    path: Vec<(Vec<f64>, Vec<f64>)>,
}

pub(crate) fn windows(
    case: &Case,
    record: &Record,
    hypothesis: &Hypothesis,
    theta: &[f64],
    e: &[f64],
) -> Windows {
    let last = record.len() - 1;
    let length = case
        .nominal
        .horizon
        .map_or(last, |s| ((s / record.h).round() as usize).clamp(1, last));
    let count = last / length;
    let mut starts = Vec::with_capacity(count);
    let mut g = gains((case, record), hypothesis, theta, e);
    let mut path = vec![(Vec::new(), Vec::new()); case.n()];
    let on_link = case.nominal.encoder_side == EncoderSide::Joint;
    let mut runner = Runner::<f64>::new(case, record, hypothesis, theta, e);
    initial::settle((case, record), hypothesis, (theta, e), &mut g, true);
    runner.predict_over(
        0..record.len(),
        &g,
        &mut |_, _, _, _| {},
        &mut |k, state| {
            if k % length == 0 && starts.len() < count {
                starts.push(state.clone());
            }
            let (q, v) = if on_link {
                (&state.q, &state.v)
            } else {
                (&state.drive_q, &state.drive_v)
            };
            for (j, joint) in path.iter_mut().enumerate() {
                joint.0.push(q[j]);
                joint.1.push(v[j]);
            }
        },
    );
    Windows {
        length,
        starts,
        path,
    }
}

/// Free run over one window: positions and velocities as the drive reports them, joint by joint at
/// each of the samples after the first. `noise` is added to every position and every measured
/// velocity before filters.
pub(crate) fn free_run<D: Pick>(
    case: &Case,
    runner: &mut Runner<'_, '_, D>,
    record: &Record,
    start: &State<D>,
    k: usize,
    length: usize,
    noise: &mut dyn FnMut(usize) -> (f64, f64),
) -> Vec<(D, D)> {
    let n = case.n();
    let fade = case.nominal.velocity_filter_hz.map_or(0.0, |hz| {
        (-2.0 * std::f64::consts::PI * hz * record.h).exp()
    });
    let lag: Vec<D> = (0..n)
        .map(|j| runner.velocity_fade(j).unwrap_or_else(D::nil))
        .collect();
    // A reading that is missing where a window starts is the smoothed one.
    let or = |x: f64, smooth: f64| D::constant(if x.is_finite() { x } else { smooth });
    let mut previous: Vec<D> = (0..n)
        .map(|j| or(record.q[j][k], record.smooth_q[j][k]))
        .collect();
    let mut filtered: Vec<D> = (0..n)
        .map(|j| or(record.v[j][k], record.smooth_v[j][k]))
        .collect();
    let mut shown = filtered.clone();
    let mut out = vec![(D::nil(), D::nil()); n * length];
    runner.free(start, k, length, &mut |i, j, q, v| {
        let (nq, nv) = noise(j);
        let q = q + nq;
        let read = if case.velocity[j] == Velocity::Derived {
            filtered[j] = filtered[j] * fade + (q - previous[j]) * ((1.0 - fade) / record.h);
            previous[j] = q;
            filtered[j]
        } else {
            v
        };
        shown[j] = lag[j] * shown[j] + (-lag[j] + 1.0) * read;
        out[(i - 1) * n + j] = (q, shown[j] + nv);
    });
    out
}

/// Squares of normalised errors, gathered as the gap defines them.
struct Sums {
    joints: Vec<(f64, f64)>,
    records: f64,
    windows: Vec<f64>,
    joint_windows: Vec<Vec<f64>>,
}

/// Squares and numbers of one record, per joint: position, velocity.
type Squares = Vec<[(f64, f64); 2]>;

impl Sums {
    fn new(n: usize) -> Self {
        Sums {
            joints: vec![(0.0, 0.0); n],
            records: 0.0,
            windows: Vec::new(),
            joint_windows: vec![Vec::new(); n],
        }
    }

    fn window(&mut self, squares: &mut Squares, errors: &[(f64, f64)], size: &[(f64, f64)]) {
        let n = size.len();
        let mut own = vec![(0.0, 0.0); n];
        for (i, (eq, ev)) in errors.iter().enumerate() {
            let j = i % n;
            for (c, e) in [eq / size[j].0, ev / size[j].1].into_iter().enumerate() {
                let e = clip(e);
                if e.is_finite() {
                    squares[j][c].0 += e * e;
                    squares[j][c].1 += 1.0;
                    own[j].0 += e * e;
                    own[j].1 += 1.0;
                }
            }
        }
        let mean = |(square, count): (f64, f64)| square / f64::max(count, 1.0);
        let all = own
            .iter()
            .fold((0.0, 0.0), |sum, own| (sum.0 + own.0, sum.1 + own.1));
        self.windows.push(mean(all));
        for (windows, own) in self.joint_windows.iter_mut().zip(own) {
            windows.push(mean(own));
        }
    }

    fn record(&mut self, squares: &Squares) {
        self.records += 1.0;
        for (sum, s) in self.joints.iter_mut().zip(squares) {
            let mean = |(x, count): (f64, f64)| {
                if count > 0.0 {
                    (x / count).min(LARGEST * LARGEST)
                } else {
                    0.0
                }
            };
            sum.0 += mean(s[0]);
            sum.1 += mean(s[1]);
        }
    }

    fn gap(self, case: &Case) -> Gap {
        let joints: Vec<(f64, Option<f64>)> = self
            .joints
            .iter()
            .enumerate()
            .map(|(j, s)| {
                (
                    (s.0 / self.records).sqrt(),
                    (case.velocity[j] != Velocity::Absent).then(|| (s.1 / self.records).sqrt()),
                )
            })
            .collect();
        let all: Vec<f64> = joints
            .iter()
            .flat_map(|(q, v)| std::iter::once(*q).chain(*v))
            .collect();
        Gap {
            total: (all.iter().map(|x| x * x).sum::<f64>() / all.len() as f64).sqrt(),
            joints,
            windows: self.windows,
            joint_windows: self.joint_windows,
        }
    }
}

impl Gap {
    /// Share of each joint and channel in the squared gap; all zero where there is none.
    pub fn shares(&self) -> Vec<(f64, Option<f64>)> {
        let all = self.joints.iter();
        let sum: f64 = all
            .flat_map(|(q, v)| std::iter::once(*q).chain(*v))
            .map(|x| x * x)
            .sum();
        let share = |x: f64| x * x / sum.max(1e-300);
        self.joints
            .iter()
            .map(|(q, v)| (share(*q), v.map(share)))
            .collect()
    }
    /// Interval of 95 % of the total, by drawing the windows anew (B. Efron, R. J. Tibshirani, An
    /// Introduction to the Bootstrap, 1993, chapter 13), about the stated total; fixed seed.
    pub fn interval(&self) -> (f64, f64) {
        let n = self.windows.len();
        let mean = self.windows.iter().sum::<f64>() / n.max(1) as f64;
        if n < 2 || mean <= 0.0 {
            return (self.total, self.total);
        }
        within(draws(n, 0xb007).map(|draw| self.square_of(&draw).sqrt()))
    }
    /// Square of the total, were the windows those of a draw.
    pub(crate) fn square_of(&self, draw: &[usize]) -> f64 {
        let mean = self.windows.iter().sum::<f64>() / self.windows.len() as f64;
        let drawn = draw.iter().map(|&i| self.windows[i]).sum::<f64>() / draw.len() as f64;
        // Records count alike in the total, whatever the number of their windows.
        self.total * self.total * drawn / mean.max(1e-300)
    }
}

/// Fewest windows whose scatter tells anything.
pub(crate) const FEW_WINDOWS: usize = 4;
/// Draws of windows that an interval rests on.
const RESAMPLED: usize = 400;

/// Draws of `n` windows with replacement (B. Efron, R. J. Tibshirani, An Introduction to the Bootstrap,
/// 1993, chapter 6).
pub(crate) fn draws(n: usize, seed: u64) -> impl Iterator<Item = Vec<usize>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..RESAMPLED).map(move |_| (0..n).map(|_| random.random_range(0..n)).collect())
}

/// Interval of 95 % of the values of draws: their percentiles.
pub(crate) fn within(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let at = |q: f64| values[((values.len() - 1) as f64 * q).round() as usize];
    (at(0.025), at(0.975))
}

/// Standard deviations of the position and velocity readings of every joint of a record, of a part those of
/// the whole record.
pub(crate) fn deviations(record: &Record, n: usize) -> Vec<(f64, f64)> {
    if let Some(whole) = &record.whole {
        return whole.clone();
    }
    (0..n)
        .map(|j| (deviation(&record.q[j]), deviation(&record.v[j])))
        .collect()
}

/// Free-run error of a hypothesis at its parameters on the records of a role.
pub fn gap(case: &Case, hypothesis: &Hypothesis, theta: &[f64], e: &[f64], role: Role) -> Gap {
    let n = case.n();
    let mut sums = Sums::new(n);
    for record in case.records.iter().filter(|r| r.role == role) {
        let w = windows(case, record, hypothesis, theta, e);
        let size = deviations(record, n);
        let mut runner = Runner::<f64>::new(case, record, hypothesis, theta, e);
        let mut squares = vec![[(0.0, 0.0); 2]; n];
        for (i, start) in w.starts.iter().enumerate() {
            let k = i * w.length;
            let mut run = free_run(case, &mut runner, record, start, k, w.length, &mut |_| {
                (0.0, 0.0)
            });
            for (i, x) in run.iter_mut().enumerate() {
                let (j, at) = (i % n, k + 1 + i / n);
                *x = (
                    off(x.0 - record.q[j][at], record.q[j][at]),
                    off(x.1 - record.v[j][at], record.v[j][at]),
                );
            }
            sums.window(&mut squares, &run, &size);
        }
        sums.record(&squares);
    }
    sums.gap(case)
}

/// Draws of the noise that a floor is averaged over.
const DRAWS: usize = 24;

/// The gap that noise alone leaves: its root mean square over some draws of the noise, and the
/// largest of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Floor {
    /// Root mean square.
    pub typical: f64,
    /// Largest: few windows and starts without a reading of the velocity make it differ much from
    /// draw to draw.
    pub largest: f64,
}

/// The gap of the true model under simulated noise: free runs with drive noise drawn anew and read
/// with reading noise, against the same runs without. Starts come from the same smoothing filter as
/// real ones, so its bias near stops and reversals is included (fixed seed).
pub fn floor(case: &Case, hypothesis: &Hypothesis, theta: &[f64], e: &[f64], role: Role) -> Floor {
    let mut random = ChaCha8Rng::seed_from_u64(0x5eed);
    let n = case.n();
    let mut draws: Vec<Sums> = (0..DRAWS).map(|_| Sums::new(n)).collect();
    for record in case.records.iter().filter(|r| r.role == role) {
        let w = windows(case, record, hypothesis, theta, e);
        let size = deviations(record, n);
        let mut clean = Runner::<f64>::new(case, record, hypothesis, theta, e);
        let plain: Vec<Vec<(f64, f64)>> = w
            .starts
            .iter()
            .enumerate()
            .map(|(i, start)| {
                free_run(
                    case,
                    &mut clean,
                    record,
                    start,
                    i * w.length,
                    w.length,
                    &mut |_| (0.0, 0.0),
                )
            })
            .collect();
        let t: Vec<f64> = (0..record.len()).map(|k| k as f64 * record.h).collect();
        for sums in &mut draws {
            let mut squares = vec![[(0.0, 0.0); 2]; n];
            let mut noisy = record.clone();
            for j in 0..n {
                // No noise of the drive reaches a joint whose input exerts no force.
                let scale = match case.force_per_input(record, j).abs() {
                    0.0 => 0.0,
                    per_input => case.noise[j].torque / per_input,
                };
                for u in &mut noisy.u[j] {
                    *u += scale * random.sample::<f64, _>(StandardNormal);
                }
                let (q, v) = &w.path[j];
                let read = q
                    .iter()
                    .map(|q| q + case.noise[j].q * random.sample::<f64, _>(StandardNormal))
                    .collect();
                let (smooth_q, smooth_v) = smoothed(&t, read);
                for i in 0..w.starts.len() {
                    let k = i * w.length;
                    noisy.smooth_q[j][k] += smooth_q[k] - q[k];
                    noisy.smooth_v[j][k] += smooth_v[k] - v[k];
                }
            }
            let mut disturbed = Runner::<f64>::new(case, &noisy, hypothesis, theta, e);
            for (i, start) in w.starts.iter().enumerate() {
                let k = i * w.length;
                let mut run =
                    free_run(case, &mut disturbed, &noisy, start, k, w.length, &mut |j| {
                        let nq = case.noise[j].q * random.sample::<f64, _>(StandardNormal);
                        let nv = if case.velocity[j] == Velocity::Measured {
                            case.noise[j].v * random.sample::<f64, _>(StandardNormal)
                        } else {
                            0.0
                        };
                        (nq, nv)
                    });
                for (i, (x, y)) in run.iter_mut().zip(&plain[i]).enumerate() {
                    let (j, at) = (i % n, k + 1 + i / n);
                    *x = (
                        off(x.0 - y.0, record.q[j][at]),
                        off(x.1 - y.1, record.v[j][at]),
                    );
                }
                sums.window(&mut squares, &run, &size);
            }
            sums.record(&squares);
        }
    }
    let totals: Vec<f64> = draws.into_iter().map(|s| s.gap(case).total).collect();
    Floor {
        typical: (totals.iter().map(|x| x * x).sum::<f64>() / totals.len() as f64).sqrt(),
        largest: totals.iter().copied().fold(0.0, f64::max),
    }
}

/// An error where something was read: readings that are missing count nowhere, and a run that diverged is
/// infinitely far off.
fn off(error: f64, reading: f64) -> f64 {
    match (reading.is_finite(), error.is_nan()) {
        (false, _) => f64::NAN,
        (true, true) => f64::INFINITY,
        (true, false) => error,
    }
}

fn clip(x: f64) -> f64 {
    if x.is_nan() { x } else { x.clamp(-1e3, 1e3) }
}

fn deviation(x: &[f64]) -> f64 {
    let known: Vec<f64> = x.iter().copied().filter(|x| x.is_finite()).collect();
    if known.is_empty() {
        return 1.0;
    }
    let mean = known.iter().sum::<f64>() / known.len() as f64;
    (known.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / known.len() as f64)
        .sqrt()
        .max(1e-12)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, pendulum_under};

    #[test]
    fn the_floor_knows_how_the_filter_rounds_a_motion_where_windows_start() {
        // The input jumps where each window starts: the filtered velocity is off there by far more
        // than the noise makes it.
        let seconds = 0.5;
        let nothing = Hypothesis::default();
        let mut case = pendulum_under(&nothing, &[], 6.0, &|_| {}, &|i, t| {
            let size = 1.5 + 0.3 * i as f64;
            if ((t / seconds) as usize).is_multiple_of(2) {
                size
            } else {
                -size
            }
        });
        case.nominal.horizon = Some(seconds);
        for record in &mut case.records {
            let t: Vec<f64> = (0..record.len()).map(|k| k as f64 * record.h).collect();
            let (q, v) = smoothed(&t, record.q[0].clone());
            (record.smooth_q, record.smooth_v) = (vec![q], vec![v]);
        }
        let theta = vec![0.0; SIZE];
        let true_model = gap(&case, &nothing, &theta, &[], Role::Test).total;
        let noise = floor(&case, &nothing, &theta, &[], Role::Test);
        let ratio = true_model / noise.typical;
        assert!((0.8..1.25).contains(&ratio), "{true_model} {noise:?}");
    }
}
