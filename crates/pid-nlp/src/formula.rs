//! Programs written as one formula: exact derivatives by dual numbers.
//!
//! For programs of up to some dozens of variables: every derivative is dense, and a Hessian takes n (n + 1) / 2
//! evaluations. Larger programs implement [`Nlp`] with patterns of their own.

use num_dual::{Dual64, DualNum, HyperDual64};

use crate::{Nlp, SparsePattern};

/// Numbers in which formulas are written.
pub trait Number: DualNum<Primitive = f64> + Copy {}
impl<T: DualNum<Primitive = f64> + Copy> Number for T {}

/// A program as one formula.
pub trait Formula {
    /// Lower and upper bound of each variable, `±inf` where there is none; their number is n.
    fn variables(&self) -> Vec<(f64, f64)>;
    /// Lower and upper bound of each constraint, equal for an equation; their number is m.
    fn rows(&self) -> Vec<(f64, f64)> {
        Vec::new()
    }
    /// Writes the constraints at `x` to `c`, length m, and returns the objective.
    fn evaluate<D: Number>(&self, x: &[D], c: &mut [D]) -> D;
}

/// Arguments and constraints of an evaluation.
struct Work<D> {
    x: Vec<D>,
    c: Vec<D>,
}

impl<D: Number> Work<D> {
    fn new(n: usize, m: usize) -> Self {
        Self {
            x: vec![D::from(0.0); n],
            c: vec![D::from(0.0); m],
        }
    }

    fn at(&mut self, formula: &impl Formula, x: impl Iterator<Item = D>) -> D {
        self.x.iter_mut().zip(x).for_each(|(place, x)| *place = x);
        formula.evaluate(&self.x, &mut self.c)
    }
}

/// A [`Formula`] as a program for the solvers, with all derivatives.
pub struct Exact<F> {
    formula: F,
    variables: Vec<(f64, f64)>,
    rows: Vec<(f64, f64)>,
    jacobian: SparsePattern,
    hessian: SparsePattern,
    plain: Work<f64>,
    first: Work<Dual64>,
    second: Work<HyperDual64>,
}

impl<F: Formula> Exact<F> {
    /// The program of a formula.
    pub fn new(formula: F) -> Self {
        let (variables, rows) = (formula.variables(), formula.rows());
        let (n, m) = (variables.len(), rows.len());
        let (mut jacobian, mut hessian) = (SparsePattern::default(), SparsePattern::default());
        (0..m).for_each(|i| (0..n).for_each(|j| jacobian.push(i, j)));
        (0..n).for_each(|i| (0..=i).for_each(|j| hessian.push(i, j)));
        Self {
            formula,
            variables,
            rows,
            jacobian,
            hessian,
            plain: Work::new(n, m),
            first: Work::new(n, m),
            second: Work::new(n, m),
        }
    }

    /// Objective with its derivative by variable `j`; those of the constraints are left in `first.c`.
    fn along(&mut self, x: &[f64], j: usize) -> Dual64 {
        let seeded = x
            .iter()
            .enumerate()
            .map(|(k, &v)| Dual64::new(v, unit(k, j)));
        self.first.at(&self.formula, seeded)
    }
}

fn unit(a: usize, b: usize) -> f64 {
    f64::from(u8::from(a == b))
}

impl<F: Formula> Nlp for Exact<F> {
    fn n(&self) -> usize {
        self.variables.len()
    }

    fn m(&self) -> usize {
        self.rows.len()
    }

    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        for (j, &(least, most)) in self.variables.iter().enumerate() {
            (lower[j], upper[j]) = (least, most);
        }
    }

    fn constraint_bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        for (i, &(least, most)) in self.rows.iter().enumerate() {
            (lower[i], upper[i]) = (least, most);
        }
    }

    fn objective(&mut self, x: &[f64]) -> f64 {
        self.plain.at(&self.formula, x.iter().copied())
    }

    fn gradient(&mut self, x: &[f64], gradient: &mut [f64]) {
        for (j, g) in gradient.iter_mut().enumerate() {
            *g = self.along(x, j).eps;
        }
    }

    fn constraints(&mut self, x: &[f64], c: &mut [f64]) {
        self.plain.at(&self.formula, x.iter().copied());
        c.copy_from_slice(&self.plain.c);
    }

    fn jacobian_pattern(&self) -> &SparsePattern {
        &self.jacobian
    }

    fn jacobian(&mut self, x: &[f64], values: &mut [f64]) {
        let n = self.n();
        for j in 0..n {
            self.along(x, j);
            for (i, row) in self.first.c.iter().enumerate() {
                values[i * n + j] = row.eps;
            }
        }
    }

    fn hessian_pattern(&self) -> &SparsePattern {
        &self.hessian
    }

    fn hessian(&mut self, x: &[f64], sigma: f64, lambda: &[f64], values: &mut [f64]) {
        for (k, value) in values.iter_mut().enumerate() {
            let (i, j) = (self.hessian.rows[k] as usize, self.hessian.cols[k] as usize);
            let seeded = x
                .iter()
                .enumerate()
                .map(|(k, &v)| HyperDual64::new(v, unit(k, i), unit(k, j), 0.0));
            let f = self.second.at(&self.formula, seeded);
            // A part without weight is left out: its second derivative may be infinite.
            *value = if sigma == 0.0 {
                0.0
            } else {
                sigma * f.eps1eps2
            };
            for (row, &l) in self.second.c.iter().zip(lambda) {
                if l != 0.0 {
                    *value += l * row.eps1eps2;
                }
            }
        }
    }
}
