//! Settings of the interior-point solver.

use std::time::Duration;

/// How the barrier parameter goes to zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Barrier {
    /// Each barrier problem is solved to a share of its parameter before the next one (Fiacco-McCormick).
    Monotone,
}

/// Settings of the interior-point solver.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Scaled optimality error at which the solver stops.
    pub tol: f64,
    /// Error that is good enough when 15 iterations in a row do not get below it.
    pub acceptable_tol: f64,
    /// Absolute constraint violation, ∞-norm, that `Solved` also needs.
    pub constraint_tol: f64,
    /// Iterations after which the solver stops.
    pub max_iterations: usize,
    /// Time after which the solver stops.
    pub max_time: Option<Duration>,
    /// First barrier parameter, relative to the scaled objective.
    pub mu_start: f64,
    /// Strategy for the barrier parameter.
    pub barrier: Barrier,
    /// Largest component of the scaled gradient at the start; the objective is scaled to it when it is larger.
    pub max_gradient: f64,
    /// Factor on the objective before anything else; a sum of squares divided by N wants N here.
    pub objective_scale: f64,
    /// How far a start is pushed off its bounds, relative to their distance.
    pub push: f64,
    /// Second-order corrections tried per iteration.
    pub max_corrections: usize,
    /// Iterations of a restoration phase.
    pub max_restoration: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            tol: 1e-8,
            acceptable_tol: 1e-6,
            constraint_tol: 1e-6,
            max_iterations: 1000,
            max_time: None,
            mu_start: 0.1,
            barrier: Barrier::Monotone,
            max_gradient: 100.0,
            objective_scale: 1.0,
            push: 1e-2,
            max_corrections: 4,
            max_restoration: 200,
        }
    }
}
