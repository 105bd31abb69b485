//! The programs inside a step: the quadratic model, and the nearest point that satisfies the constraints.

use super::super::quasi_newton::Shared;
use crate::nlp::{Nlp, SparsePattern};
use crate::solver::kkt::{Kkt, KktError, KktValues, Regularisation};

/// Values of the model at a point, in the scaling of the method.
#[derive(Debug, Clone)]
pub(super) struct Model {
    pub(super) x: Vec<f64>,
    pub(super) f: f64,
    pub(super) c: Vec<f64>,
    pub(super) gradient: Vec<f64>,
    pub(super) jacobian: Vec<f64>,
    pub(super) hessian: Vec<f64>,
    /// Multiple of I on top of the Hessian.
    pub(super) shift: f64,
}

/// ```text
/// minimise    gᵀd + ½ dᵀ(H + δ I) d
/// subject to  c_lower ≤ c + J d ≤ c_upper,   lower ≤ x + d ≤ upper
/// ```
pub(super) struct Quadratic<'a> {
    pub(super) problem: &'a dyn Nlp,
    pub(super) model: &'a Model,
    /// Constants of the rows: c, or those of a second-order correction.
    pub(super) constant: &'a [f64],
    /// B in place of the stored Hessian.
    pub(super) memory: Option<&'a Shared>,
}

impl Quadratic<'_> {
    /// (H + δ I) d.
    fn curve(&self, d: &[f64]) -> Vec<f64> {
        if let Some(memory) = self.memory {
            return memory.multiply(d);
        }
        let mut out: Vec<f64> = d.iter().map(|d| self.model.shift * d).collect();
        let pattern = self.problem.hessian_pattern();
        pattern.symmetric_multiply_add(&self.model.hessian, d, &mut out);
        out
    }
}

impl Nlp for Quadratic<'_> {
    fn n(&self) -> usize {
        self.problem.n()
    }
    fn m(&self) -> usize {
        self.problem.m()
    }
    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        self.problem.bounds(lower, upper);
        for bounds in [lower, upper] {
            bounds
                .iter_mut()
                .zip(&self.model.x)
                .for_each(|(b, x)| *b -= x);
        }
    }
    fn constraint_bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        self.problem.constraint_bounds(lower, upper);
    }
    fn objective(&mut self, d: &[f64]) -> f64 {
        let curve = self.curve(d);
        let terms = d.iter().zip(&self.model.gradient).zip(&curve);
        terms.map(|((d, g), b)| d * (g + 0.5 * b)).sum()
    }
    fn gradient(&mut self, d: &[f64], gradient: &mut [f64]) {
        let curve = self.curve(d);
        for ((out, g), b) in gradient.iter_mut().zip(&self.model.gradient).zip(&curve) {
            *out = g + b;
        }
    }
    fn constraints(&mut self, d: &[f64], c: &mut [f64]) {
        c.copy_from_slice(self.constant);
        let pattern = self.problem.jacobian_pattern();
        pattern.multiply_add(&self.model.jacobian, d, c);
    }
    fn jacobian_pattern(&self) -> &SparsePattern {
        self.problem.jacobian_pattern()
    }
    fn jacobian(&mut self, _: &[f64], values: &mut [f64]) {
        values.copy_from_slice(&self.model.jacobian);
    }
    fn hessian_pattern(&self) -> &SparsePattern {
        self.problem.hessian_pattern()
    }
    fn hessian(&mut self, _: &[f64], sigma: f64, _: &[f64], values: &mut [f64]) {
        if sigma == 0.0 {
            values.fill(0.0);
        } else {
            // The sign of a zero tells a quasi-Newton system to take its memory in.
            values.copy_from_slice(&self.model.hessian);
        }
    }
}

/// Adds a multiple of I to the Hessian of any linear system.
pub(super) struct Shifted<'a> {
    pub(super) inner: &'a mut dyn Kkt,
    pub(super) shift: f64,
    pub(super) sigma: Vec<f64>,
}

impl Kkt for Shifted<'_> {
    fn expect_error(&mut self, error: f64) {
        self.inner.expect_error(error);
    }

    fn factorise(&mut self, values: KktValues<'_>) -> Result<Regularisation, KktError> {
        if self.shift == 0.0 {
            return self.inner.factorise(values);
        }
        self.sigma.clear();
        self.sigma
            .extend(values.sigma.iter().map(|s| s + self.shift));
        self.inner.factorise(KktValues {
            sigma: &self.sigma,
            ..values
        })
    }
    fn relaxable(&self) -> bool {
        self.inner.relaxable()
    }
    fn relax(&mut self, diagonal: &[f64]) {
        self.inner.relax(diagonal);
    }
    fn solve(&mut self, rx: &[f64], rc: &[f64], dx: &mut [f64], dlambda: &mut [f64]) -> f64 {
        self.inner.solve(rx, rc, dx, dlambda)
    }
}

/// ```text
/// minimise    ½ ζ ‖x − x_R‖²
/// subject to  the constraints and bounds of a problem
/// ```
///
/// The linear system takes ζ I in through [`Shifted`].
pub(super) struct Nearest<'a> {
    pub(super) problem: &'a mut dyn Nlp,
    pub(super) from: Vec<f64>,
    pub(super) zeta: f64,
}

impl Nlp for Nearest<'_> {
    fn n(&self) -> usize {
        self.problem.n()
    }
    fn m(&self) -> usize {
        self.problem.m()
    }
    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        self.problem.bounds(lower, upper);
    }
    fn constraint_bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        self.problem.constraint_bounds(lower, upper);
    }
    fn objective(&mut self, x: &[f64]) -> f64 {
        let squares = x.iter().zip(&self.from).map(|(x, r)| (x - r) * (x - r));
        0.5 * self.zeta * squares.sum::<f64>()
    }
    fn gradient(&mut self, x: &[f64], gradient: &mut [f64]) {
        for ((g, x), r) in gradient.iter_mut().zip(x).zip(&self.from) {
            *g = self.zeta * (x - r);
        }
    }
    fn constraints(&mut self, x: &[f64], c: &mut [f64]) {
        self.problem.constraints(x, c);
    }
    fn jacobian_pattern(&self) -> &SparsePattern {
        self.problem.jacobian_pattern()
    }
    fn jacobian(&mut self, x: &[f64], values: &mut [f64]) {
        self.problem.jacobian(x, values);
    }
    fn hessian_pattern(&self) -> &SparsePattern {
        self.problem.hessian_pattern()
    }
    fn hessian(&mut self, x: &[f64], _: f64, lambda: &[f64], values: &mut [f64]) {
        self.problem.hessian(x, 0.0, lambda, values);
    }
}
