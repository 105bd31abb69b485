//! Starting points: push off the bounds, first multipliers, warm starts.

use super::standard::Standard;
use super::{Filter, Solver};
use crate::nlp::Nlp;
use crate::solver::outcome::{Solution, Status};
use crate::solver::settings::Settings;

/// Least-squares multipliers above this are set to zero.
const LARGEST_MULTIPLIER: f64 = 1e3;

/// Where a solve begins. Multipliers are in the user's units and signs, as in [`Solution`].
#[derive(Debug, Clone, Copy)]
pub struct Start<'a> {
    /// Variables.
    pub x: &'a [f64],
    /// Multipliers of the constraints and of the lower and upper bounds, if known: a warm start,
    /// hardly pushed off the bounds.
    pub multipliers: Option<(&'a [f64], &'a [f64], &'a [f64])>,
    /// First barrier parameter; the settings' for a cold start, the mean complementarity for a warm
    /// one if absent.
    pub mu: Option<f64>,
}

impl<'a> Start<'a> {
    /// A cold start.
    pub fn at(x: &'a [f64]) -> Self {
        Self {
            x,
            multipliers: None,
            mu: None,
        }
    }

    /// A warm start from the outcome of an earlier solve of a similar problem.
    pub fn warm(solution: &'a Solution) -> Self {
        Self {
            x: &solution.x,
            multipliers: Some((&solution.lambda, &solution.z_lower, &solution.z_upper)),
            mu: None,
        }
    }

    /// How far the point is pushed off its bounds.
    pub(super) fn push(&self, settings: &Settings) -> f64 {
        if self.multipliers.is_some() {
            settings.push.min(1e-8)
        } else {
            settings.push
        }
    }

    /// Multipliers of the standard form.
    pub(super) fn standard(&self, problem: &Standard<'_>) -> Option<[Vec<f64>; 3]> {
        let (lambda, z_lower, z_upper) = self.multipliers?;
        let f = problem.f_scale;
        let rows = lambda.iter().zip(&problem.row_scale);
        let lambda: Vec<f64> = rows.map(|(l, s)| l * f / s).collect();
        let scaled = |z: &[f64]| z.iter().map(|z| z * f).collect::<Vec<f64>>();
        let (mut z_lower, mut z_upper) = (scaled(z_lower), scaled(z_upper));
        for &i in &problem.slack_rows {
            z_lower.push((-lambda[i]).max(0.0));
            z_upper.push(lambda[i].max(0.0));
        }
        Some([lambda, z_lower, z_upper])
    }
}

/// Whether a problem has rows that are no equations.
pub(super) fn has_ranges(problem: &dyn Nlp) -> bool {
    let m = problem.m();
    let (mut lower, mut upper) = (vec![0.0; m], vec![0.0; m]);
    problem.constraint_bounds(&mut lower, &mut upper);
    lower.iter().zip(&upper).any(|(l, u)| l != u)
}

impl Standard<'_> {
    /// Turns the outcome of the standard form into that of the user's problem.
    pub(super) fn recover(&mut self, solution: &mut Solution) {
        let n = self.original.fixed.len();
        solution.x.truncate(n);
        solution.z_lower.truncate(n);
        solution.z_upper.truncate(n);
        for (j, x) in solution.x.iter_mut().enumerate() {
            if !x.is_nan() {
                *x = x.clamp(self.original.lower[j], self.original.upper[j]);
            }
        }
        let f = self.f_scale;
        solution.objective /= f;
        for (l, s) in solution.lambda.iter_mut().zip(&self.row_scale) {
            *l *= s / f;
        }
        let bounds = solution.z_lower.iter_mut().chain(&mut solution.z_upper);
        bounds.for_each(|z| *z /= f);
    }
}

impl Solver<'_> {
    /// Takes over known multipliers, bounded away from zero, and the barrier parameter that fits them.
    pub(super) fn set_multipliers(&mut self, known: Option<[Vec<f64>; 3]>, mu: Option<f64>) {
        if let Some([lambda, z_lower, z_upper]) = known {
            self.lambda = lambda;
            self.warm = true;
            let smallest = self.settings.tol / 10.0;
            let (mut sum, mut count) = (0.0, 0usize);
            for j in 0..self.n {
                if self.bounds.has_lower(j) {
                    let gap = self.lower_gap(j);
                    self.z_lower[j] = z_lower[j].max(smallest / gap.max(1.0));
                    sum += self.z_lower[j] * gap;
                    count += 1;
                }
                if self.bounds.has_upper(j) {
                    let gap = self.upper_gap(j);
                    self.z_upper[j] = z_upper[j].max(smallest / gap.max(1.0));
                    sum += self.z_upper[j] * gap;
                    count += 1;
                }
            }
            let mean = sum / count.max(1) as f64;
            self.mu = mean.clamp(smallest, self.settings.mu_start);
        }
        if let Some(mu) = mu {
            self.mu = mu;
        }
    }

    /// Evaluates the start and estimates multipliers.
    pub(super) fn start(&mut self) -> Result<(), Status> {
        self.evaluate_current();
        if !self.current.is_finite() || !self.derivatives() {
            return Err(Status::CannotEvaluate);
        }
        let theta = self.current.theta;
        self.filter = Filter::new(1e4 * theta.max(1.0));
        self.theta_min = 1e-4 * theta.max(1.0);
        if !self.warm {
            self.estimate_multipliers();
        }
        Ok(())
    }

    /// Least-squares multipliers: `[I Jᵀ; J 0] (w, λ) = −(∇f − z_l + z_u, 0)`; zero when they come out large.
    pub(super) fn estimate_multipliers(&mut self) {
        self.lambda.fill(0.0);
        if self.m == 0 {
            return;
        }
        self.hessian.fill(0.0);
        for j in 0..self.n {
            self.sigma[j] = 1.0;
            self.rx[j] = -(self.gradient[j] - self.z_lower[j] + self.z_upper[j]);
        }
        self.rc.fill(0.0);
        self.kkt.relax(&[]);
        if self.factorise_system().is_ok() {
            self.solve_system();
            if self.dlambda.iter().all(|l| l.abs() <= LARGEST_MULTIPLIER) {
                self.lambda.copy_from_slice(&self.dlambda);
            }
        }
    }
}
