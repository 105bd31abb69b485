//! Coefficients of Runge-Kutta methods.
//!
//! ```text
//! K_i = f(t + c_i h, x + h Σ_j A_ij K_j),        x⁺ = x + h Σ_j b_j K_j
//! ```
//!
//! Collocation coefficients follow from their nodes: the roots of shifted Legendre polynomials
//! (Gauss), of `P_s − P_{s−1}` (Radau IIA) (E. Hairer, G. Wanner, Solving Ordinary Differential
//! Equations II, section IV.5).

use crate::integrate::DORMAND_PRINCE;

/// A method with s stages.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Butcher {
    /// Matrix A, s × s, row by row.
    pub(super) a: Vec<f64>,
    /// Weights b.
    pub(super) b: Vec<f64>,
    /// Nodes c, the row sums of A.
    pub(super) c: Vec<f64>,
}

/// Legendre polynomial P_n on [−1, 1] and its derivative, by the recurrence of three terms; |x| < 1
/// for the derivative.
fn legendre(n: usize, x: f64) -> (f64, f64) {
    let (mut last, mut value) = (1.0, x);
    if n == 0 {
        return (1.0, 0.0);
    }
    for k in 1..n {
        let k = k as f64;
        (last, value) = (value, ((2.0 * k + 1.0) * x * value - k * last) / (k + 1.0));
    }
    (value, n as f64 * (last - x * value) / (1.0 - x * x))
}

/// The roots in (−1, 1) of a function with simple roots, ascending: signs on a fine grid, then
/// bisection to the last digit.
fn roots(f: impl Fn(f64) -> f64) -> Vec<f64> {
    const GRID: i32 = 1000;
    let mut found = Vec::new();
    // An offset keeps the roots at 0 off the grid.
    let at = |k: i32| (f64::from(k) + 0.37) / f64::from(GRID) - 1.0;
    for k in 0..2 * GRID - 1 {
        let (mut low, mut high) = (at(k), at(k + 1));
        let sign = f(low).signum();
        if sign == f(high).signum() {
            continue;
        }
        for _ in 0..70 {
            let middle = 0.5 * (low + high);
            if f(middle).signum() == sign {
                low = middle;
            } else {
                high = middle;
            }
        }
        found.push(0.5 * (low + high));
    }
    found
}

impl Butcher {
    fn of(a: &[&[f64]], b: &[f64]) -> Self {
        let s = b.len();
        let mut full = vec![0.0; s * s];
        for (row, values) in full.chunks_exact_mut(s).zip(a) {
            row[..values.len()].copy_from_slice(values);
        }
        Self {
            c: full.chunks_exact(s).map(|row| row.iter().sum()).collect(),
            a: full,
            b: b.to_vec(),
        }
    }

    pub(super) fn explicit_euler() -> Self {
        Self::of(&[&[]], &[1.0])
    }

    pub(super) fn heun() -> Self {
        Self::of(&[&[], &[1.0]], &[0.5, 0.5])
    }

    pub(super) fn rk4() -> Self {
        let b = [1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0];
        Self::of(&[&[], &[0.5], &[0.0, 0.5], &[0.0, 0.0, 1.0]], &b)
    }

    /// The weights of order 5; the seventh stage, which they do not use, is left out.
    pub(super) fn dormand_prince() -> Self {
        let [stages @ .., weights] = &DORMAND_PRINCE;
        Self::of(stages, weights)
    }

    pub(super) fn trapezoidal() -> Self {
        Self::of(&[&[], &[0.5, 0.5]], &[0.5, 0.5])
    }

    pub(super) fn hermite_simpson() -> Self {
        let b = [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0];
        Self::of(&[&[], &[5.0 / 24.0, 1.0 / 3.0, -1.0 / 24.0], &b], &b)
    }

    /// Collocation at nodes in (0, 1]: `A_ij = ∫_0^{c_i} ℓ_j`, `b_j = ∫_0^1 ℓ_j` with the Lagrange
    /// polynomials ℓ_j of the nodes, integrated exactly by a Gauss rule of enough points.
    fn collocation(c: Vec<f64>) -> Self {
        let s = c.len();
        let rule: Vec<(f64, f64)> = roots(|x| legendre(s, x).0)
            .into_iter()
            .map(|x| {
                let slope = legendre(s, x).1;
                (0.5 * (1.0 + x), 1.0 / ((1.0 - x * x) * slope * slope))
            })
            .collect();
        let basis = |j: usize, t: f64| -> f64 {
            (0..s)
                .filter(|&k| k != j)
                .map(|k| (t - c[k]) / (c[j] - c[k]))
                .product()
        };
        let integral = |j: usize, to: f64| -> f64 {
            let sum: f64 = rule.iter().map(|&(t, w)| w * basis(j, to * t)).sum();
            to * sum
        };
        let mut a = vec![0.0; s * s];
        for i in 0..s {
            for j in 0..s {
                a[i * s + j] = integral(j, c[i]);
            }
        }
        Self {
            b: (0..s).map(|j| integral(j, 1.0)).collect(),
            a,
            c,
        }
    }

    /// Collocation at the s roots of the shifted Legendre polynomial.
    pub(super) fn gauss_legendre(s: usize) -> Self {
        let nodes = roots(|x| legendre(s, x).0);
        Self::collocation(nodes.into_iter().map(|x| 0.5 * (1.0 + x)).collect())
    }

    /// Radau IIA: collocation at the roots of `P_s − P_{s−1}`, the last one 1.
    pub(super) fn radau(s: usize) -> Self {
        let nodes = roots(|x| legendre(s, x).0 - legendre(s - 1, x).0);
        let mut c: Vec<f64> = nodes.into_iter().map(|x| 0.5 * (1.0 + x)).collect();
        c.push(1.0);
        let mut method = Self::collocation(c);
        // The end of the step is its last stage, to the last digit.
        let last = method.a[(s - 1) * s..].to_vec();
        method.b.copy_from_slice(&last);
        method
    }

    /// Number of stages.
    pub(super) fn stages(&self) -> usize {
        self.b.len()
    }

    /// Whether the end of the step is its last stage.
    pub(super) fn ends_in_last_stage(&self) -> bool {
        let s = self.stages();
        self.a[(s - 1) * s..] == self.b[..]
    }

    /// Whether every stage follows from the ones before it.
    pub(super) fn explicit(&self) -> bool {
        let s = self.stages();
        (0..s).all(|i| self.a[i * s + i..(i + 1) * s].iter().all(|&a| a == 0.0))
    }

    /// Matrix A², that of the positions.
    pub(super) fn squared(&self) -> Vec<f64> {
        let s = self.stages();
        let mut out = vec![0.0; s * s];
        for i in 0..s {
            for k in 0..s {
                for j in 0..s {
                    out[i * s + j] += self.a[i * s + k] * self.a[k * s + j];
                }
            }
        }
        out
    }

    /// Row bᵀA, that of the positions at the end.
    pub(super) fn weighted(&self) -> Vec<f64> {
        let s = self.stages();
        (0..s)
            .map(|j| (0..s).map(|i| self.b[i] * self.a[i * s + j]).sum())
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// B(order) and C(stage order) of a method.
    fn conditions(method: &Butcher, order: i32, stage_order: i32) {
        let s = method.stages();
        for k in 1..=order {
            let sum: f64 = (0..s).map(|j| method.b[j] * method.c[j].powi(k - 1)).sum();
            assert!(
                (sum - 1.0 / f64::from(k)).abs() < 1e-14,
                "B({k}), {s} stages: {sum}"
            );
        }
        for (i, c) in method.c.iter().enumerate() {
            for k in 1..=stage_order {
                let sum: f64 = (0..s)
                    .map(|j| method.a[i * s + j] * method.c[j].powi(k - 1))
                    .sum();
                assert!(
                    (sum - c.powi(k) / f64::from(k)).abs() < 1e-14,
                    "C({k}), {s} stages, stage {i}: {sum}"
                );
            }
        }
    }

    #[test]
    fn collocation_satisfies_the_simplifying_conditions() {
        for s in 1..=6 {
            let order = i32::try_from(s).unwrap();
            conditions(&Butcher::gauss_legendre(s), 2 * order, order);
            conditions(&Butcher::radau(s), 2 * order - 1, order);
        }
        conditions(&Butcher::hermite_simpson(), 4, 3);
        conditions(&Butcher::dormand_prince(), 5, 1);
    }

    #[test]
    fn published_nodes_are_met() {
        let gauss = Butcher::gauss_legendre(3);
        assert!((gauss.c[0] - (0.5 - 15f64.sqrt() / 10.0)).abs() < 1e-15);
        let radau = Butcher::radau(3);
        assert!((radau.c[0] - (4.0 - 6f64.sqrt()) / 10.0).abs() < 1e-15);
        assert!((radau.a[0] - (88.0 - 7.0 * 6f64.sqrt()) / 360.0).abs() < 1e-15);
        assert!(radau.ends_in_last_stage() && !radau.explicit());
    }
}
