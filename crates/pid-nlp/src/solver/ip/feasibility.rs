//! The problem of a restoration phase and its linear system.
//!
//! ```text
//! min  ρ Σ (p + n) + ζ/2 ‖D (x − x_R)‖²   s.t.  c(x) − p + n = 0,  p, n ≥ 0,  x in its bounds
//! ```
//!
//! (A. Wächter, L. T. Biegler 2006, section 3.3; ζ = √μ.) p and n are eliminated before the linear
//! system: they relax the rows by `Σ_p⁻¹ + Σ_n⁻¹`.

use super::iterate::Iterate;
use super::program::Program;
use crate::nlp::{Nlp, SparsePattern};
use crate::solver::kkt::{Kkt, KktError, KktValues, Regularisation};

/// Weight ρ of the violation.
pub(super) const RHO: f64 = 1000.0;

/// The feasibility problem.
pub(super) struct Feasibility<'a> {
    inner: &'a mut dyn Program,
    n: usize,
    m: usize,
    reference: Vec<f64>,
    /// D².
    metric: Vec<f64>,
    zeta: f64,
    hessian: SparsePattern,
    jacobian: SparsePattern,
    inner_hessian: usize,
}

impl<'a> Feasibility<'a> {
    pub(super) fn new(inner: &'a mut dyn Program, reference: &[f64], mu: f64) -> Self {
        let (n, m) = (inner.n(), inner.m());
        let (mut hessian, mut jacobian) = (
            inner.hessian_pattern().clone(),
            inner.jacobian_pattern().clone(),
        );
        let inner_hessian = hessian.nnz();
        (0..n).for_each(|j| hessian.push(j, j));
        (0..m).for_each(|i| jacobian.push(i, n + i));
        (0..m).for_each(|i| jacobian.push(i, n + m + i));
        let metric = reference.iter().map(|x| x.abs().max(1.0).powi(-2));
        Self {
            n,
            m,
            metric: metric.collect(),
            reference: reference.to_vec(),
            zeta: mu.sqrt(),
            hessian,
            jacobian,
            inner_hessian,
            inner,
        }
    }

    /// The p and n that close c(x) − p + n = 0 and minimise ρ(p + n) − μ ln p − μ ln n.
    pub(super) fn split(c: f64, mu: f64) -> (f64, f64) {
        if c < 0.0 {
            let (n, p) = Self::split(-c, mu);
            return (p, n);
        }
        // The positive root of n² − 2 a n − b = 0, without cancellation.
        let (a, b) = ((mu - RHO * c) / (2.0 * RHO), mu * c / (2.0 * RHO));
        let root = (a * a + b).sqrt();
        let n = if a >= 0.0 { a + root } else { b / (root - a) };
        (c + n, n)
    }
}

impl Nlp for Feasibility<'_> {
    fn n(&self) -> usize {
        self.n + 2 * self.m
    }

    fn m(&self) -> usize {
        self.m
    }

    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        self.inner
            .bounds(&mut lower[..self.n], &mut upper[..self.n]);
        lower[self.n..].fill(0.0);
        upper[self.n..].fill(f64::INFINITY);
    }

    fn objective(&mut self, x: &[f64]) -> f64 {
        let violation: f64 = x[self.n..].iter().sum();
        let mut away = 0.0;
        for j in 0..self.n {
            let d = x[j] - self.reference[j];
            away += self.metric[j] * d * d;
        }
        RHO * violation + 0.5 * self.zeta * away
    }

    fn gradient(&mut self, x: &[f64], gradient: &mut [f64]) {
        for j in 0..self.n {
            gradient[j] = self.zeta * self.metric[j] * (x[j] - self.reference[j]);
        }
        gradient[self.n..].fill(RHO);
    }

    fn constraints(&mut self, x: &[f64], c: &mut [f64]) {
        let (n, m) = (self.n, self.m);
        self.inner.constraints(&x[..n], c);
        for (i, c) in c.iter_mut().enumerate() {
            *c += x[n + m + i] - x[n + i];
        }
    }

    fn jacobian_pattern(&self) -> &SparsePattern {
        &self.jacobian
    }

    fn jacobian(&mut self, x: &[f64], values: &mut [f64]) {
        let (inner, slacks) = values.split_at_mut(values.len() - 2 * self.m);
        self.inner.jacobian(&x[..self.n], inner);
        slacks[..self.m].fill(-1.0);
        slacks[self.m..].fill(1.0);
    }

    fn hessian_pattern(&self) -> &SparsePattern {
        &self.hessian
    }

    fn hessian(&mut self, x: &[f64], sigma: f64, lambda: &[f64], values: &mut [f64]) {
        let (inner, diagonal) = values.split_at_mut(self.inner_hessian);
        self.inner.hessian(&x[..self.n], 0.0, lambda, inner);
        for (v, metric) in diagonal.iter_mut().zip(&self.metric) {
            *v = sigma * self.zeta * metric;
        }
    }

    fn barrier_changed(&mut self, mu: f64) -> bool {
        self.zeta = mu.sqrt();
        true
    }

    fn longest_step(&self, x: &[f64], d: &[f64], share: f64) -> f64 {
        self.inner.longest_step(&x[..self.n], &d[..self.n], share)
    }
}

impl Program for Feasibility<'_> {
    fn visible(&self) -> usize {
        self.inner.visible()
    }

    fn close(&mut self, x: &mut [f64], c: &[f64], mu: f64) -> bool {
        let (n, m) = (self.n, self.m);
        for (i, c) in c.iter().enumerate() {
            let own = c + x[n + i] - x[n + m + i];
            (x[n + i], x[n + m + i]) = Self::split(own, mu);
        }
        true
    }

    fn probe(&mut self, x: &[f64], out: &mut Iterate) {
        out.x.copy_from_slice(&x[..self.n]);
        out.f = self.inner.objective(&out.x);
        self.inner.constraints(&out.x, &mut out.c);
        out.theta = out.c.iter().map(|c| c.abs()).sum();
    }
}

/// The linear system of a [`Feasibility`] problem, by that of the original problem.
pub(super) struct FeasibilityKkt<'a> {
    inner: &'a mut dyn Kkt,
    n: usize,
    m: usize,
    inner_hessian: usize,
    sigma: Vec<f64>,
    slack_sigma: Vec<f64>,
    outer: Vec<f64>,
    relaxation: Vec<f64>,
    rc: Vec<f64>,
}

impl<'a> FeasibilityKkt<'a> {
    pub(super) fn new(inner: &'a mut dyn Kkt, problem: &Feasibility<'_>) -> Self {
        let (n, m) = (problem.n, problem.m);
        Self {
            inner,
            n,
            m,
            inner_hessian: problem.inner_hessian,
            sigma: vec![0.0; n],
            slack_sigma: vec![0.0; 2 * m],
            outer: Vec::new(),
            relaxation: vec![0.0; m],
            rc: vec![0.0; m],
        }
    }
}

impl Kkt for FeasibilityKkt<'_> {
    fn factorise(&mut self, values: KktValues<'_>) -> Result<Regularisation, KktError> {
        let (n, m) = (self.n, self.m);
        let (hessian, diagonal) = values.hessian.split_at(self.inner_hessian);
        for j in 0..n {
            self.sigma[j] = values.sigma[j] + diagonal[j];
        }
        for (own, sigma) in self.slack_sigma.iter_mut().zip(&values.sigma[n..]) {
            *own = sigma.max(1e-20);
        }
        for i in 0..m {
            let outer = self.outer.get(i).copied().unwrap_or(0.0);
            self.relaxation[i] = outer + 1.0 / self.slack_sigma[i] + 1.0 / self.slack_sigma[m + i];
        }
        self.inner.relax(&self.relaxation);
        self.inner.factorise(KktValues {
            hessian,
            jacobian: &values.jacobian[..values.jacobian.len() - 2 * m],
            sigma: &self.sigma,
        })
    }

    fn relaxable(&self) -> bool {
        true
    }

    fn relax(&mut self, diagonal: &[f64]) {
        self.outer.clear();
        self.outer.extend_from_slice(diagonal);
    }

    fn solve(&mut self, rx: &[f64], rc: &[f64], dx: &mut [f64], dlambda: &mut [f64]) -> f64 {
        let (n, m) = (self.n, self.m);
        for i in 0..m {
            self.rc[i] =
                rc[i] + rx[n + i] / self.slack_sigma[i] - rx[n + m + i] / self.slack_sigma[m + i];
        }
        let (own, slacks) = dx.split_at_mut(n);
        let residual = self.inner.solve(&rx[..n], &self.rc, own, dlambda);
        for i in 0..m {
            slacks[i] = (rx[n + i] + dlambda[i]) / self.slack_sigma[i];
            slacks[m + i] = (rx[n + m + i] - dlambda[i]) / self.slack_sigma[m + i];
        }
        residual
    }
}
