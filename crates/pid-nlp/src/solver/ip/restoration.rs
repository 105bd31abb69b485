//! Restoration: soft steps that reduce the optimality error, then the feasibility problem by the same method.

use super::bounds::Bounds;
use super::feasibility::{Feasibility, FeasibilityKkt, RHO};
use super::filter::Filter;
use super::line_search::{Accepted, UNSEEN_REDUCTION};
use super::projection::REDUCTION;
use super::{Iterate, Solver, Status};
use crate::solver::kkt::sparse::SparseKkt;
use crate::solver::kkt::{Kkt, Regularisation};
use crate::solver::outcome::Iteration;
use crate::solver::settings::{Barrier, Settings};

/// A soft step must reduce the primal-dual error by this factor.
const SOFT_REDUCTION: f64 = 0.9999;
/// Bound multipliers above this are reset after a restoration.
const LARGEST_BOUND_MULTIPLIER: f64 = 1e3;
/// So many restored points that are feasible but refused by the filter are taken nevertheless, with
/// a new filter.
const FORGIVEN: usize = 3;
/// The violation counts as minimal if the feasibility problem has an optimality error below this.
const STATIONARY: f64 = 1e-4;

/// How the feasibility problem ended.
enum Restored {
    /// The filter accepts the point.
    Accepted,
    /// The constraints hold there, but the filter does not accept it.
    Feasible,
}

/// What a feasibility problem is solved for: a point that the filter of the iteration accepts.
struct Goal<'a> {
    filter: &'a Filter,
    bounds: &'a Bounds,
    /// Barrier parameter of the iteration.
    mu: f64,
    /// Violation where the iteration leaves.
    theta: f64,
    /// A row counts as held within this.
    tolerance: f64,
}

impl Goal<'_> {
    /// Iterates until the filter accepts the x of the feasibility problem, which then stands in `probe`.
    fn reach(&self, inner: &mut Solver<'_>, probe: &mut Iterate) -> Result<Restored, Status> {
        inner.start()?;
        loop {
            let errors = inner.errors(0.0);
            if let Some(status) = inner.stop_requested() {
                return Err(status);
            }
            let x = std::mem::take(&mut inner.current.x);
            inner.problem.probe(&x, probe);
            inner.counts.functions += 1;
            inner.current.x = x;
            if probe.is_finite() && probe.theta <= REDUCTION * self.theta {
                let phi = self.bounds.barrier(probe.f, &probe.x, self.mu);
                if self.filter.accepts(probe.theta, phi) {
                    return Ok(Restored::Accepted);
                }
            }
            let solved = errors.total <= inner.settings.tol;
            if solved || inner.iteration >= inner.settings.max_iterations {
                return self.end(probe, errors.total);
            }
            inner.iteration += 1;
            if let Err(status) = inner.iterate() {
                return match status.is_limit() {
                    true => Err(status),
                    false => self.end(probe, errors.total),
                };
            }
        }
    }

    /// How a feasibility problem ended that goes no further, with an optimality error of `error`.
    fn end(&self, probe: &Iterate, error: f64) -> Result<Restored, Status> {
        let largest = probe.c.iter().fold(0.0_f64, |a, c| a.max(c.abs()));
        if largest <= self.tolerance {
            Ok(Restored::Feasible)
        } else if error <= STATIONARY {
            Err(Status::LocallyInfeasible)
        } else {
            Err(Status::RestorationFailed)
        }
    }
}

impl Solver<'_> {
    /// ‖∇L‖₁ + ‖c‖₁ + ‖complementarity − μ‖₁ at the current point.
    fn primal_dual_error(&mut self) -> f64 {
        self.lagrangian_gradient();
        let mut error = self.current.theta;
        for j in 0..self.n {
            if !self.bounds.fixed[j] {
                error += (self.slopes[j] - self.z_lower[j] + self.z_upper[j]).abs();
            }
            if self.bounds.has_lower(j) {
                error += (self.lower_gap(j) * self.z_lower[j] - self.mu).abs();
            }
            if self.bounds.has_upper(j) {
                error += (self.upper_gap(j) * self.z_upper[j] - self.mu).abs();
            }
        }
        error
    }

    /// One step of a soft restoration: equal primal and dual step lengths, accepted if the filter
    /// accepts the point or the primal-dual error falls. The point stands in `trial`.
    pub(super) fn soft_step(&mut self) -> Option<Accepted> {
        if self.soft > self.settings.soft_restoration {
            self.soft = 0;
            return None;
        }
        let primal = self.fraction(&self.dx, self.tau());
        let alpha = primal.min(self.dual_fraction());
        for ((t, x), d) in self.trial.x.iter_mut().zip(&self.current.x).zip(&self.dx) {
            *t = x + alpha * d;
        }
        self.evaluate_trial();
        let accepted = Accepted {
            alpha,
            trials: 1,
            kind: 'S',
        };
        if !self.trial.is_finite() {
            self.soft = 0;
            return None;
        }
        let phi = self.barrier_objective(&self.trial);
        if self.filter.accepts(self.trial.theta, phi) {
            self.soft = 0;
            return Some(accepted);
        }
        let falls = self.error_falls(alpha, SOFT_REDUCTION);
        if falls {
            self.soft += 1;
            return Some(accepted);
        }
        self.soft = 0;
        None
    }

    /// Takes the full step if the constraints hold before and after it and the primal-dual error
    /// falls by much. The point stands in `trial`.
    fn step_by_error(&mut self) -> Option<Accepted> {
        let alpha = self
            .fraction(&self.dx, self.tau())
            .min(self.dual_fraction());
        self.move_trial(alpha, false);
        let better = self.feasible_trial() && self.error_falls(alpha, UNSEEN_REDUCTION);
        better.then_some(Accepted {
            alpha,
            trials: 1,
            kind: 'e',
        })
    }

    /// Whether the primal-dual error at the trial point, with multipliers moved by the same share
    /// of their steps, is at most `factor` times the current one. If not, the derivatives are again
    /// those of the current point.
    pub(super) fn error_falls(&mut self, alpha: f64, factor: f64) -> bool {
        let before = self.primal_dual_error();
        let kept = (
            self.lambda.clone(),
            self.z_lower.clone(),
            self.z_upper.clone(),
        );
        std::mem::swap(&mut self.current, &mut self.trial);
        for i in 0..self.m {
            self.lambda[i] += alpha * self.dlambda[i];
        }
        for j in 0..self.n {
            self.z_lower[j] += alpha * self.dz_lower[j];
            self.z_upper[j] += alpha * self.dz_upper[j];
        }
        let falls = self.derivatives() && self.primal_dual_error() <= factor * before;
        std::mem::swap(&mut self.current, &mut self.trial);
        (self.lambda, self.z_lower, self.z_upper) = kept;
        if !falls {
            self.derivatives();
        }
        falls
    }

    /// Takes over when the line search finds nothing; the filter gets the point that the iteration
    /// leaves.
    pub(super) fn restore(&mut self, regularisation: Regularisation) -> Result<Iteration, Status> {
        if self.nested {
            return self.close();
        }
        if self.acceptable > 0
            && let Some(accepted) = self.step_by_error()
        {
            return self.take_soft(accepted, regularisation);
        }
        if self.soft == 0 && self.settings.soft_restoration > 0 && self.current.theta > 0.0 {
            let phi = self.barrier_objective(&self.current);
            self.filter.add(self.current.theta, phi);
            self.soft = 1;
            if let Some(accepted) = self.soft_step() {
                return self.take_soft(accepted, regularisation);
            }
        }
        self.soft = 0;
        if self.acceptable > 0 {
            // The constraints hold: what the filter refuses are rounding errors.
            return Err(Status::NoProgress);
        }
        if self.settings.max_restoration == 0 {
            return Err(Status::RestorationFailed);
        }
        self.counts.restorations += 1;
        self.watchdog = None;
        self.shortened = 0;
        let entering = self.current.clone();
        let phi = self.barrier_objective(&entering);
        self.filter.add(entering.theta, phi);
        if entering.theta <= 1e-2 * self.settings.tol {
            return Err(Status::NoProgress);
        }
        let mut trials = 0;
        let mut alpha = None;
        if !self.kkt.relaxable() {
            alpha = self.project(&entering, &mut trials);
            if let Some(status) = self.stop_requested() {
                return Err(status);
            }
            if alpha.is_none() {
                self.current = entering.clone();
                self.derivatives();
            }
        }
        if alpha.is_none() {
            self.feasibility_problem(&entering, &mut trials)?;
        }
        self.leave_restoration();
        let distance = |(a, b): (&f64, &f64)| (a - b).abs();
        let step = self.current.x.iter().zip(&entering.x).map(distance);
        Ok(Iteration {
            step: step.fold(0.0, f64::max),
            regularisation: regularisation.delta_x.max(regularisation.shift),
            alpha: alpha.unwrap_or(1.0),
            trials,
            kind: 'R',
            ..Iteration::blank(self.mu)
        })
    }

    fn take_soft(
        &mut self,
        accepted: Accepted,
        regularisation: Regularisation,
    ) -> Result<Iteration, Status> {
        let alpha = accepted.alpha;
        std::mem::swap(&mut self.current, &mut self.trial);
        for i in 0..self.m {
            self.lambda[i] += alpha * self.dlambda[i];
        }
        for j in 0..self.n {
            self.z_lower[j] += alpha * self.dz_lower[j];
            self.z_upper[j] += alpha * self.dz_upper[j];
        }
        self.safeguard_multipliers();
        if !self.derivatives() {
            return Err(Status::InvalidNumber);
        }
        Ok(Iteration {
            step: self.dx.iter().fold(0.0_f64, |a, d| a.max(d.abs())),
            regularisation: regularisation.delta_x.max(regularisation.shift),
            alpha_dual: alpha,
            alpha,
            trials: accepted.trials,
            kind: accepted.kind,
            ..Iteration::blank(self.mu)
        })
    }

    /// Inside a feasibility problem: closes the rows by their slacks at the same x.
    fn close(&mut self) -> Result<Iteration, Status> {
        let theta = self.current.theta;
        let (x, c) = (&mut self.current.x, &self.current.c);
        if theta <= self.settings.tol || !self.problem.close(x, c, self.mu) {
            return Err(Status::RestorationFailed);
        }
        self.evaluate_current();
        if !self.current.is_finite() || !self.derivatives() {
            return Err(Status::RestorationFailed);
        }
        self.filter.clear();
        for j in 0..self.n {
            if self.bounds.has_lower(j) {
                self.z_lower[j] = self.mu / self.lower_gap(j);
            }
            if self.bounds.has_upper(j) {
                self.z_upper[j] = self.mu / self.upper_gap(j);
            }
        }
        self.lambda.fill(0.0);
        Ok(Iteration {
            kind: 'c',
            ..Iteration::blank(self.mu)
        })
    }

    /// Solves the feasibility problem until the filter accepts its x; moves the current point there.
    fn feasibility_problem(
        &mut self,
        entering: &Iterate,
        trials: &mut usize,
    ) -> Result<(), Status> {
        let settings = Settings {
            barrier: Barrier::Monotone,
            max_iterations: self.settings.max_restoration,
            watchdog: 0,
            soft_restoration: 0,
            ..self.settings.clone()
        };
        let mu = self
            .mu
            .max(entering.c.iter().fold(0.0, |a, c| a.max(c.abs())));
        let mut own: Option<SparseKkt> = None;
        let system: &mut dyn Kkt = if self.kkt.relaxable() {
            self.kkt.relax(&[]);
            self.kkt
        } else {
            let problem = &*self.problem;
            own.insert(SparseKkt::of(
                problem.n(),
                problem.m(),
                problem.hessian_pattern(),
                problem.jacobian_pattern(),
                &self.bounds.fixed,
            ))
        };
        let mut problem = Feasibility::new(&mut *self.problem, &entering.x, mu);
        let mut kkt = FeasibilityKkt::new(system, &problem);
        let mut inner = Solver::new(&mut problem, &mut kkt, &settings, self.started);
        inner.enter_feasibility(entering, mu, (&self.z_lower, &self.z_upper));
        let goal = Goal {
            filter: &self.filter,
            bounds: &self.bounds,
            mu: self.mu,
            theta: entering.theta,
            tolerance: self.settings.constraint_tol,
        };
        let mut probe = Iterate::new(self.n, self.m);
        let outcome = goal.reach(&mut inner, &mut probe);
        *trials += inner.iteration;
        let (counts, seconds) = (inner.counts, inner.seconds);
        self.counts.add(&counts);
        self.seconds.evaluation += seconds.evaluation;
        self.seconds.linear += seconds.linear;
        if probe.is_finite() {
            self.current = probe;
        }
        self.keep_best();
        match outcome? {
            Restored::Accepted => {}
            Restored::Feasible => {
                self.forgiven += 1;
                if self.forgiven > FORGIVEN {
                    return Err(Status::RestorationFailed);
                }
                self.filter.clear();
            }
        }
        if self.derivatives() {
            Ok(())
        } else {
            Err(Status::InvalidNumber)
        }
    }

    /// Starts a feasibility problem at the point that the iteration leaves, with the multipliers of its bounds:
    /// rows are closed by their slacks.
    fn enter_feasibility(&mut self, entering: &Iterate, mu: f64, (lower, upper): (&[f64], &[f64])) {
        let (n, m) = (entering.x.len(), entering.c.len());
        self.nested = true;
        self.mu = mu;
        self.warm = true;
        self.current.x[..n].copy_from_slice(&entering.x);
        for i in 0..m {
            let (over, under) = Feasibility::split(entering.c[i], mu);
            (self.current.x[n + i], self.current.x[n + m + i]) = (over, under);
        }
        for j in 0..n {
            self.z_lower[j] = lower[j].min(RHO);
            self.z_upper[j] = upper[j].min(RHO);
        }
        for j in n..self.n {
            self.z_lower[j] = mu / self.current.x[j];
        }
    }

    /// Multipliers at the restored point: z from the barrier, λ by least squares.
    fn leave_restoration(&mut self) {
        for j in 0..self.n {
            if self.bounds.has_lower(j) {
                self.z_lower[j] = (self.mu / self.lower_gap(j)).min(LARGEST_BOUND_MULTIPLIER);
            }
            if self.bounds.has_upper(j) {
                self.z_upper[j] = (self.mu / self.upper_gap(j)).min(LARGEST_BOUND_MULTIPLIER);
            }
        }
        self.estimate_multipliers();
    }
}
