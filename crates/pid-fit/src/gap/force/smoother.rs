//! Fixed-interval smoothing of a mechanical chain of integrators driven by an unknown force.
//!
//! ```text
//! a_i = c_i + A_i (q_i, v_i, w_i)                                the model, linearised
//! q_{i+1} = q_i + h v_i + h²/2 a_i,   v_{i+1} = v_i + h a_i      kinematics, exact
//! w_{i+1} = w_i + n_i,                n_i ~ N(0, S h_i)          the unknown force drifts
//! y_i     = (q_i, v_i) + e_i,         e_i ~ N(0, R)              what was measured
//! ```
//!
//! A Kalman filter with one scalar update per measurement, and the backward recursion of A. Bryson
//! and M. Frazier, Smoothing for Linear and Nonlinear Dynamic Systems, 1963, in the form that
//! inverts no covariance (adjoint λ and its variance Λ). The moments of n and e it returns are
//! those of the E-step of R. Shumway and D. Stoffer, An Approach to Time Series Smoothing and
//! Forecasting Using the EM Algorithm, 1982.

use nalgebra::{DMatrix, DVector};

/// One interval of the linearised model.
#[derive(Debug, Clone)]
pub(super) struct Step {
    /// Length, s.
    pub(super) h: f64,
    /// c; nq.
    pub(super) offset: DVector<f64>,
    /// A; nq × 3 nq.
    pub(super) gain: DMatrix<f64>,
}

impl Step {
    /// x ← F x, column by column.
    fn apply(&self, x: &mut DMatrix<f64>, product: &mut DMatrix<f64>) {
        let (nq, h) = (self.gain.nrows(), self.h);
        product.gemm(1.0, &self.gain, x, 0.0);
        for (mut column, a) in x.column_iter_mut().zip(product.column_iter()) {
            for j in 0..nq {
                column[j] += h * column[nq + j] + 0.5 * h * h * a[j];
                column[nq + j] += h * a[j];
            }
        }
    }

    /// x ← Fᵀ x, column by column.
    fn apply_transposed(&self, x: &mut DMatrix<f64>, product: &mut DMatrix<f64>) {
        let (nq, h) = (self.gain.nrows(), self.h);
        for (mut column, mut a) in x.column_iter_mut().zip(product.column_iter_mut()) {
            for j in 0..nq {
                a[j] = 0.5 * h * h * column[j] + h * column[nq + j];
                column[nq + j] += h * column[j];
            }
        }
        x.gemm_tr(1.0, &self.gain, product, 1.0);
    }
}

/// Variances of the noises, one per joint. A channel that was not measured has its samples missing.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Variances {
    /// R of positions, rad² or m².
    pub(super) position: Vec<f64>,
    /// R of velocities.
    pub(super) velocity: Vec<f64>,
    /// S: growth of the variance of w per second.
    pub(super) drift: Vec<f64>,
}

/// Distribution of the first state (q, v, w) before any measurement: independent, wide.
#[derive(Debug, Clone)]
pub(super) struct Prior {
    /// Mean; 3 nq.
    pub(super) mean: DVector<f64>,
    /// Variances; 3 nq.
    pub(super) variance: DVector<f64>,
}

/// Posterior of the states; all N × 3 nq row by row, (q, v, w).
#[derive(Debug, Clone)]
pub(super) struct Smoothed {
    /// Means.
    pub(super) mean: Vec<f64>,
    /// Variances.
    pub(super) variance: Vec<f64>,
    /// Posterior mean squares of e and n: the next R and S of expectation maximisation. A joint
    /// without samples keeps its last ones.
    pub(super) moments: Variances,
}

/// One scalar update, kept for the backward pass.
struct Update {
    channel: usize,
    innovation: f64,
    variance: f64,
}

/// The filter's way through the samples.
struct Filtered {
    /// Predicted mean and covariance of every sample.
    predicted: Vec<(DVector<f64>, DMatrix<f64>)>,
    /// The updates that followed, and their gains, 3 nq each.
    updates: Vec<Update>,
    gains: Vec<f64>,
    /// Number of updates up to the end of every sample.
    ends: Vec<usize>,
}

/// The forward pass.
fn filter(steps: &[Step], y: &[f64], noise: &Variances, prior: &Prior) -> Filtered {
    let nq = noise.drift.len();
    let (m, n) = (3 * nq, steps.len() + 1);
    let measured = |k: usize| {
        if k < nq {
            noise.position[k]
        } else {
            noise.velocity[k - nq]
        }
    };
    let mut mean = prior.mean.clone();
    let mut p = DMatrix::from_diagonal(&prior.variance);
    let mut product = DMatrix::zeros(nq, m);
    let mut predicted: Vec<(DVector<f64>, DMatrix<f64>)> = Vec::with_capacity(n);
    let mut updates: Vec<Update> = Vec::new();
    let mut gains: Vec<f64> = Vec::new();
    let mut ends = Vec::with_capacity(n);
    for i in 0..n {
        predicted.push((mean.clone(), p.clone()));
        for channel in 0..2 * nq {
            let value = y[i * 2 * nq + channel];
            if !value.is_finite() {
                continue;
            }
            let variance = p[(channel, channel)] + measured(channel);
            let innovation = value - mean[channel];
            let start = gains.len();
            gains.extend(p.column(channel).iter().map(|x| x / variance));
            let k = &gains[start..];
            for (x, k) in mean.iter_mut().zip(k) {
                *x += k * innovation;
            }
            for c in 0..m {
                for r in 0..m {
                    p[(r, c)] -= k[r] * k[c] * variance;
                }
            }
            updates.push(Update {
                channel,
                innovation,
                variance,
            });
        }
        ends.push(updates.len());
        if let Some(step) = steps.get(i) {
            let a = &step.offset + &step.gain * &mean;
            for j in 0..nq {
                mean[j] += step.h * mean[nq + j] + 0.5 * step.h * step.h * a[j];
                mean[nq + j] += step.h * a[j];
            }
            step.apply(&mut p, &mut product);
            p.transpose_mut();
            step.apply(&mut p, &mut product);
            for j in 0..nq {
                p[(2 * nq + j, 2 * nq + j)] += step.h * noise.drift[j];
            }
            symmetrise(&mut p);
        }
    }
    Filtered {
        predicted,
        updates,
        gains,
        ends,
    }
}

/// The adjoint of a prediction and its variance.
struct Adjoint {
    /// λ; 3 nq × 1.
    mean: DMatrix<f64>,
    /// Λ; 3 nq × 3 nq.
    spread: DMatrix<f64>,
    /// Room for products.
    single: DMatrix<f64>,
    product: DMatrix<f64>,
    columns: DVector<f64>,
}

impl Adjoint {
    /// After the last sample, which nothing follows.
    fn last(nq: usize) -> Self {
        let m = 3 * nq;
        Self {
            mean: DMatrix::zeros(m, 1),
            spread: DMatrix::zeros(m, m),
            single: DMatrix::zeros(nq, 1),
            product: DMatrix::zeros(nq, m),
            columns: DVector::zeros(m),
        }
    }

    /// Back over a step.
    fn step(&mut self, step: &Step) {
        step.apply_transposed(&mut self.mean, &mut self.single);
        step.apply_transposed(&mut self.spread, &mut self.product);
        self.spread.transpose_mut();
        step.apply_transposed(&mut self.spread, &mut self.product);
        symmetrise(&mut self.spread);
    }

    /// Back over an update with the gain `k`:
    /// λ ← (I − k h')' λ − h e / s,   Λ ← (I − k h')' Λ (I − k h') + h h' / s
    fn update(&mut self, update: &Update, k: &[f64]) {
        let Update {
            channel,
            innovation,
            variance,
        } = *update;
        let (adjoint, spread) = (&mut self.mean, &mut self.spread);
        let along: f64 = k.iter().zip(adjoint.iter()).map(|(k, l)| k * l).sum();
        adjoint[channel] -= along + innovation / variance;
        for (c, x) in self.columns.iter_mut().enumerate() {
            *x = spread.column(c).iter().zip(k).map(|(s, k)| s * k).sum();
        }
        let twice: f64 = self.columns.iter().zip(k).map(|(c, k)| c * k).sum();
        for (c, x) in self.columns.iter().enumerate() {
            spread[(channel, c)] -= x;
            spread[(c, channel)] -= x;
        }
        spread[(channel, channel)] += twice + 1.0 / variance;
    }
}

/// Smooths. `y` is N × 2 nq row by row, NaN where nothing was measured; one step less than samples.
pub(super) fn smooth(steps: &[Step], y: &[f64], noise: &Variances, prior: &Prior) -> Smoothed {
    let nq = noise.drift.len();
    let (m, n) = (3 * nq, steps.len() + 1);
    let Filtered {
        predicted,
        updates,
        gains,
        ends,
    } = filter(steps, y, noise, prior);
    let mut out = Smoothed {
        mean: vec![0.0; n * m],
        variance: vec![0.0; n * m],
        moments: noise.clone(),
    };
    let mut sums = Sums::new(nq);
    let mut adjoint = Adjoint::last(nq);
    let mut product_p = DMatrix::zeros(m, m);
    for i in (0..n).rev() {
        if let Some(step) = steps.get(i) {
            adjoint.step(step);
        }
        let first = if i > 0 { ends[i - 1] } else { 0 };
        for u in (first..ends[i]).rev() {
            adjoint.update(&updates[u], &gains[u * m..(u + 1) * m]);
        }
        let (x, p) = &predicted[i];
        product_p.gemm(1.0, p, &adjoint.spread, 0.0);
        for r in 0..m {
            let (mut shift, mut gain) = (0.0, 0.0);
            for c in 0..m {
                shift += p[(r, c)] * adjoint.mean[c];
                gain += product_p[(r, c)] * p[(r, c)];
            }
            out.mean[i * m + r] = x[r] - shift;
            out.variance[i * m + r] = (p[(r, r)] - gain).max(0.0);
        }
        for channel in 0..2 * nq {
            let e = y[i * 2 * nq + channel] - out.mean[i * m + channel];
            if e.is_finite() {
                sums.measured(channel, e * e + out.variance[i * m + channel]);
            }
        }
        if i > 0 {
            let h = steps[i - 1].h;
            for j in 0..nq {
                let (k, q) = (2 * nq + j, h * noise.drift[j]);
                let n = -q * adjoint.mean[k];
                sums.drift(j, (n * n + q - q * q * adjoint.spread[(k, k)]) / h);
            }
        }
    }
    sums.means(&mut out.moments);
    out
}

/// Takes the mean of both triangles, so that rounding does not drive them apart.
fn symmetrise(p: &mut DMatrix<f64>) {
    for c in 0..p.ncols() {
        for r in c + 1..p.nrows() {
            let x = 0.5 * (p[(r, c)] + p[(c, r)]);
            p[(r, c)] = x;
            p[(c, r)] = x;
        }
    }
}

/// Sums and counts per channel (q, v, w).
struct Sums(Vec<(f64, usize)>);

impl Sums {
    fn new(nq: usize) -> Self {
        Sums(vec![(0.0, 0); 3 * nq])
    }
    fn measured(&mut self, channel: usize, square: f64) {
        self.0[channel].0 += square;
        self.0[channel].1 += 1;
    }
    fn drift(&mut self, joint: usize, square: f64) {
        let k = self.0.len() / 3 * 2 + joint;
        self.measured(k, square);
    }
    fn means(&self, out: &mut Variances) {
        let nq = self.0.len() / 3;
        for (k, (sum, count)) in self.0.iter().enumerate() {
            if *count > 0 {
                let part = match k / nq {
                    0 => &mut out.position,
                    1 => &mut out.velocity,
                    _ => &mut out.drift,
                };
                part[k % nq] = sum / *count as f64;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A small chain with made-up numbers, one sample missing.
    fn chain() -> (Vec<Step>, Vec<f64>, Variances, Prior) {
        let wave = |k: usize| (1.7 * k as f64 + 0.3).sin();
        let steps = (0..6)
            .map(|i| Step {
                h: 0.1 + 0.02 * i as f64,
                offset: DVector::from_fn(2, |r, _| wave(i + r)),
                gain: DMatrix::from_fn(2, 6, |r, c| wave(7 * i + 2 * r + c)),
            })
            .collect();
        let mut y: Vec<f64> = (0..7 * 4).map(|k| 0.4 * wave(3 * k)).collect();
        y[5] = f64::NAN;
        y[18] = f64::NAN;
        let noise = Variances {
            position: vec![0.01, 0.02],
            velocity: vec![0.3, 0.1],
            drift: vec![0.5, 2.0],
        };
        let prior = Prior {
            mean: DVector::from_fn(6, |k, _| 0.1 * wave(k)),
            variance: DVector::from_fn(6, |k, _| 1.0 + k as f64),
        };
        (steps, y, noise, prior)
    }

    /// The same posterior from the normal equations of all noises at once: x = G ξ + g with ξ =
    /// (x_0, n_0 …), dense.
    #[test]
    fn means_variances_and_moments_equal_those_of_dense_least_squares() {
        let (steps, y, noise, prior) = chain();
        let (nq, m, n) = (2, 6, 7);
        let unknowns = m + nq * (n - 1);
        let mut g = vec![DMatrix::zeros(m, unknowns)];
        g[0].view_mut((0, 0), (m, m)).fill_with_identity();
        let mut c = vec![DVector::zeros(m)];
        for (i, s) in steps.iter().enumerate() {
            let mut f = DMatrix::identity(m, m);
            let mut b = DMatrix::zeros(m, nq);
            for j in 0..nq {
                f[(j, nq + j)] = s.h;
                b[(j, j)] = 0.5 * s.h * s.h;
                b[(nq + j, j)] = s.h;
            }
            f += &b * &s.gain;
            let mut next = &f * &g[i];
            for j in 0..nq {
                next[(2 * nq + j, m + nq * i + j)] = 1.0;
            }
            c.push(&f * &c[i] + &b * &s.offset);
            g.push(next);
        }
        let mut information = DMatrix::zeros(unknowns, unknowns);
        let mut rhs = DVector::zeros(unknowns);
        for k in 0..m {
            information[(k, k)] += 1.0 / prior.variance[k];
            rhs[k] += prior.mean[k] / prior.variance[k];
        }
        for (i, s) in steps.iter().enumerate() {
            for j in 0..nq {
                let k = m + nq * i + j;
                information[(k, k)] += 1.0 / (s.h * noise.drift[j]);
            }
        }
        let r = [0.01, 0.02, 0.3, 0.1];
        for i in 0..n {
            for k in 0..4 {
                let value: f64 = y[4 * i + k];
                if value.is_finite() {
                    let row = g[i].row(k);
                    information += row.transpose() * row / r[k];
                    rhs += row.transpose() * ((value - c[i][k]) / r[k]);
                }
            }
        }
        let covariance = information.try_inverse().unwrap();
        let xi = &covariance * rhs;

        let s = smooth(&steps, &y, &noise, &prior);
        let mut squares = [0.0; 4];
        for i in 0..n {
            let mean = &g[i] * &xi + &c[i];
            let variance = &g[i] * &covariance * g[i].transpose();
            for k in 0..m {
                assert!((s.mean[i * m + k] - mean[k]).abs() < 1e-10);
                assert!((s.variance[i * m + k] - variance[(k, k)]).abs() < 1e-10);
            }
            for k in 0..4 {
                let e: f64 = y[4 * i + k] - mean[k];
                if e.is_finite() {
                    squares[k] += e * e + variance[(k, k)];
                }
            }
        }
        for j in 0..nq {
            // One sample of q1 and one of v2 is missing.
            let count = |k: usize| (0..n).filter(|i| y[4 * i + k].is_finite()).count() as f64;
            assert!((s.moments.position[j] - squares[j] / count(j)).abs() < 1e-10);
            assert!((s.moments.velocity[j] - squares[nq + j] / count(nq + j)).abs() < 1e-10);
            let drift: f64 = steps
                .iter()
                .enumerate()
                .map(|(i, s)| {
                    let k = m + nq * i + j;
                    (xi[k] * xi[k] + covariance[(k, k)]) / s.h
                })
                .sum();
            assert!((s.moments.drift[j] - drift / steps.len() as f64).abs() < 1e-10);
        }
    }
}
