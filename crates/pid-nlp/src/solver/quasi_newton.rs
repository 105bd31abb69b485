//! Quasi-Newton Hessians for any program and any linear system: damped BFGS in compact form.
//!
//! ```text
//! B = δ I − W M⁻¹ Wᵀ,   W = [δ S  Y],   M = [ δ SᵀS   L ]
//!                                          [ Lᵀ     −D ]
//! ```
//!
//! (R. H. Byrd, J. Nocedal, R. B. Schnabel, Math. Program. 63 (1994), theorem 2.3), from the last
//! steps s and changes y of the Lagrangian's gradient at fixed multipliers. With Powell's damping
//! (Math. Program. 14 (1978)) B stays positive definite. The linear system keeps its structure: it
//! is factorised with δ I in place of the Hessian, and the part of low rank follows by Sherman,
//! Morrison and Woodbury. A memory as long as the solve makes it the full BFGS matrix.

use super::ip::{self, Callback};
use super::kkt::{Kkt, KktError, KktValues, Regularisation};
use super::outcome::Solution;
use super::settings::Settings;
use crate::nlp::{Nlp, SparsePattern};
use nalgebra::{DMatrix, DVector};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Damping begins where sᵀy falls below this share of sᵀBs.
const DAMPING: f64 = 0.2;
/// Bounds on δ.
const SMALLEST: f64 = 1e-8;
const LARGEST: f64 = 1e8;
/// A step below this relative length carries no curvature.
const NO_STEP: f64 = 1e-14;

/// Pairs of steps and gradient changes.
#[derive(Debug)]
struct Memory {
    capacity: usize,
    delta: f64,
    s: VecDeque<Vec<f64>>,
    y: VecDeque<Vec<f64>>,
    /// Products sᵢᵀsⱼ and sᵢᵀyⱼ, row i by row.
    ss: VecDeque<VecDeque<f64>>,
    sy: VecDeque<VecDeque<f64>>,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Memory {
    fn new(capacity: usize) -> Self {
        Self {
            capacity: capacity.max(1),
            delta: 1.0,
            s: VecDeque::new(),
            y: VecDeque::new(),
            ss: VecDeque::new(),
            sy: VecDeque::new(),
        }
    }

    fn clear(&mut self) {
        self.s.clear();
        self.y.clear();
        self.ss.clear();
        self.sy.clear();
    }

    fn forget_oldest(&mut self) {
        self.s.pop_front();
        self.y.pop_front();
        for products in [&mut self.ss, &mut self.sy] {
            products.pop_front();
            for row in products {
                row.pop_front();
            }
        }
    }

    fn remember(&mut self, s: Vec<f64>, y: Vec<f64>) {
        let with = |list: &VecDeque<Vec<f64>>, v: &[f64]| -> VecDeque<f64> {
            list.iter().map(|l| dot(l, v)).collect()
        };
        let (old_ss, old_sy) = (with(&self.s, &s), with(&self.s, &y));
        let (mut row_ss, mut row_sy) = (old_ss.clone(), with(&self.y, &s));
        row_ss.push_back(dot(&s, &s));
        row_sy.push_back(dot(&s, &y));
        for (row, v) in self.ss.iter_mut().zip(old_ss) {
            row.push_back(v);
        }
        for (row, v) in self.sy.iter_mut().zip(old_sy) {
            row.push_back(v);
        }
        self.ss.push_back(row_ss);
        self.sy.push_back(row_sy);
        self.s.push_back(s);
        self.y.push_back(y);
    }

    /// Columns of W.
    fn columns(&self) -> Vec<Vec<f64>> {
        let scaled = |s: &Vec<f64>| s.iter().map(|s| self.delta * s).collect();
        let first = self.s.iter().map(scaled);
        first.chain(self.y.iter().cloned()).collect()
    }

    /// The matrix M.
    fn middle(&self) -> DMatrix<f64> {
        let k = self.s.len();
        let mut m = DMatrix::zeros(2 * k, 2 * k);
        for i in 0..k {
            for j in 0..k {
                m[(i, j)] = self.delta * self.ss[i][j];
                if i > j {
                    let l = self.sy[i][j];
                    m[(i, k + j)] = l;
                    m[(k + j, i)] = l;
                }
            }
            m[(k + i, k + i)] = -self.sy[i][i];
        }
        m
    }

    /// B x; `None` if M is singular.
    fn multiply(&self, x: &[f64]) -> Option<Vec<f64>> {
        let mut out: Vec<f64> = x.iter().map(|x| self.delta * x).collect();
        if self.s.is_empty() {
            return Some(out);
        }
        let w = self.columns();
        let right = DVector::from_iterator(w.len(), w.iter().map(|w| dot(w, x)));
        let t = self.middle().lu().solve(&right)?;
        for (w, t) in w.iter().zip(t.iter()) {
            for (o, w) in out.iter_mut().zip(w) {
                *o -= t * w;
            }
        }
        Some(out)
    }

    fn update(&mut self, s: Vec<f64>, mut y: Vec<f64>) {
        let length = dot(&s, &s);
        if length == 0.0 || !length.is_finite() || !dot(&y, &y).is_finite() {
            return;
        }
        let Some(bs) = self.multiply(&s) else {
            self.clear();
            return;
        };
        let (curvature, model) = (dot(&s, &y), dot(&s, &bs));
        if curvature < DAMPING * model {
            let theta = (1.0 - DAMPING) * model / (model - curvature);
            for (y, b) in y.iter_mut().zip(&bs) {
                *y = theta * *y + (1.0 - theta) * b;
            }
        }
        let product = dot(&s, &y);
        if product <= 1e-12 * (length * dot(&y, &y)).sqrt() || product.is_nan() {
            return;
        }
        if self.s.len() == self.capacity {
            self.forget_oldest();
        }
        self.delta = (dot(&y, &y) / product).clamp(SMALLEST, LARGEST);
        self.remember(s, y);
    }
}

/// Shared by the program and its linear system.
#[derive(Debug, Clone)]
pub(super) struct Shared(Arc<Mutex<Memory>>);

impl Shared {
    /// B x.
    pub(super) fn multiply(&self, x: &[f64]) -> Vec<f64> {
        let memory = self.get();
        let plain = || x.iter().map(|x| memory.delta * x).collect();
        memory.multiply(x).unwrap_or_else(plain)
    }

    fn get(&self) -> MutexGuard<'_, Memory> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Point, gradient and Jacobian of the last update.
struct Previous {
    x: Vec<f64>,
    gradient: Vec<f64>,
    jacobian: Vec<f64>,
}

/// A program whose second derivatives are never asked for.
pub(super) struct QuasiNewton<'a> {
    problem: &'a mut dyn Nlp,
    memory: Shared,
    previous: Option<Previous>,
}

impl Nlp for QuasiNewton<'_> {
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
        self.problem.objective(x)
    }
    fn gradient(&mut self, x: &[f64], gradient: &mut [f64]) {
        self.problem.gradient(x, gradient);
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

    /// Updates the memory by the step since the last call and leaves zeros; their sign tells the
    /// linear system to take the memory in. Without the objective (σ = 0, a feasibility problem)
    /// there is no curvature.
    fn hessian(&mut self, x: &[f64], sigma: f64, lambda: &[f64], values: &mut [f64]) {
        if sigma == 0.0 {
            values.fill(0.0);
            return;
        }
        values.fill(-0.0);
        let mut gradient = vec![0.0; x.len()];
        let mut jacobian = vec![0.0; self.problem.jacobian_pattern().nnz()];
        self.problem.gradient(x, &mut gradient);
        self.problem.jacobian(x, &mut jacobian);
        gradient.iter_mut().for_each(|g| *g *= sigma);
        if let Some(previous) = &self.previous {
            let s: Vec<f64> = x.iter().zip(&previous.x).map(|(a, b)| a - b).collect();
            let change = |now: &[f64], then: &[f64]| -> Vec<f64> {
                now.iter().zip(then).map(|(a, b)| a - b).collect()
            };
            let mut y = change(&gradient, &previous.gradient);
            let rows = change(&jacobian, &previous.jacobian);
            let pattern = self.problem.jacobian_pattern();
            pattern.transpose_multiply_add(&rows, lambda, &mut y);
            if dot(&s, &s) > NO_STEP * NO_STEP * (1.0 + dot(x, x)) {
                self.memory.get().update(s, y);
            }
        }
        self.previous = Some(Previous {
            x: x.to_vec(),
            gradient,
            jacobian,
        });
    }
}

/// The linear system with B in place of the Hessian.
pub(super) struct QuasiNewtonKkt<'a> {
    inner: &'a mut dyn Kkt,
    memory: Shared,
    sigma: Vec<f64>,
    w: Vec<Vec<f64>>,
    /// K₀⁻¹ [W; 0], variables and multipliers.
    z: Vec<(Vec<f64>, Vec<f64>)>,
    capacitance: Option<nalgebra::LU<f64, nalgebra::Dyn, nalgebra::Dyn>>,
    rows: usize,
}

impl Kkt for QuasiNewtonKkt<'_> {
    fn expect_error(&mut self, error: f64) {
        self.inner.expect_error(error);
    }

    fn factorise(&mut self, values: KktValues<'_>) -> Result<Regularisation, KktError> {
        self.capacitance = None;
        let takes_part = |v: &f64| *v == 0.0 && v.is_sign_negative();
        if !values.hessian.first().is_some_and(takes_part) {
            return self.inner.factorise(values);
        }
        let memory = self.memory.get();
        self.sigma.clear();
        let sigma = values.sigma.iter().map(|s| s + memory.delta);
        self.sigma.extend(sigma);
        let done = self.inner.factorise(KktValues {
            sigma: &self.sigma,
            ..values
        })?;
        if memory.s.is_empty() {
            return Ok(done);
        }
        self.w = memory.columns();
        let middle = memory.middle();
        drop(memory);
        let (n, k) = (values.sigma.len(), self.w.len());
        let zero = vec![0.0; self.rows];
        self.z.clear();
        for w in &self.w {
            let (mut x, mut l) = (vec![0.0; n], vec![0.0; self.rows]);
            self.inner.solve(w, &zero, &mut x, &mut l);
            self.z.push((x, l));
        }
        let capacitance =
            DMatrix::from_fn(k, k, |i, j| middle[(i, j)] - dot(&self.w[i], &self.z[j].0));
        let lu = capacitance.lu();
        self.capacitance = lu.is_invertible().then_some(lu);
        Ok(done)
    }

    fn relaxable(&self) -> bool {
        self.inner.relaxable()
    }

    fn relax(&mut self, diagonal: &[f64]) {
        self.inner.relax(diagonal);
    }

    fn solve(&mut self, rx: &[f64], rc: &[f64], dx: &mut [f64], dlambda: &mut [f64]) -> f64 {
        let residual = self.inner.solve(rx, rc, dx, dlambda);
        let Some(lu) = &self.capacitance else {
            return residual;
        };
        let right = DVector::from_iterator(self.w.len(), self.w.iter().map(|w| dot(w, dx)));
        let Some(t) = lu.solve(&right) else {
            return residual;
        };
        for ((x, l), t) in self.z.iter().zip(t.iter()) {
            for (d, x) in dx.iter_mut().zip(x) {
                *d += t * x;
            }
            for (d, l) in dlambda.iter_mut().zip(l) {
                *d += t * l;
            }
        }
        residual
    }
}

/// A program and its linear system with B in place of the Hessian, and B itself.
pub(super) fn wrap<'a>(
    problem: &'a mut dyn Nlp,
    kkt: &'a mut dyn Kkt,
    memory: usize,
) -> (QuasiNewton<'a>, QuasiNewtonKkt<'a>, Shared) {
    // More pairs than twice the variables add nothing new.
    let capacity = memory.min((2 * problem.n()).max(20));
    let shared = Shared(Arc::new(Mutex::new(Memory::new(capacity))));
    let system = QuasiNewtonKkt {
        inner: kkt,
        memory: shared.clone(),
        sigma: Vec::new(),
        w: Vec::new(),
        z: Vec::new(),
        capacitance: None,
        rows: problem.m(),
    };
    let wrapped = QuasiNewton {
        problem,
        memory: shared.clone(),
        previous: None,
    };
    (wrapped, system, shared)
}

/// Minimises a problem by the interior-point method with damped BFGS from the last `memory` steps
/// (at least 1; 6 to 20 is usual, the number of iterations for the full matrix). The problem's
/// [`Nlp::hessian`] is not called.
///
/// `kkt` must have been built for the same problem, as for [`ip::solve`].
pub fn solve(
    problem: &mut dyn Nlp,
    kkt: &mut dyn Kkt,
    x0: &[f64],
    memory: usize,
    settings: &Settings,
    callback: &mut Callback<'_>,
) -> Solution {
    let (mut wrapped, mut system, _) = wrap(problem, kkt, memory);
    ip::solve(&mut wrapped, &mut system, x0, settings, callback)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// B of the textbook recursion `B ← B − B s sᵀ B / sᵀBs + y yᵀ / sᵀy` from δ I.
    fn recursion(delta: f64, pairs: &[(Vec<f64>, Vec<f64>)]) -> DMatrix<f64> {
        let n = pairs[0].0.len();
        let mut b = DMatrix::identity(n, n) * delta;
        for (s, y) in pairs {
            let (s, y) = (DVector::from_column_slice(s), DVector::from_column_slice(y));
            let bs = &b * &s;
            b = &b - &bs * bs.transpose() / s.dot(&bs) + &y * y.transpose() / s.dot(&y);
        }
        b
    }

    type Pairs = Vec<(Vec<f64>, Vec<f64>)>;

    fn memory() -> (Memory, Pairs) {
        // y = A s of a positive definite A: no damping.
        let pairs = vec![
            (vec![1.0, 0.0, 0.5], vec![4.5, 1.0, 1.5]),
            (vec![0.0, 1.0, -0.5], vec![0.5, 3.0, -1.0]),
        ];
        let mut memory = Memory::new(5);
        for (s, y) in &pairs {
            memory.update(s.clone(), y.clone());
        }
        (memory, pairs)
    }

    #[test]
    fn compact_form_is_the_recursion() {
        let (memory, pairs) = memory();
        assert_eq!(memory.s.len(), 2);
        let expected = recursion(memory.delta, &pairs);
        for j in 0..3 {
            let mut unit = vec![0.0; 3];
            unit[j] = 1.0;
            let column = memory.multiply(&unit).unwrap();
            for i in 0..3 {
                assert!((column[i] - expected[(i, j)]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn damping_keeps_the_matrix_positive() {
        let (mut memory, _) = memory();
        memory.update(vec![1.0, 1.0, 1.0], vec![-5.0, 0.0, -1.0]);
        let product = dot(&memory.s[2], &memory.y[2]);
        assert_eq!(memory.s.len(), 3);
        assert!(product > 0.0, "{product}");
        for x in [[1.0, 1.0, 1.0], [1.0, -1.0, 0.0], [0.1, 0.0, -2.0]] {
            assert!(dot(&x, &memory.multiply(&x).unwrap()) > 0.0);
        }
    }

    /// Rosenbrock's function on the circle of radius √2: the optimum (1, 1). The exact Hessian must
    /// not be asked for.
    struct Circle(SparsePattern, SparsePattern);
    impl Nlp for Circle {
        fn n(&self) -> usize {
            2
        }
        fn m(&self) -> usize {
            1
        }
        fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
            lower.fill(-2.0);
            upper.fill(2.0);
        }
        fn objective(&mut self, x: &[f64]) -> f64 {
            10.0 * (x[1] - x[0] * x[0]).powi(2) + (1.0 - x[0]).powi(2)
        }
        fn gradient(&mut self, x: &[f64], g: &mut [f64]) {
            let r = x[1] - x[0] * x[0];
            g[0] = -40.0 * r * x[0] - 2.0 * (1.0 - x[0]);
            g[1] = 20.0 * r;
        }
        fn constraints(&mut self, x: &[f64], c: &mut [f64]) {
            c[0] = x[0] * x[0] + x[1] * x[1] - 2.0;
        }
        fn jacobian_pattern(&self) -> &SparsePattern {
            &self.0
        }
        fn jacobian(&mut self, x: &[f64], values: &mut [f64]) {
            values.copy_from_slice(&[2.0 * x[0], 2.0 * x[1]]);
        }
        fn hessian_pattern(&self) -> &SparsePattern {
            &self.1
        }
        fn hessian(&mut self, _: &[f64], _: f64, _: &[f64], _: &mut [f64]) {
            panic!("second derivatives are not asked for");
        }
    }

    #[test]
    fn solves_without_second_derivatives() {
        let (mut jacobian, mut hessian) = (SparsePattern::default(), SparsePattern::default());
        (0..2).for_each(|j| jacobian.push(0, j));
        (0..2).for_each(|i| (0..=i).for_each(|j| hessian.push(i, j)));
        let mut problem = Circle(jacobian, hessian);
        let mut kkt = crate::solver::kkt::sparse::SparseKkt::new(&problem);
        let settings = Settings::default();
        let solution = solve(
            &mut problem,
            &mut kkt,
            &[0.5, 1.5],
            6,
            &settings,
            &mut |_, _| std::ops::ControlFlow::Continue(()),
        );
        assert!(solution.status.converged(), "{:?}", solution.status);
        assert!((solution.x[0] - 1.0).abs() < 1e-5 && (solution.x[1] - 1.0).abs() < 1e-5);
    }
}
