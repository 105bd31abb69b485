//! Physically consistent values: least squares on the normal equations over log-Cholesky coordinates.
//!
//! ```text
//! minimise   p(θ)ᵀ A p(θ) − 2 bᵀ p(θ) + c + μ Σ ((p_k − p⁰_k)/s_k)²
//! ```
//!
//! Every link with all ten parameters free is written in [`pseudo_inertia`] coordinates. Its
//! pseudo-inertia is then positive definite at every iterate, and with it the mass matrix in every
//! pose. The other parameters stay within their bounds (friction not negative). The small last term
//! settles directions that the data leave open at the start values. The project's interior-point
//! method solves the problem with exact second derivatives.

use nalgebra::{DMatrix, DVector};
use pid_nlp::solver::kkt::sparse::SparseKkt;
use pid_nlp::solver::{Settings, Status, ip};
use pid_nlp::{Nlp, SparsePattern};
use pid_runtime::dynamics::ParamInfo;
use std::ops::ControlFlow;

use crate::inertia::pseudo_inertia::{self, BODY, SUFFIXES};

/// μ: a deviation of one scale costs as much as this many residuals of one standard deviation.
const PRIOR: f64 = 1e-2;

/// A physically consistent fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Consistent {
    /// Linear parameters.
    pub p: DVector<f64>,
    /// Names of the links whose pseudo-inertia is positive definite by construction.
    pub links: Vec<String>,
    /// Weighted residual sum of squares before (unconstrained) and after.
    pub squares: (f64, f64),
    /// How the solver ended.
    pub status: Status,
    /// Iterations.
    pub iterations: usize,
}

/// Links among linear parameters: name and the columns of the ten parameters.
pub fn links(names: &[&str]) -> Vec<(String, [usize; BODY])> {
    names
        .iter()
        .filter_map(|name| name.strip_suffix("_m"))
        .filter_map(|link| {
            let mut columns = [0; BODY];
            for (column, suffix) in columns.iter_mut().zip(SUFFIXES) {
                let wanted = format!("{link}_{suffix}");
                *column = names.iter().position(|n| *n == wanted)?;
            }
            Some((link.to_owned(), columns))
        })
        .collect()
}

/// The program; variables take the places of the parameters they stand for, each in units of `unit`.
struct Program<'a> {
    a: &'a DMatrix<f64>,
    b: &'a DVector<f64>,
    c: f64,
    start: &'a DVector<f64>,
    scale: &'a [f64],
    links: Vec<[usize; BODY]>,
    lower: Vec<f64>,
    upper: Vec<f64>,
    /// Unit of each variable: 1 for coordinates, the scale for parameters.
    unit: Vec<f64>,
    /// Objective in units of its own size.
    norm: f64,
    empty: SparsePattern,
    pattern: SparsePattern,
}

impl Program<'_> {
    fn parameters(&self, x: &[f64]) -> DVector<f64> {
        let mut p = DVector::from_fn(x.len(), |i, _| x[i] * self.unit[i]);
        for columns in &self.links {
            let theta = columns.map(|c| x[c]);
            for (&c, value) in columns.iter().zip(pseudo_inertia::body(&theta)) {
                p[c] = value;
            }
        }
        p
    }

    /// ∂F/∂p.
    fn slope(&self, p: &DVector<f64>) -> DVector<f64> {
        let mut g = 2.0 * (self.a * p - self.b);
        for i in 0..p.len() {
            g[i] += 2.0 * PRIOR * (p[i] - self.start[i]) / (self.scale[i] * self.scale[i]);
        }
        g * self.norm
    }

    /// ∂p/∂x as a dense matrix.
    fn map(&self, x: &[f64]) -> DMatrix<f64> {
        let n = x.len();
        let mut d = DMatrix::from_diagonal(&DVector::from_column_slice(&self.unit));
        debug_assert_eq!(d.nrows(), n);
        for columns in &self.links {
            let theta = columns.map(|c| x[c]);
            let (_, first, _) = pseudo_inertia::derivatives(&theta, &[0.0; BODY]);
            for (k, &row) in columns.iter().enumerate() {
                for (i, &col) in columns.iter().enumerate() {
                    d[(row, col)] = first[k][i];
                }
            }
        }
        d
    }
}

impl Nlp for Program<'_> {
    fn n(&self) -> usize {
        self.unit.len()
    }
    fn m(&self) -> usize {
        0
    }
    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        lower.copy_from_slice(&self.lower);
        upper.copy_from_slice(&self.upper);
    }
    fn objective(&mut self, x: &[f64]) -> f64 {
        let p = self.parameters(x);
        let prior: f64 = (0..p.len())
            .map(|i| ((p[i] - self.start[i]) / self.scale[i]).powi(2))
            .sum();
        (p.dot(&(self.a * &p)) - 2.0 * p.dot(self.b) + self.c + PRIOR * prior) * self.norm
    }
    fn gradient(&mut self, x: &[f64], gradient: &mut [f64]) {
        let slope = self.slope(&self.parameters(x));
        let g = self.map(x).transpose() * slope;
        gradient.copy_from_slice(g.as_slice());
    }
    fn constraints(&mut self, _: &[f64], _: &mut [f64]) {}
    fn jacobian_pattern(&self) -> &SparsePattern {
        &self.empty
    }
    fn jacobian(&mut self, _: &[f64], _: &mut [f64]) {}
    fn hessian_pattern(&self) -> &SparsePattern {
        &self.pattern
    }
    fn hessian(&mut self, x: &[f64], sigma: f64, _: &[f64], values: &mut [f64]) {
        let slope = self.slope(&self.parameters(x));
        let map = self.map(x);
        let mut full = 2.0 * self.a;
        for i in 0..x.len() {
            full[(i, i)] += 2.0 * PRIOR / (self.scale[i] * self.scale[i]);
        }
        let mut h = map.transpose() * (full * self.norm) * &map;
        for columns in &self.links {
            let theta = columns.map(|c| x[c]);
            let (_, _, second) = pseudo_inertia::derivatives(&theta, &columns.map(|c| slope[c]));
            for (i, &row) in columns.iter().enumerate() {
                for (j, &col) in columns.iter().enumerate() {
                    h[(row, col)] += second[i][j];
                }
            }
        }
        let pattern = &self.pattern;
        for ((value, &r), &c) in values.iter_mut().zip(&pattern.rows).zip(&pattern.cols) {
            *value = sigma * h[(r as usize, c as usize)];
        }
    }
}

/// Fits physically consistent values to weighted normal equations `(A, b, c)`.
///
/// `infos`: the linear parameters; `start`: values near which open directions settle, in `scale`.
pub fn fit(
    a: &DMatrix<f64>,
    b: &DVector<f64>,
    c: f64,
    infos: &[&ParamInfo],
    start: &DVector<f64>,
    scale: &[f64],
    unconstrained: f64,
) -> Consistent {
    let n = infos.len();
    let names: Vec<&str> = infos.iter().map(|i| i.name.as_ref()).collect();
    let found = links(&names);
    let mut unit = scale.to_vec();
    let mut lower: Vec<f64> = (0..n).map(|i| infos[i].lower / scale[i]).collect();
    let mut upper: Vec<f64> = (0..n).map(|i| infos[i].upper / scale[i]).collect();
    let mut x: Vec<f64> = (0..n).map(|i| start[i] / scale[i]).collect();
    for (_, columns) in &found {
        let theta = pseudo_inertia::coordinates(&columns.map(|c| start[c]));
        for (&c, theta) in columns.iter().zip(theta) {
            (unit[c], x[c]) = (1.0, theta);
            (lower[c], upper[c]) = (f64::NEG_INFINITY, f64::INFINITY);
        }
    }
    let mut pattern = SparsePattern::default();
    (0..n).for_each(|i| (0..=i).for_each(|j| pattern.push(i, j)));
    let mut program = Program {
        a,
        b,
        c,
        start,
        scale,
        links: found.iter().map(|(_, columns)| *columns).collect(),
        lower,
        upper,
        unit,
        norm: 1.0 / unconstrained.max(f64::MIN_POSITIVE),
        empty: SparsePattern::default(),
        pattern,
    };
    let mut kkt = SparseKkt::new(&program);
    let settings = Settings {
        max_iterations: 1000,
        ..Settings::default()
    };
    let solution = ip::solve(&mut program, &mut kkt, &x, &settings, &mut |_, _| {
        ControlFlow::Continue(())
    });
    let p = program.parameters(&solution.x);
    let after = p.dot(&(a * &p)) - 2.0 * p.dot(b) + c;
    Consistent {
        links: found.into_iter().map(|(name, _)| name).collect(),
        squares: (unconstrained, after),
        status: solution.status,
        iterations: solution.log.len().saturating_sub(1),
        p,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pid_models::Ur10e;
    use pid_runtime::dynamics::Dynamics;
    use std::borrow::Cow;

    fn infos() -> Vec<ParamInfo> {
        SUFFIXES
            .iter()
            .map(|s| format!("body_{s}"))
            .chain(["viscous".to_owned()])
            .map(|name| ParamInfo {
                lower: if name == "viscous" {
                    0.0
                } else {
                    f64::NEG_INFINITY
                },
                name: Cow::Owned(name),
                unit: Cow::Borrowed(""),
                doc: Cow::Borrowed(""),
                nominal: 0.0,
                upper: f64::INFINITY,
                fixed: false,
            })
            .collect()
    }

    #[test]
    fn an_impossible_optimum_is_replaced_by_the_nearest_body() {
        let infos = infos();
        let list: Vec<&ParamInfo> = infos.iter().collect();
        // The unconstrained optimum breaks the triangle inequality and has negative friction.
        let mut best =
            DVector::from_vec(vec![1.0, 0.0, 0.0, 0.0, 0.1, 0.1, 0.3, 0.0, 0.0, 0.0, -0.2]);
        let a = DMatrix::identity(11, 11) * 1e4;
        let start = DVector::from_vec(vec![1.0, 0.0, 0.0, 0.0, 0.1, 0.1, 0.1, 0.0, 0.0, 0.0, 0.1]);
        let run = |best: &DVector<f64>| {
            let b = &a * best;
            fit(&a, &b, best.dot(&b) + 1.0, &list, &start, &[1.0; 11], 1.0)
        };
        let found = run(&best);
        let body: [f64; BODY] = std::array::from_fn(|i| found.p[i]);
        assert!(pseudo_inertia::definiteness(&body) > -1e-12 && found.p[10] > -1e-8);
        // The nearest point of the cone in these coordinates: Ixx = Iyy = 0.1 + t, Izz = 0.3 − t
        // with Izz = Ixx + Iyy.
        let t = 0.1 / 3.0;
        assert!((found.p[6] - (0.3 - t)).abs() < 2e-3, "{}", found.p);
        assert!((found.p[4] - (0.1 + t)).abs() < 2e-3);
        // A possible optimum is met.
        best[6] = 0.15;
        best[10] = 0.2;
        let found = run(&best);
        assert!((&found.p - &best).norm() < 1e-4, "{}", found.p);
    }

    #[test]
    fn links_are_found_by_name() {
        let names: Vec<&str> = Ur10e.params().iter().map(|p| p.name.as_ref()).collect();
        let found = links(&names);
        assert_eq!(found.len(), 6);
        for (_, columns) in &found {
            let p = columns.map(|c| Ur10e.params()[c].nominal);
            assert!(pseudo_inertia::definiteness(&p) > 0.0);
        }
    }
}
