//! Eigenvalues of small symmetric matrices.

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::prelude::default;
use faer::{Mat, MatRef, Par};

/// `A = V diag(values) Vᵀ`, values ascending.
pub struct Eigen {
    /// V, orthogonal.
    pub vectors: Mat<f64>,
    /// The eigenvalues, ascending.
    pub values: Vec<f64>,
}

impl Eigen {
    /// Reads the lower triangle; `None` where a value is not finite. Runs on the calling thread
    /// alone, since faer with several threads rounds by their number.
    pub fn of(matrix: MatRef<'_, f64>) -> Option<Self> {
        let n = matrix.nrows();
        let (mut vectors, mut diagonal) = (Mat::zeros(n, n), Diag::zeros(n));
        let scratch =
            self_adjoint_evd_scratch::<f64>(n, ComputeEigenvectors::Yes, Par::Seq, default());
        let mut memory = MemBuffer::new(scratch);
        let stack = MemStack::new(&mut memory);
        let (s, u) = (diagonal.as_mut(), Some(vectors.as_mut()));
        self_adjoint_evd(matrix, s, u, Par::Seq, stack, default()).ok()?;
        let values = (0..n).map(|k| diagonal[k]).collect();
        Some(Self { vectors, values })
    }
}
