//! The weak-constraint problem on one record: trajectories, their objective, its linearisation, the
//! noise levels.

use nalgebra::{DMatrix, DVector};

use super::States;
use super::estimate::{MissingForceError, MissingForceEstimate, NoiseLevels, Values};
use super::smoother::{Prior, Smoothed, Step, Variances};
use pid_data::signal::{column, fill_missing, noise_level_without_jumps};
use pid_data::{Dataset, Experiment, InputHold, VelocityKind};
use pid_runtime::dynamics::{At, Jacobian};

/// Shortest step of the line search.
const SHORTEST: f64 = 1.0 / 64.0;
/// The noise of a channel is at least this share of its spread, since records without noise leave
/// rounding errors only.
const QUIETEST: f64 = 1e-8;
/// A drift of the force below this share of the total force over the whole record counts as none.
const STEADIEST: f64 = 1e-3;
/// Expectation maximisation multiplies a level by the ratio it found, raised to a power. The power
/// grows by this factor while the ratios keep their direction, and starts again from 1 when they
/// turn.
const HURRY: f64 = 2.0;
/// Largest such power.
const FASTEST: f64 = 1000.0;

/// A trajectory of the chain: N states, N − 1 accelerations and missing forces.
#[derive(Debug, Clone)]
pub(super) struct Path {
    pub(super) q: Vec<f64>,
    pub(super) v: Vec<f64>,
    pub(super) a: Vec<f64>,
    pub(super) w: Vec<f64>,
}

pub(super) struct Problem<'a> {
    model: &'a dyn Jacobian,
    p: &'a [f64],
    experiment: &'a Experiment,
    nq: usize,
    /// Inputs on the intervals; (N − 1) × nu.
    u: Vec<f64>,
    /// Measurements; N × 2 nq.
    pub(super) y: Vec<f64>,
    /// Smallest admitted variances of q, v and drift; 3 nq.
    pub(super) floor: Vec<f64>,
    /// Coordinates that nothing reads or on which no force acts.
    states: &'a States,
    values: Vec<f64>,
    q: Vec<f64>,
    v: Vec<f64>,
}

impl<'a> Problem<'a> {
    pub(super) fn new(
        model: &'a dyn Jacobian,
        p: &'a [f64],
        dataset: &Dataset,
        (experiment, states): (&'a Experiment, &'a States),
    ) -> Self {
        let (n, nq) = (experiment.len(), experiment.nq);
        let u = inputs_on_intervals(experiment, dataset.input_hold);
        let mut y = vec![f64::NAN; n * 2 * nq];
        let mut floor = vec![f64::MIN_POSITIVE.sqrt(); 3 * nq];
        let read = dataset.joints.iter().enumerate();
        for (j, joint) in read.filter(|(j, _)| !states.unread.contains(j)) {
            let velocity = experiment
                .v
                .as_ref()
                .filter(|_| joint.velocity == VelocityKind::Measured);
            for (channel, x) in [(j, Some(&experiment.q)), (nq + j, velocity)] {
                let Some(x) = x else { continue };
                let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
                for i in 0..n {
                    let value = x[i * nq + j];
                    y[i * 2 * nq + channel] = value;
                    if value.is_finite() {
                        (low, high) = (low.min(value), high.max(value));
                    }
                }
                floor[channel] = (QUIETEST * (high - low).max(QUIETEST)).powi(2);
            }
        }
        Problem {
            model,
            p,
            experiment,
            nq,
            u,
            y,
            floor,
            states,
            values: vec![0.0; model.jacobian_pattern().nnz()],
            q: vec![0.0; nq],
            v: vec![0.0; nq],
        }
    }

    /// Inputs on interval i.
    fn input(&self, i: usize) -> &[f64] {
        let nu = self.experiment.nu();
        &self.u[i * nu..(i + 1) * nu]
    }

    fn h(&self, i: usize) -> f64 {
        self.experiment.t[i + 1] - self.experiment.t[i]
    }

    /// State at the middle of interval i.
    fn middle(&mut self, path: &Path, i: usize) {
        let h = self.h(i);
        for j in 0..self.nq {
            let k = i * self.nq + j;
            self.q[j] = path.q[k] + 0.5 * h * path.v[k] + 0.125 * h * h * path.a[k];
            self.v[j] = path.v[k] + 0.5 * h * path.a[k];
        }
    }

    fn error(&self, i: usize) -> MissingForceError {
        MissingForceError::Model {
            experiment: self.experiment.name.clone(),
            time: self.experiment.t[i] + 0.5 * self.h(i),
            q: Values(self.q.clone()),
            v: Values(self.v.clone()),
        }
    }

    /// w along a path.
    pub(super) fn force(&mut self, path: &mut Path) -> Result<(), MissingForceError> {
        let (nq, nu) = (self.nq, self.experiment.nu());
        for i in 0..path.w.len() / nq {
            self.middle(path, i);
            let row = i * nq..(i + 1) * nq;
            let at = At {
                q: &self.q,
                v: &self.v,
                a: &path.a[row.clone()],
                u: &self.u[i * nu..(i + 1) * nu],
                p: self.p,
            };
            self.model.residual(&at, &mut path.w[row.clone()]);
            if path.w[row].iter().any(|w| !w.is_finite()) {
                return Err(self.error(i));
            }
        }
        Ok(())
    }

    /// a as an affine function of (q, v, w) on every interval, at a path whose w is known.
    pub(super) fn linearise(&mut self, path: &Path) -> Result<Vec<Step>, MissingForceError> {
        let (nq, nu) = (self.nq, self.experiment.nu());
        let model = self.model;
        let pattern = model.jacobian_pattern();
        let mut out = Vec::with_capacity(path.w.len() / nq);
        let mut r = vec![0.0; nq];
        for i in 0..path.w.len() / nq {
            let h = self.h(i);
            self.middle(path, i);
            let row = i * nq..(i + 1) * nq;
            let at = At {
                q: &self.q,
                v: &self.v,
                a: &path.a[row.clone()],
                u: &self.u[i * nu..(i + 1) * nu],
                p: self.p,
            };
            model.residual_jacobian(&at, &mut r, &mut self.values);
            // ∂w/∂(q, v, a) of the states at the start of the interval.
            let (mut by_q, mut by_v, mut by_a) = (
                DMatrix::zeros(nq, nq),
                DMatrix::zeros(nq, nq),
                DMatrix::zeros(nq, nq),
            );
            for ((r, c), d) in pattern.rows.iter().zip(pattern.cols).zip(&self.values) {
                let (r, kind, j) = (*r as usize, *c as usize / nq, *c as usize % nq);
                match kind {
                    0 => {
                        by_q[(r, j)] += d;
                        by_v[(r, j)] += 0.5 * h * d;
                        by_a[(r, j)] += 0.125 * h * h * d;
                    }
                    1 => {
                        by_v[(r, j)] += d;
                        by_a[(r, j)] += 0.5 * h * d;
                    }
                    2 => by_a[(r, j)] += d,
                    _ => {}
                }
            }
            let inverse = by_a
                .try_inverse()
                .filter(|m: &DMatrix<f64>| m.iter().all(|x| x.is_finite()))
                .ok_or_else(|| self.error(i))?;
            let mut gain = DMatrix::zeros(nq, 3 * nq);
            gain.view_mut((0, 0), (nq, nq))
                .copy_from(&(-&inverse * by_q));
            gain.view_mut((0, nq), (nq, nq))
                .copy_from(&(-&inverse * by_v));
            gain.view_mut((0, 2 * nq), (nq, nq)).copy_from(&inverse);
            let state = DVector::from_fn(3 * nq, |k, _| match k / nq {
                0 => path.q[i * nq + k],
                1 => path.v[i * nq + k - nq],
                _ => path.w[i * nq + k - 2 * nq],
            });
            let offset = DVector::from_column_slice(&path.a[row]) - &gain * state;
            out.push(Step { h, offset, gain });
        }
        Ok(out)
    }

    /// The path of smoothed means, with w of the linearised model.
    pub(super) fn path(&self, steps: &[Step], s: &Smoothed) -> Path {
        let nq = self.nq;
        let part = |i: usize, k: usize| &s.mean[(3 * i + k) * nq..(3 * i + k + 1) * nq];
        let n = steps.len() + 1;
        let collect = |k: usize, n: usize| (0..n).flat_map(|i| part(i, k).to_vec()).collect();
        let a = steps
            .iter()
            .enumerate()
            .flat_map(|(i, step)| {
                let state = DVector::from_column_slice(&s.mean[3 * i * nq..3 * (i + 1) * nq]);
                let a = &step.offset + &step.gain * state;
                a.iter().copied().collect::<Vec<_>>()
            })
            .collect();
        Path {
            q: collect(0, n),
            v: collect(1, n),
            a,
            w: collect(2, n - 1),
        }
    }

    /// The objective, with the wide prior on the first state.
    fn cost(&self, path: &Path, noise: &Variances, prior: &Prior) -> f64 {
        let nq = self.nq;
        let mut sum = 0.0;
        for (i, y) in self.y.chunks_exact(2 * nq).enumerate() {
            for j in 0..nq {
                for (y, x, r) in [
                    (y[j], path.q[i * nq + j], noise.position[j]),
                    (y[nq + j], path.v[i * nq + j], noise.velocity[j]),
                ] {
                    if y.is_finite() {
                        sum += (y - x).powi(2) / r;
                    }
                }
            }
        }
        for i in 1..path.w.len() / nq {
            let h = self.h(i - 1);
            for j in 0..nq {
                let change = path.w[i * nq + j] - path.w[(i - 1) * nq + j];
                sum += change * change / (h * noise.drift[j]);
            }
        }
        for k in 0..3 * nq {
            let x = [&path.q, &path.v, &path.w][k / nq][k % nq];
            sum += (x - prior.mean[k]).powi(2) / prior.variance[k];
        }
        sum
    }

    /// Goes from `path` towards `next` as far as the objective falls. Returns whether it went the
    /// whole way and whether that way was short.
    pub(super) fn search(
        &mut self,
        path: &mut Path,
        next: Path,
        noise: &Variances,
        prior: &Prior,
    ) -> bool {
        let before = self.cost(path, noise, prior);
        let mut share = 1.0;
        while share >= SHORTEST {
            let mix = |a: &[f64], b: &[f64]| -> Vec<f64> {
                a.iter().zip(b).map(|(a, b)| a + share * (b - a)).collect()
            };
            let mut trial = Path {
                q: mix(&path.q, &next.q),
                v: mix(&path.v, &next.v),
                a: mix(&path.a, &next.a),
                w: vec![0.0; path.w.len()],
            };
            if self.force(&mut trial).is_ok() {
                let after = self.cost(&trial, noise, prior);
                if after <= before {
                    *path = trial;
                    return share == 1.0 && before - after < 1e-3 * before;
                }
                if after - before < 1e-9 * before {
                    return true;
                }
            }
            share *= 0.5;
        }
        false
    }

    /// Mean squares of the total force of each joint, f_L + w.
    fn total_forces(&mut self, path: &Path) -> Vec<f64> {
        let nq = self.nq;
        let n = path.w.len() / nq;
        let (mut f, mut sums) = (vec![0.0; nq], vec![0.0; nq]);
        for i in 0..n {
            self.middle(path, i);
            self.applied(path, i, &mut f);
            for j in 0..nq {
                sums[j] += (f[j] + path.w[i * nq + j]).powi(2) / n as f64;
            }
        }
        sums
    }

    /// f_L on interval i, whose middle was computed.
    fn applied(&self, path: &Path, i: usize, f: &mut [f64]) {
        let row = i * self.nq..(i + 1) * self.nq;
        let at = At {
            q: &self.q,
            v: &self.v,
            a: &path.a[row.clone()],
            u: self.input(i),
            p: self.p,
        };
        self.model.applied_force(&at, f);
    }

    /// Noise levels from differences, and the drift of the force along the filtered record.
    pub(super) fn first_levels(&mut self, path: &Path) -> Variances {
        let nq = self.nq;
        let t = &self.experiment.t;
        let duration = t[t.len() - 1] - t[0];
        for (j, total) in self.total_forces(path).into_iter().enumerate() {
            let floor = &mut self.floor[2 * nq + j];
            *floor = floor.max(STEADIEST * STEADIEST * total / duration);
        }
        let level = |channel: usize| {
            let known: Vec<f64> = self
                .y
                .iter()
                .skip(channel)
                .step_by(2 * nq)
                .copied()
                .filter(|y| y.is_finite())
                .collect();
            let sigma = noise_level_without_jumps(&known);
            let variance = if sigma.is_finite() {
                sigma * sigma
            } else {
                0.0
            };
            variance.max(self.floor[channel])
        };
        let drift = (0..nq)
            .map(|j| {
                let w: Vec<f64> = path.w.iter().skip(j).step_by(nq).copied().collect();
                let sum: f64 = w.windows(2).map(|w| (w[1] - w[0]).powi(2)).sum();
                let least = self.floor[2 * nq + j];
                match self.states.has(j) {
                    true => least,
                    false => (sum / duration).max(least),
                }
            })
            .collect();
        Variances {
            position: (0..nq).map(level).collect(),
            velocity: (nq..2 * nq).map(level).collect(),
            drift,
        }
    }

    /// Variance of the first state: wide enough to leave it to the record.
    pub(super) fn prior(&self, path: &Path, noise: &Variances) -> Prior {
        let nq = self.nq;
        let spread = |x: &[f64], j: usize| {
            let (count, sum) = x
                .iter()
                .skip(j)
                .step_by(nq)
                .fold((0.0, 0.0), |(n, s), x| (n + 1.0, s + x * x));
            sum / f64::max(count, 1.0)
        };
        let part = |k: usize| [&path.q, &path.v, &path.w][k / nq];
        Prior {
            mean: DVector::from_fn(
                3 * nq,
                |k, _| if k < 2 * nq { part(k)[k % nq] } else { 0.0 },
            ),
            variance: DVector::from_fn(3 * nq, |k, _| {
                let j = k % nq;
                let wide = spread(part(k), j);
                match k / nq {
                    0 => 100.0 * noise.position[j] + 1e-4 * wide,
                    1 => wide + 1e-6,
                    _ if self.states.has(j) => noise.drift[j] * self.h(0),
                    _ => 10.0 * wide + noise.drift[j] * self.h(0),
                }
            }),
        }
    }

    pub(super) fn estimate(
        &mut self,
        path: Path,
        s: &Smoothed,
        noise: Variances,
        settled: bool,
    ) -> MissingForceEstimate {
        let nq = self.nq;
        let n = path.w.len() / nq;
        let mut out = MissingForceEstimate {
            t: (0..n)
                .map(|i| self.experiment.t[i] + 0.5 * self.h(i))
                .collect(),
            q: Vec::with_capacity(n * nq),
            v: Vec::with_capacity(n * nq),
            band: Vec::with_capacity(n * nq),
            total: Vec::with_capacity(n * nq),
            w: Vec::new(),
            noise: NoiseLevels {
                position: noise.position.iter().map(|x| x.sqrt()).collect(),
                velocity: (0..nq)
                    .map(|j| {
                        let mut own = self.y.iter().skip(nq + j).step_by(2 * nq);
                        if own.any(|y| y.is_finite()) {
                            noise.velocity[j].sqrt()
                        } else {
                            f64::NAN
                        }
                    })
                    .collect(),
                drift: noise.drift.iter().map(|x| x.sqrt()).collect(),
            },
            settled,
        };
        let mut f = vec![0.0; nq];
        for i in 0..n {
            self.middle(&path, i);
            self.applied(&path, i, &mut f);
            for j in 0..nq {
                out.total.push(f[j] + path.w[i * nq + j]);
                let variance = s.variance[(3 * i + 2) * nq + j];
                out.band.push(2.0 * variance.sqrt());
            }
            out.q.extend_from_slice(&self.q);
            out.v.extend_from_slice(&self.v);
        }
        out.w = path.w;
        out
    }
}

/// How fast each noise level may move.
pub(super) struct Pace {
    power: Vec<f64>,
    last: Vec<f64>,
}

impl Pace {
    pub(super) fn new(nq: usize) -> Self {
        Pace {
            power: vec![1.0; 3 * nq],
            last: vec![0.0; 3 * nq],
        }
    }

    /// Moves the noise levels towards those that the smoothing found. Returns the largest
    /// logarithmic change.
    pub(super) fn hurry(
        &mut self,
        noise: &mut Variances,
        moments: &Variances,
        problem: &Problem<'_>,
    ) -> f64 {
        let nq = noise.drift.len();
        let mut most: f64 = 0.0;
        let settled = |k: usize| match k / nq {
            2 => problem.states.has(k % nq),
            _ => problem.states.unread.contains(&(k % nq)),
        };
        for k in (0..3 * nq).filter(|k| !settled(*k)) {
            let (old, new) = match k / nq {
                0 => (&mut noise.position, &moments.position),
                1 => (&mut noise.velocity, &moments.velocity),
                _ => (&mut noise.drift, &moments.drift),
            };
            let j = k % nq;
            let change = (new[j] / old[j]).ln().clamp(-3.0, 3.0);
            if !change.is_finite() {
                continue;
            }
            self.power[k] = match change * self.last[k] > 0.0 {
                true => (self.power[k] * HURRY).min(FASTEST),
                false => 1.0,
            };
            self.last[k] = change;
            let next =
                (old[j] * (self.power[k] * change).clamp(-3.0, 3.0).exp()).max(problem.floor[k]);
            most = most.max((next / old[j]).ln().abs());
            old[j] = next;
        }
        most
    }
}

/// Inputs as they act on each interval; missing ones are bridged by straight lines.
fn inputs_on_intervals(experiment: &Experiment, hold: InputHold) -> Vec<f64> {
    let (n, nu) = (experiment.len(), experiment.nu());
    let mut out = vec![0.0; (n - 1) * nu];
    for j in 0..nu {
        let mut channel = column(&experiment.u, nu, j);
        fill_missing(&experiment.t, &mut channel);
        for (i, pair) in channel.windows(2).enumerate() {
            out[i * nu + j] = match hold {
                InputHold::ZeroOrder => pair[0],
                InputHold::Linear => 0.5 * (pair[0] + pair[1]),
            };
        }
    }
    out
}
