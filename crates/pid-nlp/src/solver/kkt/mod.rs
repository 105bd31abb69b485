//! The linear system of an interior-point iteration.
//!
//! ```text
//! [ H + Σ + R   Jᵀ    ] [ dx ]   [ rx ]
//! [ J          −δ_c I ] [ dλ ] = [ rc ]
//! ```
//!
//! `H` is the Hessian of the Lagrangian, `Σ` the diagonal of the barrier. `R ⪰ 0` is a
//! regularisation that gives the matrix exactly m negative eigenvalues, so that dx is a descent
//! direction on the null space of J. Two implementations stand behind one trait:
//! [`sparse::SparseKkt`] factorises the whole matrix, [`structured::StructuredKkt`] uses that a
//! full discretization repeats one step.

pub mod layout;
pub mod ldl;
pub mod sparse;
pub mod structured;

use faer::Mat;

/// Values of the system at one iterate. Patterns belong to the implementation and were given when
/// it was built.
#[derive(Debug, Clone, Copy)]
pub struct KktValues<'a> {
    /// Lower triangle of the Hessian of the Lagrangian, at the problem's pattern.
    pub hessian: &'a [f64],
    /// Constraint Jacobian, at the problem's pattern.
    pub jacobian: &'a [f64],
    /// Diagonal Σ, one entry per variable.
    pub sigma: &'a [f64],
}

/// Regularisation that gave the matrix the right inertia.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Regularisation {
    /// Multiple of the identity added to the Hessian (to the initial states, for the structured form).
    pub delta_x: f64,
    /// Largest eigenvalue shift in the reduced Hessian of the parameters (structured form only).
    pub shift: f64,
    /// Multiple of −I in the constraint block.
    pub delta_c: f64,
    /// Number of numeric factorizations it took.
    pub factorizations: usize,
}

/// Why a system could not be factorised.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum KktError {
    /// A value of the Hessian or the Jacobian is not finite.
    #[error("a derivative is not finite: the model cannot be evaluated at this point")]
    NotFinite,
    /// A step Jacobian with respect to the next state is singular.
    #[error(
        "the Jacobian of step {step} with respect to the next state is singular (pivot {pivot:.1e}); is the mass matrix singular there?"
    )]
    SingularStep {
        /// Index of the step, counted over all windows.
        step: usize,
        /// Size of the pivot relative to its row.
        pivot: f64,
    },
    /// No regularisation up to the limit gave the right inertia.
    #[error("the KKT matrix keeps the wrong inertia up to a regularisation of {delta:.1e}")]
    WrongInertia {
        /// The largest regularisation tried.
        delta: f64,
    },
}

/// A linear system that condenses its program to the parameters.
pub trait Condensing: Kkt {
    /// Reduced Hessian in the free parameters as computed at the last factorization, before it was
    /// made convex, and the positions of the free parameters.
    fn reduced_hessian(&self) -> (&Mat<f64>, Vec<usize>);
}

/// A factorised KKT system.
pub trait Kkt: Send {
    /// Factorises the system and regularises it until it has exactly m negative eigenvalues and no zero one.
    ///
    /// # Errors
    /// [`KktError`] when no regularisation helps or a value is not finite.
    fn factorise(&mut self, values: KktValues<'_>) -> Result<Regularisation, KktError>;

    /// Solves with the last factorization, refined on the (regularised) matrix. Lengths: n, m, n, m.
    /// Returns the relative residual that is left.
    fn solve(&mut self, rx: &[f64], rc: &[f64], dx: &mut [f64], dlambda: &mut [f64]) -> f64;

    /// Whether [`Kkt::relax`] takes effect.
    fn relaxable(&self) -> bool {
        false
    }

    /// Sets a diagonal D ≥ 0, one entry per row, for the factorizations that follow: the constraint
    /// block becomes −D, rows `J dx − D dλ = rc`. Slacks of inequalities and of a feasibility
    /// problem are eliminated into it. Empty for D = 0. Implementations that are not
    /// [`Kkt::relaxable`] ignore it.
    fn relax(&mut self, diagonal: &[f64]) {
        let _ = diagonal;
    }

    /// Announces the optimality error of the iterate before its factorization, ∞ if unknown.
    /// Regularisation of directions that hardly matter shrinks with the error, so that convergence
    /// stays fast (D. Li, M. Fukushima, L. Qi, N. Yamashita, Regularized Newton methods for convex
    /// minimization problems with singular solutions, Comput. Optim. Appl. 28 (2004)). No effect by
    /// default.
    fn expect_error(&mut self, error: f64) {
        let _ = error;
    }

    /// Limits the Euclidean norm of the parameters' part of the next solution to `radius` by
    /// raising the smallest eigenvalues of the reduced Hessian. Solves after it keep the matrix
    /// until the next factorization or limit. Returns that norm for the current solution, or `None`
    /// where there is no such part or no solution yet; then the call has no effect.
    ///
    /// In directions that the data hardly determine, Newton's step is long and means nothing, and a
    /// line search shortens the determined directions with it. Raising eigenvalues shortens these
    /// directions alone (J. J. Moré, D. C. Sorensen, Computing a trust region step, SIAM J. Sci.
    /// Stat. Comput. 4 (1983)) and costs no factorization.
    fn limit(&mut self, radius: f64) -> Option<f64> {
        let _ = radius;
        None
    }

    /// Names the solution to which the next [`Kkt::limit`] applies, if it is not that of the last
    /// solve: one of several solves with the last factorization that make up one step. No effect by
    /// default.
    fn remember(&mut self, dx: &[f64]) {
        let _ = dx;
    }

    /// Covariance-like inverse of the reduced Hessian in the given variables: the block of the
    /// inverse KKT matrix, row-major `vars.len()²`. Uses the last factorization.
    fn inverse_block(&mut self, vars: &[usize], n: usize, m: usize) -> Vec<f64> {
        let k = vars.len();
        let mut out = vec![0.0; k * k];
        let (mut rx, rc) = (vec![0.0; n], vec![0.0; m]);
        let (mut dx, mut dl) = (vec![0.0; n], vec![0.0; m]);
        for (i, &var) in vars.iter().enumerate() {
            rx[var] = 1.0;
            self.solve(&rx, &rc, &mut dx, &mut dl);
            rx[var] = 0.0;
            for (j, &other) in vars.iter().enumerate() {
                out[i * k + j] = dx[other];
            }
        }
        out
    }
}
