//! The whole KKT matrix by sparse LDLᵀ: the fallback for problems without the structure of a discretization.

use super::ldl::SparseLdl;
use super::{Kkt, KktError, KktValues, Regularisation};
use crate::nlp::{Nlp, SparsePattern};

/// Static regularisation of the constraint block; refinement removes its effect on the solution.
const STATIC: f64 = 1e-9;
/// Most steps of iterative refinement.
const REFINEMENTS: usize = 10;

/// Sparse LDLᵀ of the full matrix with inertia correction by multiples of the identity (Wächter &
/// Biegler 2006, algorithm IC).
pub struct SparseKkt {
    n: usize,
    m: usize,
    hessian: SparsePattern,
    jacobian: SparsePattern,
    fixed: Vec<bool>,
    ldl: SparseLdl,
    hessian_values: Vec<f64>,
    jacobian_values: Vec<f64>,
    diagonal: Vec<f64>,
    delta_c: f64,
    /// −D of the constraint block without δ_c.
    relaxation: Vec<f64>,
    last_delta: f64,
    residual: Vec<f64>,
    solution: Vec<f64>,
}

impl SparseKkt {
    /// Analyses the pattern of a problem. Variables with equal bounds are held.
    pub fn new(problem: &dyn Nlp) -> Self {
        let (n, m) = (problem.n(), problem.m());
        let (mut lower, mut upper) = (vec![0.0; n], vec![0.0; n]);
        problem.bounds(&mut lower, &mut upper);
        let fixed: Vec<bool> = lower.iter().zip(&upper).map(|(l, u)| l == u).collect();
        let (hessian, jacobian) = (problem.hessian_pattern(), problem.jacobian_pattern());
        Self::of(n, m, hessian, jacobian, &fixed)
    }

    /// Analyses patterns of n variables and m rows; the `fixed` variables are held.
    pub fn of(
        n: usize,
        m: usize,
        hessian: &SparsePattern,
        jacobian: &SparsePattern,
        fixed: &[bool],
    ) -> Self {
        let (hessian, jacobian) = (hessian.clone(), jacobian.clone());
        let mut triplets: Vec<(u32, u32)> = hessian
            .rows
            .iter()
            .zip(&hessian.cols)
            .map(|(&r, &c)| (r, c))
            .collect();
        triplets.extend(
            jacobian
                .rows
                .iter()
                .zip(&jacobian.cols)
                .map(|(&r, &c)| (n as u32 + r, c)),
        );
        Self {
            n,
            m,
            fixed: fixed.to_vec(),
            ldl: SparseLdl::new(n + m, &triplets),
            hessian_values: vec![0.0; hessian.nnz()],
            jacobian_values: vec![0.0; jacobian.nnz()],
            hessian,
            jacobian,
            diagonal: vec![0.0; n],
            delta_c: 0.0,
            relaxation: vec![0.0; m],
            last_delta: 0.0,
            residual: vec![0.0; n + m],
            solution: vec![0.0; n + m],
        }
    }

    fn load(&mut self, delta_x: f64, delta_c: f64) {
        self.ldl.clear();
        for k in 0..self.hessian.nnz() {
            self.ldl.add(k, self.hessian_values[k]);
        }
        let offset = self.hessian.nnz();
        for k in 0..self.jacobian.nnz() {
            self.ldl.add(offset + k, self.jacobian_values[k]);
        }
        for i in 0..self.n {
            self.ldl.add_diagonal(i, self.diagonal[i] + delta_x);
        }
        for i in 0..self.m {
            let diagonal = (self.relaxation[i] + delta_c).max(STATIC);
            self.ldl.add_diagonal(self.n + i, -diagonal);
        }
    }
}

impl Kkt for SparseKkt {
    fn factorise(&mut self, values: KktValues<'_>) -> Result<Regularisation, KktError> {
        if !values
            .hessian
            .iter()
            .chain(values.jacobian)
            .all(|v| v.is_finite())
        {
            return Err(KktError::NotFinite);
        }
        let held = |i: u32| self.fixed[i as usize];
        for (k, value) in self.hessian_values.iter_mut().enumerate() {
            let hold = held(self.hessian.rows[k]) || held(self.hessian.cols[k]);
            *value = if hold { 0.0 } else { values.hessian[k] };
        }
        for (k, value) in self.jacobian_values.iter_mut().enumerate() {
            *value = if held(self.jacobian.cols[k]) {
                0.0
            } else {
                values.jacobian[k]
            };
        }
        for i in 0..self.n {
            self.diagonal[i] = if self.fixed[i] { 1.0 } else { values.sigma[i] };
        }
        let mut tried = 0;
        let (mut delta_x, mut delta_c) = (0.0, 0.0);
        loop {
            self.load(delta_x, delta_c);
            tried += 1;
            let inertia = self.ldl.factorise();
            if inertia.negative == self.m && inertia.zero == 0 {
                break;
            }
            if inertia.zero > 0 || inertia.negative > self.m && delta_x > 1e10 {
                delta_c = 1e-8;
            }
            delta_x = match (delta_x, self.last_delta) {
                (0.0, 0.0) => 1e-4,
                (0.0, last) => (last / 3.0).max(1e-20),
                (delta, 0.0) => 100.0 * delta,
                (delta, _) => 8.0 * delta,
            };
            if delta_x > 1e40 {
                return Err(KktError::WrongInertia { delta: delta_x });
            }
        }
        if delta_x > 0.0 {
            self.last_delta = delta_x;
        }
        for d in &mut self.diagonal {
            *d += delta_x;
        }
        self.delta_c = delta_c;
        Ok(Regularisation {
            delta_x,
            shift: 0.0,
            delta_c,
            factorizations: tried,
        })
    }

    fn relaxable(&self) -> bool {
        true
    }

    fn relax(&mut self, diagonal: &[f64]) {
        if diagonal.is_empty() {
            self.relaxation.fill(0.0);
        } else {
            self.relaxation.copy_from_slice(diagonal);
        }
    }

    fn solve(&mut self, rx: &[f64], rc: &[f64], dx: &mut [f64], dlambda: &mut [f64]) -> f64 {
        let (n, m) = (self.n, self.m);
        let largest = |v: &[f64]| v.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
        let scale = largest(rx).max(largest(rc));
        dx.fill(0.0);
        dlambda.fill(0.0);
        if scale == 0.0 {
            return 0.0;
        }
        let mut relative = f64::INFINITY;
        for pass in 0..=REFINEMENTS {
            // residual = K·(dx, dλ) − rhs without the static term
            for i in 0..n {
                let rhs = if self.fixed[i] { 0.0 } else { rx[i] };
                self.residual[i] = -rhs + self.diagonal[i] * dx[i];
            }
            for i in 0..m {
                self.residual[n + i] = -rc[i] - (self.relaxation[i] + self.delta_c) * dlambda[i];
            }
            let (top, bottom) = self.residual.split_at_mut(n);
            self.hessian
                .symmetric_multiply_add(&self.hessian_values, dx, top);
            self.jacobian
                .transpose_multiply_add(&self.jacobian_values, dlambda, top);
            self.jacobian
                .multiply_add(&self.jacobian_values, dx, bottom);
            let size = largest(dx).max(largest(dlambda)).min(1e6 * scale);
            let next = largest(&self.residual) / (scale + size);
            if pass > 0 && (next >= relative || next.is_nan()) {
                // The last correction made it worse: undo it.
                for i in 0..n {
                    dx[i] -= self.solution[i];
                }
                for i in 0..m {
                    dlambda[i] -= self.solution[n + i];
                }
                return relative;
            }
            relative = next;
            if relative <= 1e-13 || pass == REFINEMENTS {
                break;
            }
            for (s, r) in self.solution.iter_mut().zip(&self.residual) {
                *s = -r;
            }
            self.ldl.solve(&mut self.solution, 1);
            for i in 0..n {
                dx[i] += self.solution[i];
            }
            for i in 0..m {
                dlambda[i] += self.solution[n + i];
            }
        }
        relative
    }
}
