//! Models over dual numbers: exact derivatives by forward mode, without the generated ones.
//!
//! A model that implements [`GenericDynamics`] can be evaluated over any number of [`num_dual`].
//! Seeded with unit perturbations this gives ∂r/∂z ([`residual_jacobian`]) and the Hessian of λᵀr
//! ([`residual_hessian`]). They are the oracle of the generated derivatives, and they differentiate
//! compositions that the generator does not know. The generated derivatives are one to two orders
//! of magnitude faster; use those in inner loops.
//!
//! # Example
//! Slope of the acceleration of a pendulum by its length, exact, and the same Jacobian in two ways:
//! ```
//! use pid_runtime::dynamics::{At, Dynamics, Jacobian};
//! use pid_runtime::generic;
//! use pid_runtime::num_dual::Dual64;
//!
//! pid_runtime::robot! {
//!     /// A point mass on a rod.
//!     pub robot Pendulum {
//!         gravity: [0, 0, -9.81] m/s^2;
//!         params {
//!             m: kg = 1.0 in 0.1..=5.0;
//!             l: m = 0.5 in 0.1..=1.0;
//!         }
//!         link rod { mass: m; com: [0, 0, -l]; }
//!         joint pivot: revolute about y { base -> rod; }
//!     }
//! }
//!
//! // a = −g sin(q) / l, so ∂a/∂l = g sin(q) / l².
//! let d = Dual64::from;
//! let mut a = [d(0.0)];
//! Pendulum::vector_field_generic(&[d(0.3)], &[d(0.0)], &[], &[d(1.0), Dual64::new(0.5, 1.0)], &mut a)?;
//! assert!((a[0].eps - 9.81 * 0.3_f64.sin() / 0.25).abs() < 1e-13);
//!
//! let at = At { q: &[0.3], v: &[1.0], a: &[2.0], u: &[], p: &[1.0, 0.5] };
//! let mut dense = [0.0; 5];
//! generic::residual_jacobian(&Pendulum, Pendulum.dims(), &at, &mut dense);
//! let (mut r, mut values) = ([0.0], [0.0; Pendulum::JACOBIAN_NNZ]);
//! Pendulum.residual_jacobian(&at, &mut r, &mut values);
//! for (value, &col) in values.iter().zip(Pendulum.jacobian_pattern().cols) {
//!     assert!((value - dense[col as usize]).abs() < 1e-14);
//! }
//! # Ok::<(), pid_runtime::dynamics::SingularMassMatrix>(())
//! ```

pub mod functions;

use num_dual::{Dual64, DualNum, HyperDual64};

use crate::dynamics::{At, Dims, Pattern, SingularMassMatrix};

/// A model's values over any dual number. Arguments as in [`Dynamics`](crate::dynamics::Dynamics).
pub trait GenericDynamics {
    /// `r(q, v, a, u, p) = M a + b − f_L`.
    fn residual_generic<D: DualNum<Primitive = f64> + Copy>(
        &self,
        q: &[D],
        v: &[D],
        a: &[D],
        u: &[D],
        p: &[D],
        r: &mut [D],
    );

    /// The accelerations with r = 0.
    ///
    /// # Errors
    /// If M is not positive definite; `a` is then left as it was.
    fn vector_field_generic<D: DualNum<Primitive = f64> + Copy>(
        &self,
        q: &[D],
        v: &[D],
        u: &[D],
        p: &[D],
        a: &mut [D],
    ) -> Result<(), SingularMassMatrix>;
}

/// Solves `M x = f` by a Cholesky factorization `M = L Lᵀ` in place.
///
/// `m` holds the lower triangle of M row by row and receives L; `f` has one entry per row and
/// receives x. Over dual numbers the solution carries the derivatives of M and f.
///
/// # Errors
/// If a pivot is not positive (or NaN); `m` and `f` are then undefined.
///
/// # Panics
/// If `m` is shorter than the triangle that belongs to `f`.
pub fn cholesky_solve<D: DualNum<Primitive = f64> + Copy>(
    m: &mut [D],
    f: &mut [D],
) -> Result<(), SingularMassMatrix> {
    let n = f.len();
    let at = |i: usize, j: usize| i * (i + 1) / 2 + j;
    for i in 0..n {
        for j in 0..=i {
            let mut entry = m[at(i, j)];
            for k in 0..j {
                entry -= m[at(i, k)] * m[at(j, k)];
            }
            m[at(i, j)] = if i == j {
                let pivot = entry.re();
                // Written so that NaN is refused too.
                if !(pivot > 0.0 && pivot.is_finite()) {
                    return Err(SingularMassMatrix { index: i, pivot });
                }
                entry.sqrt()
            } else {
                entry / m[at(j, j)]
            };
        }
    }
    for i in 0..n {
        let mut entry = f[i];
        for k in 0..i {
            entry -= m[at(i, k)] * f[k];
        }
        f[i] = entry / m[at(i, i)];
    }
    for i in (0..n).rev() {
        let mut entry = f[i];
        for k in i + 1..n {
            entry -= m[at(k, i)] * f[k];
        }
        f[i] = entry / m[at(i, i)];
    }
    Ok(())
}

/// The residual at `z = (q, v, a, u, p)` over dual numbers.
fn residual_at<M: GenericDynamics, D: DualNum<Primitive = f64> + Copy>(
    model: &M,
    dims: Dims,
    z: &[D],
    r: &mut [D],
) {
    let (q, rest) = z.split_at(dims.nq);
    let (v, rest) = rest.split_at(dims.nq);
    let (a, rest) = rest.split_at(dims.nq);
    let (u, p) = rest.split_at(dims.nu);
    model.residual_generic(q, v, a, u, p, r);
}

fn stacked<D: DualNum<Primitive = f64>>(at: &At<'_>) -> Vec<D> {
    [at.q, at.v, at.a, at.u, at.p]
        .into_iter()
        .flatten()
        .map(|&x| D::from(x))
        .collect()
}

/// ∂r/∂z, dense, row by row: `jacobian[row * nz + col]`. One evaluation over [`Dual64`] per column.
///
/// # Panics
/// If `at` does not have the lengths of `dims`, or `jacobian` not `nq * nz`.
pub fn residual_jacobian<M: GenericDynamics>(
    model: &M,
    dims: Dims,
    at: &At<'_>,
    jacobian: &mut [f64],
) {
    let nz = dims.nz();
    assert_eq!(
        jacobian.len(),
        dims.nq * nz,
        "a dense Jacobian has nq * nz entries"
    );
    let mut z: Vec<Dual64> = stacked(at);
    let mut r = vec![Dual64::from(0.0); dims.nq];
    for col in 0..nz {
        z[col].eps = 1.0;
        residual_at(model, dims, &z, &mut r);
        z[col].eps = 0.0;
        for (row, value) in r.iter().enumerate() {
            jacobian[row * nz + col] = value.eps;
        }
    }
}

/// Entries of ∂²(λᵀr)/∂z² at the positions of a pattern. One evaluation over [`HyperDual64`] per entry.
///
/// # Panics
/// If `at` does not have the lengths of `dims`, `lambda` not `nq`, or `values` not the length of the pattern.
pub fn residual_hessian<M: GenericDynamics>(
    model: &M,
    dims: Dims,
    at: &At<'_>,
    lambda: &[f64],
    pattern: Pattern<'_>,
    values: &mut [f64],
) {
    assert_eq!(lambda.len(), dims.nq, "one multiplier per equation");
    assert_eq!(
        values.len(),
        pattern.nnz(),
        "one value per entry of the pattern"
    );
    let mut z: Vec<HyperDual64> = stacked(at);
    let mut r = vec![HyperDual64::from(0.0); dims.nq];
    for ((value, &row), &col) in values.iter_mut().zip(pattern.rows).zip(pattern.cols) {
        let (row, col) = (row as usize, col as usize);
        z[row].eps1 = 1.0;
        z[col].eps2 = 1.0;
        residual_at(model, dims, &z, &mut r);
        z[row].eps1 = 0.0;
        z[col].eps2 = 0.0;
        *value = lambda
            .iter()
            .zip(&r)
            .map(|(lambda, r)| lambda * r.eps1eps2)
            .sum();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cholesky_solves_and_carries_derivatives() {
        // M(t) = [[4 + t, 1], [1, 3]], f = (1, 2): x = (3·1 − 2, (4 + t)·2 − 1) / (3 (4 + t) − 1).
        let t = Dual64::new(0.5, 1.0);
        let mut m = [t + 4.0, Dual64::from(1.0), Dual64::from(3.0)];
        let mut x = [Dual64::from(1.0), Dual64::from(2.0)];
        cholesky_solve(&mut m, &mut x).unwrap();
        let determinant = 12.5;
        let expected = [
            (1.0 / determinant, -3.0 / determinant / determinant),
            (
                8.0 / determinant,
                (2.0 * determinant - 24.0) / determinant / determinant,
            ),
        ];
        for (x, (value, slope)) in x.iter().zip(expected) {
            assert!(
                (x.re - value).abs() < 1e-15 && (x.eps - slope).abs() < 1e-15,
                "{x:?}"
            );
        }
    }

    #[test]
    fn an_indefinite_or_undefined_matrix_is_refused_at_its_pivot() {
        let refused = |mut m: [f64; 3]| cholesky_solve(&mut m, &mut [1.0, 1.0]).unwrap_err();
        assert_eq!(
            refused([1.0, 2.0, 1.0]),
            SingularMassMatrix {
                index: 1,
                pivot: -3.0
            }
        );
        assert_eq!(refused([0.0, 0.0, 1.0]).index, 0);
        assert_eq!(refused([f64::NAN, 0.0, 1.0]).index, 0);
    }
}
