//! Positions of points of a robot.

use std::fmt;

/// Positions of points fixed to links in the base frame, with exact derivatives by the coordinates.
///
/// With n points, positions are `3 n` numbers: x, y and z of the first point, then of the next one,
/// m. Evaluation allocates nothing after the first call on a thread.
pub trait ForwardKinematics: fmt::Debug + Send + Sync {
    /// Names of the points.
    fn points(&self) -> &[String];
    /// Writes the positions, `3 n`.
    fn positions(&self, q: &[f64], p: &[f64], x: &mut [f64]);
    /// Writes the positions and ∂x/∂q, row by row, `3 n × nq`.
    fn jacobian(&self, q: &[f64], p: &[f64], x: &mut [f64], slope: &mut [f64]);
    /// Places (row ≥ column) of the lower triangle of `∂²(λᵀx)/∂q²` that are not zero everywhere.
    fn hessian_places(&self) -> &[(usize, usize)];
    /// Writes the values at these places; `lambda` has `3 n` entries.
    fn hessian(&self, q: &[f64], p: &[f64], lambda: &[f64], values: &mut [f64]);
}
