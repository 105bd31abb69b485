//! The Hessian in the free parameters: its eigenvalues are made positive, and its steps are
//! shortened where it says little.

use crate::eigen::Eigen;
use crate::solver::kkt::KktError;
use faer::Mat;

/// Eigenvalues of the reduced Hessian below this share of the largest one are rounding errors and
/// are lifted to it. Active bounds make the largest one as large as 1e8; a share of 1e-9 would
/// already slow down identifiable directions.
const FLOOR: f64 = 1e-14;
/// Smallest eigenvalue that is kept, in the scaled problem: 1e-5 far from the solution, 1e-3 of the
/// optimality error near it (a constant one would make lifted directions converge linearly), and
/// never below 1e-7, since rounding in redundant directions then costs hundreds of iterations.
const SMALLEST: f64 = 1e-5;
const SHARE: f64 = 1e-3;
const LEAST: f64 = 1e-7;

/// Dense, np × np.
pub(super) struct Reduced {
    /// As computed.
    pub(super) hessian: Mat<f64>,
    /// The matrix whose addition makes it positive definite.
    pub(super) modification: Mat<f64>,
    vectors: Mat<f64>,
    /// Eigenvalues as computed, and as used.
    computed: Vec<f64>,
    eigenvalues: Vec<f64>,
    /// Part of the right-hand side along each eigenvector in the first pass of a solve.
    along: Vec<f64>,
    /// Limit of the next solution's norm; that norm in the last solution, NaN before the first.
    radius: Option<f64>,
    norm: f64,
    /// Eigenvalues below this are lifted to it.
    pub(super) smallest: f64,
}

impl Reduced {
    pub(super) fn new(np: usize) -> Self {
        Self {
            hessian: Mat::zeros(np, np),
            modification: Mat::zeros(np, np),
            vectors: Mat::zeros(np, np),
            computed: vec![0.0; np],
            eigenvalues: vec![0.0; np],
            along: vec![0.0; np],
            radius: None,
            norm: f64::NAN,
            smallest: SMALLEST,
        }
    }

    /// Adapts the smallest eigenvalue that is kept to the optimality error. NaN removes the
    /// adaptation.
    pub(super) fn expect_error(&mut self, error: f64) {
        self.smallest = match error.is_nan() {
            true => SMALLEST,
            false => (SHARE * error).clamp(LEAST, SMALLEST),
        };
    }

    /// Limits the next solution's norm; the norm of the last one, `None` before the first.
    pub(super) fn limit(&mut self, radius: f64) -> Option<f64> {
        if self.norm.is_nan() {
            return None;
        }
        self.radius = radius.is_finite().then_some(radius);
        Some(self.norm)
    }

    /// Removes the limit.
    pub(super) fn unlimited(&mut self) {
        self.radius = None;
    }

    /// Stores the norm of a solution.
    pub(super) fn remember(&mut self, step: &[f64]) {
        self.norm = step.iter().map(|d| d * d).sum::<f64>().sqrt();
    }

    /// Makes the Hessian positive definite; returns the largest shift of an eigenvalue.
    pub(super) fn convexify(&mut self) -> Result<f64, KktError> {
        let np = self.computed.len();
        if np == 0 {
            return Ok(0.0);
        }
        let eigen = Eigen::of(self.hessian.as_ref()).ok_or(KktError::NotFinite)?;
        let largest = eigen.values.iter().fold(0.0_f64, |a, e| a.max(e.abs()));
        if !largest.is_finite() {
            return Err(KktError::NotFinite);
        }
        let floor = (FLOOR * largest).max(self.smallest);
        (self.vectors, self.computed) = (eigen.vectors, eigen.values);
        Ok(self.lift(floor))
    }

    /// Solves with the convex Hessian, within the limit if there is one.
    pub(super) fn solve(&mut self, rhs: &[f64], step: &mut [f64]) {
        for (k, along) in self.along.iter_mut().enumerate() {
            let terms = rhs.iter().enumerate();
            *along = terms.map(|(i, r)| self.vectors[(i, k)] * r).sum();
        }
        if let Some(radius) = self.radius.take() {
            let floor = self.floor_within(radius);
            if floor > 0.0 {
                self.lift(floor);
            }
        }
        step.fill(0.0);
        for (k, (along, eigenvalue)) in self.along.iter().zip(&self.eigenvalues).enumerate() {
            let coefficient = along / eigenvalue;
            for (i, d) in step.iter_mut().enumerate() {
                *d += coefficient * self.vectors[(i, k)];
            }
        }
    }

    /// Takes the eigenvalues' absolute values, at least `floor`; returns the largest change.
    fn lift(&mut self, floor: f64) -> f64 {
        let np = self.computed.len();
        let u = &self.vectors;
        self.modification.fill(0.0);
        let mut shift = 0.0_f64;
        for k in 0..np {
            let lifted = self.computed[k].abs().max(floor);
            let change = lifted - self.computed[k];
            self.eigenvalues[k] = lifted;
            if change != 0.0 {
                shift = shift.max(change);
                for j in 0..np {
                    for i in 0..np {
                        self.modification[(i, j)] += change * u[(i, k)] * u[(j, k)];
                    }
                }
            }
        }
        shift
    }

    /// The smallest lift of the eigenvalues with which the step along the eigenvectors is no longer
    /// than `radius`.
    fn floor_within(&self, radius: f64) -> f64 {
        let norm = |floor: f64| {
            let terms = self.along.iter().zip(&self.eigenvalues);
            let square = |(r, e): (&f64, &f64)| (r / e.max(floor)).powi(2);
            terms.map(square).sum::<f64>().sqrt()
        };
        let total = self.along.iter().map(|r| r * r).sum::<f64>().sqrt();
        let (mut low, mut high) = (0.0, total / radius);
        if norm(low) <= radius {
            return low;
        }
        if !high.is_finite() {
            return low;
        }
        // `high` shortens every component; nine tenths of the radius are close enough.
        for _ in 0..60 {
            let middle = if low > 0.0 {
                (low * high).sqrt()
            } else {
                high * 1e-3
            };
            let found = norm(middle);
            if found > radius {
                low = middle;
            } else {
                high = middle;
                if found > 0.9 * radius {
                    break;
                }
            }
        }
        high
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_eigenvalues_are_raised_to_a_share_of_the_largest() {
        let mut reduced = Reduced::new(2);
        reduced.hessian[(0, 0)] = 1e12;
        let shift = reduced.convexify().unwrap();
        assert!((shift - 1e-2).abs() < 1e-9, "{shift}");
        let mut step = [0.0; 2];
        reduced.solve(&[1e12, 1.0], &mut step);
        assert!((step[0] - 1.0).abs() < 1e-12, "determined directions stay");
        assert!((step[1] / 1e2 - 1.0).abs() < 1e-6, "{}", step[1]);
        let whole = reduced.hessian[(1, 1)] + reduced.modification[(1, 1)];
        assert!(
            (whole * step[1] - 1.0).abs() < 1e-9,
            "it is the matrix that refinement uses"
        );
    }
}
