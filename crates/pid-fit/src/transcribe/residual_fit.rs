//! Fits the parameters to the steps with the states held: the start of a full discretization.
//!
//! ```text
//! minimise  ½ ‖c(x, p)‖²   over p in its bounds, the states x held at the data
//! ```
//!
//! This is the equation error of the same scheme. It is a small dense problem, nearly quadratic
//! because the residual is affine in most parameters. It forgets a bad start without integrating
//! anything.

use super::full_discretization::FullDiscretization;
use pid_nlp::{Nlp, SparsePattern};

/// Least squares on the steps' residuals over the parameters alone.
pub struct ResidualFit<'a, 'm> {
    problem: &'a mut FullDiscretization<'m>,
    point: Vec<f64>,
    c: Vec<f64>,
    jacobian: Vec<f64>,
    hessian: Vec<f64>,
    /// Entries of the Jacobian in parameter columns: (value, row, parameter), sorted by row.
    columns: Vec<(u32, u32, u32)>,
    empty: SparsePattern,
    pattern: SparsePattern,
    held: Vec<usize>,
}

impl<'a, 'm> ResidualFit<'a, 'm> {
    /// The fit with the states of `point`.
    pub fn new(problem: &'a mut FullDiscretization<'m>, point: &[f64]) -> Self {
        let (first, np) = (problem.layout().p(), problem.layout().np);
        let jacobian = problem.jacobian_pattern();
        let mut columns: Vec<(u32, u32, u32)> = jacobian
            .cols
            .iter()
            .enumerate()
            .filter(|&(_, &col)| col as usize >= first)
            .map(|(k, &col)| (k as u32, jacobian.rows[k], col - first as u32))
            .collect();
        columns.sort_unstable_by_key(|&(_, row, col)| (row, col));
        let mut pattern = SparsePattern::default();
        (0..np).for_each(|i| (0..=i).for_each(|j| pattern.push(i, j)));
        Self {
            point: point.to_vec(),
            c: vec![0.0; problem.m()],
            jacobian: vec![0.0; jacobian.nnz()],
            hessian: vec![0.0; problem.hessian_pattern().nnz()],
            columns,
            empty: SparsePattern::default(),
            pattern,
            held: Vec::new(),
            problem,
        }
    }

    /// Holds parameters at their start.
    #[must_use]
    pub fn holding(mut self, parameters: &[usize]) -> Self {
        self.held = parameters.to_vec();
        self
    }

    fn load(&mut self, p: &[f64]) {
        let first = self.problem.layout().p();
        self.point[first..].copy_from_slice(p);
    }
}

impl Nlp for ResidualFit<'_, '_> {
    fn n(&self) -> usize {
        self.problem.layout().np
    }

    fn m(&self) -> usize {
        0
    }

    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        let n = self.problem.n();
        let (mut l, mut u) = (vec![0.0; n], vec![0.0; n]);
        self.problem.bounds(&mut l, &mut u);
        let first = self.problem.layout().p();
        lower.copy_from_slice(&l[first..]);
        upper.copy_from_slice(&u[first..]);
        for &j in &self.held {
            (lower[j], upper[j]) = (self.point[first + j], self.point[first + j]);
        }
    }

    fn objective(&mut self, p: &[f64]) -> f64 {
        self.load(p);
        self.problem.constraints(&self.point, &mut self.c);
        0.5 * self.c.iter().map(|c| c * c).sum::<f64>() + self.problem.barrier(&self.point)
    }

    fn gradient(&mut self, p: &[f64], gradient: &mut [f64]) {
        self.load(p);
        self.problem.constraints(&self.point, &mut self.c);
        self.problem.jacobian(&self.point, &mut self.jacobian);
        gradient.fill(0.0);
        for &(k, row, col) in &self.columns {
            gradient[col as usize] += self.jacobian[k as usize] * self.c[row as usize];
        }
        let (barrier, p) = self.problem.bodies();
        barrier.value(p, |j, slope| gradient[j] += slope);
    }

    fn constraints(&mut self, _: &[f64], _: &mut [f64]) {}

    fn jacobian_pattern(&self) -> &SparsePattern {
        &self.empty
    }

    fn jacobian(&mut self, _: &[f64], _: &mut [f64]) {}

    fn hessian_pattern(&self) -> &SparsePattern {
        &self.pattern
    }

    fn hessian(&mut self, p: &[f64], sigma: f64, _: &[f64], values: &mut [f64]) {
        self.load(p);
        self.problem.constraints(&self.point, &mut self.c);
        self.problem.jacobian(&self.point, &mut self.jacobian);
        self.problem
            .hessian(&self.point, 0.0, &self.c, &mut self.hessian);
        values.fill(0.0);
        let at = |i: u32, j: u32| (i.max(j) * (i.max(j) + 1) / 2 + i.min(j)) as usize;
        let (barrier, p) = self.problem.bodies();
        barrier.hessian(p, |i, j, value| {
            values[at(i as u32, j as u32)] += sigma * value
        });
        let layout = self.problem.layout();
        let offset = layout.parameter_values();
        for (k, &(i, j)) in layout.parameter_hessian.iter().enumerate() {
            values[at(i, j)] += sigma * self.hessian[offset + k];
        }
        let mut rest = self.columns.as_slice();
        while let Some(&(_, row, _)) = rest.first() {
            let len = rest.iter().take_while(|e| e.1 == row).count();
            let (here, after) = rest.split_at(len);
            for (n, &(ki, _, i)) in here.iter().enumerate() {
                for &(kj, _, j) in &here[..=n] {
                    values[at(i, j)] +=
                        sigma * self.jacobian[ki as usize] * self.jacobian[kj as usize];
                }
            }
            rest = after;
        }
    }

    fn barrier_changed(&mut self, mu: f64) -> bool {
        self.problem.barrier_changed(mu)
    }

    fn longest_step(&self, p: &[f64], d: &[f64], share: f64) -> f64 {
        self.problem.bodies().0.longest(p, d, share)
    }
}
