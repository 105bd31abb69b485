//! Solving the collection and judging what comes out.

use super::Case;
use pid_nlp::solver::kkt::sparse::SparseKkt;
use pid_nlp::solver::kkt::{Kkt, KktValues};
use pid_nlp::solver::{Settings, Solution, ip, quasi_newton, sqp};
use pid_nlp::{Nlp, PointCheck, check_point};
use std::ops::ControlFlow;

/// How an outcome compares with the book.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The published optimum to 1e-6.
    Published,
    /// A local minimum, checked to second order, up to 1e-4 below the published value: the book's
    /// digits are not converged.
    Lower,
    /// A local minimum, checked to second order, with another objective.
    OtherMinimum,
    /// Neither.
    Failed,
}

/// A problem's outcome.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Number in the book.
    pub number: u32,
    /// Variables and constraints.
    pub size: (usize, usize),
    /// What the solver returned.
    pub solution: Solution,
    /// Check of its point by the problem alone.
    pub check: PointCheck,
    /// The objective to compare with.
    pub reference: f64,
    /// The comparison.
    pub verdict: Verdict,
}

impl Outcome {
    /// |f − f*| / max(1, |f*|).
    pub fn error(&self) -> f64 {
        (self.solution.objective - self.reference).abs() / self.reference.abs().max(1.0)
    }
}

/// A solver of equations and inequalities, as [`ip::solve`] with its linear system.
pub type Solver<'a> = dyn FnMut(&mut dyn Nlp, &[f64], &Settings) -> Solution + 'a;

/// The interior-point method on the sparse linear system.
pub fn interior_point(problem: &mut dyn Nlp, x0: &[f64], settings: &Settings) -> Solution {
    let mut kkt = SparseKkt::new(problem);
    ip::solve(problem, &mut kkt, x0, settings, &mut |_, _| {
        ControlFlow::Continue(())
    })
}

/// Sequential quadratic programming on the sparse linear system, with damped BFGS from the last
/// `memory` steps if stated.
pub fn sqp(
    memory: Option<usize>,
) -> impl FnMut(&mut dyn Nlp, &[f64], &Settings) -> Solution + 'static {
    move |problem, x0, settings| {
        let mut kkt = SparseKkt::new(problem);
        sqp::solve(problem, &mut kkt, x0, memory, settings, &mut |_, _| {
            ControlFlow::Continue(())
        })
    }
}

/// The interior-point method with damped BFGS from the last `memory` steps.
pub fn quasi_newton(
    memory: usize,
) -> impl FnMut(&mut dyn Nlp, &[f64], &Settings) -> Solution + 'static {
    move |problem, x0, settings| {
        let mut kkt = SparseKkt::new(problem);
        quasi_newton::solve(problem, &mut kkt, x0, memory, settings, &mut |_, _| {
            ControlFlow::Continue(())
        })
    }
}

/// Solves a problem and judges the point.
pub fn run(case: &mut Case, settings: &Settings, solver: &mut Solver<'_>) -> Outcome {
    let problem = case.problem.as_mut();
    let solution = solver(problem, &case.info.start, settings);
    let check = check_point(problem, &solution.x, &solution.lambda);
    let reference = case.info.reference();
    let mut outcome = Outcome {
        number: case.info.number,
        size: (problem.n(), problem.m()),
        reference,
        check,
        verdict: Verdict::Failed,
        solution,
    };
    let feasible = check.finite && check.primal_inf < 1e-6 && check.bound_violation < 1e-6;
    if outcome.solution.status.converged() && feasible {
        if outcome.error() < 1e-6 {
            outcome.verdict = Verdict::Published;
        } else if is_minimum(problem, &outcome.solution, &check) {
            let below = outcome.solution.objective < reference && outcome.error() < 1e-4;
            outcome.verdict = if below {
                Verdict::Lower
            } else {
                Verdict::OtherMinimum
            };
        }
    }
    outcome
}

/// Whether a point is a local minimum: stationary, and the Hessian of the Lagrangian positive on
/// the tangents of the active constraints. Curvature is asked of the inertia of
/// `[H + σ_active, Jᵀ; J, 0]` with active bounds and rows held.
fn is_minimum(problem: &mut dyn Nlp, solution: &Solution, check: &PointCheck) -> bool {
    let (n, m) = (problem.n(), problem.m());
    let scale = solution.objective.abs().max(1.0);
    if check.dual_inf > 1e-5 * scale || check.complementarity > 1e-5 * scale {
        return false;
    }
    let (mut lower, mut upper) = (vec![0.0; n], vec![0.0; n]);
    problem.bounds(&mut lower, &mut upper);
    let (mut c_lower, mut c_upper, mut c) = (vec![0.0; m], vec![0.0; m], vec![0.0; m]);
    problem.constraint_bounds(&mut c_lower, &mut c_upper);
    let x = &solution.x;
    problem.constraints(x, &mut c);
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-6 * b.abs().max(1.0);
    // Active: at the bound, or nearer to it than its multiplier is to zero.
    let active: Vec<bool> = (0..n)
        .map(|j| {
            near(x[j], lower[j])
                || near(x[j], upper[j])
                || solution.z_lower[j] > x[j] - lower[j]
                || solution.z_upper[j] > upper[j] - x[j]
        })
        .collect();
    let mut hessian = vec![0.0; problem.hessian_pattern().nnz()];
    let mut jacobian = vec![0.0; problem.jacobian_pattern().nnz()];
    problem.hessian(x, 1.0, &solution.lambda, &mut hessian);
    problem.jacobian(x, &mut jacobian);
    let mut kkt = SparseKkt::of(
        n,
        m,
        problem.hessian_pattern(),
        problem.jacobian_pattern(),
        &active,
    );
    let row = |i: usize| {
        let distance = (c[i] - c_lower[i]).abs().min((c_upper[i] - c[i]).abs());
        let near = near(c[i], c_lower[i]) || near(c[i], c_upper[i]);
        let held = near || solution.lambda[i].abs() > distance;
        if held { 1e-9 } else { 1e20 }
    };
    kkt.relax(&(0..m).map(row).collect::<Vec<f64>>());
    // A direction without curvature counts as a minimum to the tolerance of the check.
    let largest = hessian.iter().fold(0.0_f64, |a, h| a.max(h.abs()));
    let values = KktValues {
        hessian: &hessian,
        jacobian: &jacobian,
        sigma: &vec![1e-7 * largest.max(1.0); n],
    };
    kkt.factorise(values).is_ok_and(|r| r.delta_x == 0.0)
}
