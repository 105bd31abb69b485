//! Independent check of a point that a solver returned.

use super::Nlp;

/// How far a point is from satisfying the first-order conditions, recomputed from the problem itself.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PointCheck {
    /// f(x).
    pub objective: f64,
    /// Largest violation of a bound on c(x); ‖c(x)‖∞ for equations c(x) = 0.
    pub primal_inf: f64,
    /// Largest violation of a bound.
    pub bound_violation: f64,
    /// Natural residual of stationarity, ‖x − clamp(x − (∇f + Jᵀλ), lower, upper)‖∞ over the
    /// variables that are not fixed, and |λ_i| of rows whose multiplier pushes towards a bound that
    /// is not there.
    pub dual_inf: f64,
    /// Largest |component of ∇f + Jᵀλ| · distance to the bound it pushes against, and |λ_i| ·
    /// distance to the row's bound: complementarity without the solver's z.
    pub complementarity: f64,
    /// Whether every number that went into the check was finite.
    pub finite: bool,
}

/// Recomputes feasibility and stationarity at `(x, lambda)` from the problem, not from the solver's
/// figures.
///
/// Stationarity with bounds is measured by the natural residual `x − clamp(x − g, lower, upper)`,
/// `g = ∇f + Jᵀλ`, which is zero exactly at first-order points (Facchinei & Pang,
/// Finite-Dimensional Variational Inequalities, 2003, section 1.5).
pub fn check_point(problem: &mut dyn Nlp, x: &[f64], lambda: &[f64]) -> PointCheck {
    let (n, m) = (problem.n(), problem.m());
    let (mut lower, mut upper) = (vec![0.0; n], vec![0.0; n]);
    problem.bounds(&mut lower, &mut upper);
    let objective = problem.objective(x);
    let mut gradient = vec![0.0; n];
    problem.gradient(x, &mut gradient);
    let mut c = vec![0.0; m];
    problem.constraints(x, &mut c);
    let mut values = vec![0.0; problem.jacobian_pattern().nnz()];
    problem.jacobian(x, &mut values);
    problem
        .jacobian_pattern()
        .transpose_multiply_add(&values, lambda, &mut gradient);

    let (mut c_lower, mut c_upper) = (vec![0.0; m], vec![0.0; m]);
    problem.constraint_bounds(&mut c_lower, &mut c_upper);
    let mut primal_inf = 0.0_f64;
    let (mut bound_violation, mut dual_inf, mut complementarity) = (0.0_f64, 0.0_f64, 0.0_f64);
    for i in 0..m {
        primal_inf = primal_inf.max(c_lower[i] - c[i]).max(c[i] - c_upper[i]);
        if c_lower[i] == c_upper[i] || lambda[i] == 0.0 {
            continue;
        }
        let distance = if lambda[i] > 0.0 {
            c_upper[i] - c[i]
        } else {
            c[i] - c_lower[i]
        };
        if distance.is_finite() {
            complementarity = complementarity.max(lambda[i].abs() * distance.max(0.0));
        } else {
            dual_inf = dual_inf.max(lambda[i].abs());
        }
    }
    let mut finite = objective.is_finite() && c.iter().chain(&values).all(|v| v.is_finite());
    for j in 0..n {
        finite &= x[j].is_finite() && gradient[j].is_finite();
        bound_violation = bound_violation.max(lower[j] - x[j]).max(x[j] - upper[j]);
        if lower[j] == upper[j] {
            continue;
        }
        let g = gradient[j];
        let step = (x[j] - g).clamp(lower[j], upper[j]);
        dual_inf = dual_inf.max((x[j] - step).abs());
        let distance = if g > 0.0 {
            x[j] - lower[j]
        } else {
            upper[j] - x[j]
        };
        if distance.is_finite() {
            complementarity = complementarity.max(g.abs() * distance.max(0.0));
        }
    }
    PointCheck {
        objective,
        primal_inf,
        bound_violation: bound_violation.max(0.0),
        dual_inf,
        complementarity,
        finite,
    }
}
