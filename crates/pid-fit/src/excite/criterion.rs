//! Measures of an information matrix and their derivatives.

use nalgebra::{DMatrix, SymmetricEigen};
use serde::{Deserialize, Serialize};

/// Criterion of a motion, to be minimised, for an information matrix A of order n.
///
/// Eigenvalues below 1e-300 make the value infinite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Criterion {
    /// −ln det A / n: the volume of the confidence ellipsoid. Does not depend on the units of the parameters.
    Determinant,
    /// ln tr A⁻⁸ / 8: a smooth upper bound of −ln of the smallest eigenvalue, at most ln n / 8
    /// above it. It measures the longest axis of the ellipsoid.
    SmallestEigenvalue,
}

/// Power of the smooth bound.
const POWER: i32 = 8;

/// Value and derivatives of a criterion at one information matrix.
#[derive(Debug)]
pub(super) struct Measured {
    pub(super) value: f64,
    /// Eigenvalues, and eigenvectors in columns.
    pub(super) eigen: SymmetricEigen<f64, nalgebra::Dyn>,
    /// ∂f/∂A, symmetric.
    pub(super) gradient: DMatrix<f64>,
    criterion: Criterion,
    /// tr A⁻⁸.
    trace: f64,
}

impl Measured {
    /// Square root of the largest over the smallest eigenvalue: the condition number of the
    /// regressor.
    pub(super) fn condition(&self) -> f64 {
        let (low, high) = (self.eigen.eigenvalues.min(), self.eigen.eigenvalues.max());
        (high / low).sqrt()
    }

    /// Second derivative in directions given in the basis of eigenvectors, nb × nb each, symmetric
    /// (divided differences of the derivative: Ju. L. Daleckii, S. G. Krein, 1965).
    pub(super) fn curvature(&self, e: &[f64], f: &[f64]) -> f64 {
        let l = self.eigen.eigenvalues.as_slice();
        let n = l.len();
        let mut sum = 0.0;
        match self.criterion {
            Criterion::Determinant => {
                for i in 0..n {
                    let row = i * n;
                    let inner: f64 = (0..n).map(|j| e[row + j] * f[row + j] / l[j]).sum();
                    sum += inner / l[i];
                }
                sum / n as f64
            }
            Criterion::SmallestEigenvalue => {
                let m = f64::from(POWER);
                let (mut first_e, mut first_f) = (0.0, 0.0);
                for i in 0..n {
                    let slope = -m * l[i].powi(-POWER - 1);
                    first_e += slope * e[i * n + i];
                    first_f += slope * f[i * n + i];
                    for j in 0..n {
                        sum += divided(l[i], l[j]) * e[i * n + j] * f[i * n + j];
                    }
                }
                sum / (m * self.trace) - first_e * first_f / (m * self.trace * self.trace)
            }
        }
    }
}

/// Divided difference of −m x^(−m−1): m Σ_k a^(−1−k) b^(k−m−1), k = 0 … m; free of cancellation.
fn divided(a: f64, b: f64) -> f64 {
    let m = f64::from(POWER);
    m * (0..=POWER)
        .map(|k| a.powi(-1 - k) * b.powi(k - POWER - 1))
        .sum::<f64>()
}

/// A criterion's value, gradient and the terms of its curvature.
pub(super) fn measure(criterion: Criterion, a: &DMatrix<f64>) -> Measured {
    let n = a.nrows();
    let eigen = SymmetricEigen::new(a.clone());
    let l = &eigen.eigenvalues;
    let regular = l.iter().all(|l| *l > 1e-300);
    let (value, slopes, trace): (f64, Vec<f64>, f64) = match criterion {
        _ if !regular => (f64::INFINITY, vec![0.0; n], 1.0),
        Criterion::Determinant => (
            -l.iter().map(|l| l.ln()).sum::<f64>() / n as f64,
            l.iter().map(|l| -1.0 / (n as f64 * l)).collect(),
            1.0,
        ),
        Criterion::SmallestEigenvalue => {
            let trace: f64 = l.iter().map(|l| l.powi(-POWER)).sum();
            (
                trace.ln() / f64::from(POWER),
                l.iter().map(|l| -l.powi(-POWER - 1) / trace).collect(),
                trace,
            )
        }
    };
    let mut scaled = eigen.eigenvectors.clone();
    for (mut column, slope) in scaled.column_iter_mut().zip(&slopes) {
        column *= *slope;
    }
    let gradient = &scaled * eigen.eigenvectors.transpose();
    Measured {
        value,
        eigen,
        gradient,
        criterion,
        trace,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn matrix(n: usize, seed: f64) -> DMatrix<f64> {
        let b = DMatrix::from_fn(n, n, |i, j| ((i * n + j).pow(2) as f64 * 0.37 + seed).sin());
        &b * b.transpose()
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let n = 5;
        let a = matrix(n, 0.3) + DMatrix::identity(n, n) * 0.5;
        let (e, f) = (matrix(n, 1.1), matrix(n, 2.2));
        for criterion in [Criterion::Determinant, Criterion::SmallestEigenvalue] {
            let at = |s: f64, t: f64| measure(criterion, &(&a + &e * s + &f * t));
            let here = at(0.0, 0.0);
            // Richardson's extrapolation of central differences: error of the fourth order.
            let difference = |f: &dyn Fn(f64) -> f64| {
                let central = |h: f64| (f(h) - f(-h)) / (2.0 * h);
                (4.0 * central(1e-4) - central(2e-4)) / 3.0
            };
            let slope = here.gradient.dot(&e);
            let expected = difference(&|s| at(s, 0.0).value);
            assert!(
                (slope - expected).abs() < 1e-8 * slope.abs(),
                "{criterion:?}: {slope} {expected}"
            );
            let q = &here.eigen.eigenvectors;
            let turned = |m: &DMatrix<f64>| (q.transpose() * m * q).as_slice().to_vec();
            let curvature = here.curvature(&turned(&e), &turned(&f));
            let expected = difference(&|t| at(0.0, t).gradient.dot(&e));
            assert!(
                (curvature - expected).abs() < 1e-8 * curvature.abs(),
                "{criterion:?}: {curvature} {expected}"
            );
        }
    }

    #[test]
    fn the_smooth_bound_is_close_to_the_smallest_eigenvalue() {
        let a = matrix(6, 0.1) + DMatrix::identity(6, 6) * 0.1;
        let low = SymmetricEigen::new(a.clone()).eigenvalues.min();
        let bound = measure(Criterion::SmallestEigenvalue, &a).value + low.ln();
        assert!((0.0..=6.0_f64.ln() / 8.0).contains(&bound), "{bound}");
    }
}
