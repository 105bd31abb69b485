//! Products of tall matrices of derivatives, and derivatives that neighbouring fits share.

use faer::{Accum, MatMut, MatRef, Par};
use nalgebra::DMatrix;

/// Derivatives along a basis with their products, for fits nearby to borrow.
#[derive(Debug, Clone)]
pub struct Slopes {
    /// Innovations × directions of the basis.
    pub j: DMatrix<f64>,
    /// `jᵀ j`.
    pub gram: DMatrix<f64>,
}

impl Slopes {
    /// The first columns of a matrix of derivatives and of its products.
    pub fn first(mut j: DMatrix<f64>, products: &DMatrix<f64>, columns: usize) -> Self {
        j.resize_horizontally_mut(columns, 0.0);
        Slopes {
            j,
            gram: products.view((0, 0), (columns, columns)).into_owned(),
        }
    }
}

/// `aᵀ b` by blocks, on one thread: the result does not depend on how many there are.
pub(crate) fn cross(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(a.ncols(), b.ncols());
    if out.is_empty() || a.nrows() == 0 {
        return out;
    }
    let (rows, columns) = out.shape();
    let into = MatMut::from_column_major_slice_mut(out.as_mut_slice(), rows, columns);
    faer::linalg::matmul::matmul(
        into,
        Accum::Replace,
        view(a).transpose(),
        view(b),
        1.0,
        Par::Seq,
    );
    out
}

fn view(a: &DMatrix<f64>) -> MatRef<'_, f64> {
    MatRef::from_column_major_slice(a.as_slice(), a.nrows(), a.ncols())
}

/// `aᵀ a`.
pub(crate) fn gram(a: &DMatrix<f64>) -> DMatrix<f64> {
    cross(a, a)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_those_of_the_definition() {
        let a = DMatrix::from_fn(1003, 7, |i, j| ((3 * i + 7 * j) as f64).sin());
        let b = DMatrix::from_fn(1003, 3, |i, j| ((5 * i + j * j) as f64).cos());
        for (x, y) in [(&a, &b), (&a, &a), (&b, &a)] {
            let expected =
                DMatrix::from_fn(x.ncols(), y.ncols(), |i, j| x.column(i).dot(&y.column(j)));
            assert!((cross(x, y) - expected).amax() < 1e-10);
        }
        assert_eq!(gram(&a), cross(&a, &a));
        // Frozen directions, and records too short for a row.
        assert_eq!(
            cross(&DMatrix::zeros(4, 0), &DMatrix::zeros(4, 2)).shape(),
            (0, 2)
        );
        assert_eq!(gram(&DMatrix::zeros(0, 2)), DMatrix::zeros(2, 2));
    }

    #[test]
    fn shared_derivatives_are_the_first_columns() {
        let j = DMatrix::from_fn(20, 5, |i, j| (i * j) as f64);
        let shared = Slopes::first(j.clone(), &gram(&j), 3);
        assert_eq!(shared.j, j.columns(0, 3).into_owned());
        assert!((gram(&shared.j) - &shared.gram).amax() < 1e-9);
    }
}
