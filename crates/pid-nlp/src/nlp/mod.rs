//! The interface of a nonlinear program.
//!
//! ```text
//! minimise    f(x)
//! subject to  c_lower ≤ c(x) ≤ c_upper
//!             lower ≤ x ≤ upper
//! ```
//!
//! with `x ∈ Rⁿ`, `c: Rⁿ → Rᵐ`; equal bounds of a row make it an equation, and c(x) = 0 is the
//! default. The Lagrangian is `L = σ f(x) + λᵀ c(x)`: a multiplier is positive where the upper
//! bound of its row holds c back, negative at the lower one. Hessians are the lower triangle.
//! Patterns may repeat an entry: values of equal positions are summed.

mod check;

pub use check::{PointCheck, check_point};

/// Row and column of each structural non-zero, in the order in which values are written.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SparsePattern {
    /// Row of each entry.
    pub rows: Vec<u32>,
    /// Column of each entry.
    pub cols: Vec<u32>,
}

impl SparsePattern {
    /// Number of entries, repeated ones counted each time.
    pub fn nnz(&self) -> usize {
        self.rows.len()
    }

    /// Adds an entry.
    pub fn push(&mut self, row: usize, col: usize) {
        self.rows.push(row as u32);
        self.cols.push(col as u32);
    }

    /// `y += A x` for values at this pattern.
    pub fn multiply_add(&self, values: &[f64], x: &[f64], y: &mut [f64]) {
        for ((&r, &c), &a) in self.rows.iter().zip(&self.cols).zip(values) {
            y[r as usize] += a * x[c as usize];
        }
    }

    /// `y += Aᵀ x` for values at this pattern.
    pub fn transpose_multiply_add(&self, values: &[f64], x: &[f64], y: &mut [f64]) {
        for ((&r, &c), &a) in self.rows.iter().zip(&self.cols).zip(values) {
            y[c as usize] += a * x[r as usize];
        }
    }

    /// `y += S x` where the values are the lower triangle of the symmetric S.
    pub fn symmetric_multiply_add(&self, values: &[f64], x: &[f64], y: &mut [f64]) {
        for ((&r, &c), &a) in self.rows.iter().zip(&self.cols).zip(values) {
            let (r, c) = (r as usize, c as usize);
            y[r] += a * x[c];
            if r != c {
                y[c] += a * x[r];
            }
        }
    }
}

/// A nonlinear program with exact derivatives.
///
/// Evaluations write into the caller's buffers and allocate nothing; they take `&mut self` for
/// their scratch space. A value that is not finite means that the point cannot be evaluated; the
/// line search backs off.
pub trait Nlp {
    /// Number of variables.
    fn n(&self) -> usize;
    /// Number of constraints.
    fn m(&self) -> usize;
    /// Bounds on the variables, `±inf` where there is none; equal bounds fix a variable.
    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]);
    /// Bounds on c(x), length m each, `±inf` where there is none; all zero by default: c(x) = 0.
    fn constraint_bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        lower.fill(0.0);
        upper.fill(0.0);
    }
    /// f(x).
    fn objective(&mut self, x: &[f64]) -> f64;
    /// ∇f(x), length n.
    fn gradient(&mut self, x: &[f64], gradient: &mut [f64]);
    /// c(x), length m.
    fn constraints(&mut self, x: &[f64], c: &mut [f64]);
    /// Structure of ∂c/∂x.
    fn jacobian_pattern(&self) -> &SparsePattern;
    /// Values of ∂c/∂x.
    fn jacobian(&mut self, x: &[f64], values: &mut [f64]);
    /// Structure of the lower triangle of ∇²L.
    fn hessian_pattern(&self) -> &SparsePattern;
    /// Values of ∇²(σ f + λᵀ c).
    fn hessian(&mut self, x: &[f64], sigma: f64, lambda: &[f64], values: &mut [f64]);
    /// A barrier method calls this when its parameter changes, in units of the objective. A program
    /// that keeps to the inside of a set by a barrier of its own weighs that barrier anew, and
    /// leaves it out at zero. Returns whether the objective changed.
    fn barrier_changed(&mut self, mu: f64) -> bool {
        let _ = mu;
        false
    }
    /// Largest step length up to 1 along `d` that stays inside such a set: `share` of the way to
    /// its boundary where that is nearer than 1.
    fn longest_step(&self, x: &[f64], d: &[f64], share: f64) -> f64 {
        let _ = (x, d, share);
        1.0
    }
}
