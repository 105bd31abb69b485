//! A primal-dual interior-point method with a filter line search.
//!
//! Follows A. Wächter, L. T. Biegler, Math. Program. 106 (2006): barrier problems
//! `min f(x) − μ Σ ln(x − l) − μ Σ ln(u − x)` subject to `c(x) = 0`, Newton steps on their primal-dual conditions,
//! fraction-to-the-boundary rule, filter, second-order corrections, feasibility restoration. What differs: the linear system
//! comes from the caller ([`Kkt`]), which also decides how the Hessian is made convex on the null space of the
//! constraints; and restoration takes damped projected Newton steps on ‖c‖² with the same system.

mod filter;
mod iterate;
mod line_search;
mod restoration;

use super::kkt::{Kkt, KktError, KktValues, Regularisation};
use super::outcome::{Counts, Iteration, Seconds, Solution, Status};
use super::settings::Settings;
use crate::nlp::Nlp;
use filter::Filter;
use iterate::Iterate;
use std::ops::ControlFlow;
use std::time::Instant;

/// Fraction-to-the-boundary parameter at large μ.
const TAU_MIN: f64 = 0.99;
/// Barrier update: μ ← max(tol/10, min(κ μ, μ^θ)).
const KAPPA_MU: f64 = 0.2;
const THETA_MU: f64 = 1.5;
/// A barrier problem is solved to this multiple of μ.
const KAPPA_EPS: f64 = 10.0;
/// Safeguard of the primal-dual Hessian of the barrier.
const KAPPA_SIGMA: f64 = 1e10;
/// Scaling of the optimality error for large multipliers.
const S_MAX: f64 = 100.0;
/// Iterations at the acceptable level after which the solver stops.
const ACCEPTABLE_ITERATIONS: usize = 15;

/// Called after every iteration with its log line and the iterate; `Break` interrupts the solve.
pub type Callback<'a> = dyn FnMut(&Iteration, &[f64]) -> ControlFlow<()> + 'a;

/// Minimises a problem from `x0`. The linear system must have been built for the same problem.
pub fn solve(
    problem: &mut dyn Nlp,
    kkt: &mut dyn Kkt,
    x0: &[f64],
    settings: &Settings,
    callback: &mut Callback<'_>,
) -> Solution {
    Solver::new(problem, kkt, x0, settings).run(callback)
}

/// Working state of a solve.
struct Solver<'a> {
    problem: &'a mut dyn Nlp,
    kkt: &'a mut dyn Kkt,
    settings: &'a Settings,
    n: usize,
    m: usize,
    lower: Vec<f64>,
    upper: Vec<f64>,
    fixed: Vec<bool>,
    /// Factor from the user's objective to the solver's.
    scale: f64,
    mu: f64,
    current: Iterate,
    trial: Iterate,
    lambda: Vec<f64>,
    z_lower: Vec<f64>,
    z_upper: Vec<f64>,
    gradient: Vec<f64>,
    jacobian: Vec<f64>,
    hessian: Vec<f64>,
    sigma: Vec<f64>,
    rx: Vec<f64>,
    rc: Vec<f64>,
    dx: Vec<f64>,
    dlambda: Vec<f64>,
    dz_lower: Vec<f64>,
    dz_upper: Vec<f64>,
    correction: Vec<f64>,
    correction_lambda: Vec<f64>,
    filter: Filter,
    theta_min: f64,
    counts: Counts,
    seconds: Seconds,
    started: Instant,
    log: Vec<Iteration>,
    best: Option<Best>,
}

/// The best point so far: converged error first, then feasibility and objective.
struct Best {
    x: Vec<f64>,
    lambda: Vec<f64>,
    theta: f64,
    objective: f64,
}

/// Optimality errors of the scaled problem.
#[derive(Debug, Clone, Copy)]
struct Errors {
    dual: f64,
    primal: f64,
    /// E_μ with the scaling of the multipliers.
    total: f64,
}

impl<'a> Solver<'a> {
    fn new(
        problem: &'a mut dyn Nlp,
        kkt: &'a mut dyn Kkt,
        x0: &[f64],
        settings: &'a Settings,
    ) -> Self {
        let (n, m) = (problem.n(), problem.m());
        let (mut lower, mut upper) = (vec![0.0; n], vec![0.0; n]);
        problem.bounds(&mut lower, &mut upper);
        let fixed: Vec<bool> = lower.iter().zip(&upper).map(|(l, u)| l == u).collect();
        let mut current = Iterate::new(n, m);
        current.x.copy_from_slice(x0);
        for j in 0..n {
            current.x[j] = interior(x0[j], lower[j], upper[j], settings.push);
        }
        let bounded = |b: f64, j: usize| if b.is_finite() && !fixed[j] { 1.0 } else { 0.0 };
        let z_lower = (0..n).map(|j| bounded(lower[j], j)).collect();
        let z_upper = (0..n).map(|j| bounded(upper[j], j)).collect();
        let (nj, nh) = (
            problem.jacobian_pattern().nnz(),
            problem.hessian_pattern().nnz(),
        );
        Self {
            problem,
            kkt,
            settings,
            n,
            m,
            lower,
            upper,
            fixed,
            scale: settings.objective_scale,
            mu: settings.mu_start,
            current,
            trial: Iterate::new(n, m),
            lambda: vec![0.0; m],
            z_lower,
            z_upper,
            gradient: vec![0.0; n],
            jacobian: vec![0.0; nj],
            hessian: vec![0.0; nh],
            sigma: vec![0.0; n],
            rx: vec![0.0; n],
            rc: vec![0.0; m],
            dx: vec![0.0; n],
            dlambda: vec![0.0; m],
            dz_lower: vec![0.0; n],
            dz_upper: vec![0.0; n],
            correction: vec![0.0; n],
            correction_lambda: vec![0.0; m],
            filter: Filter::new(f64::INFINITY),
            theta_min: 0.0,
            counts: Counts::default(),
            seconds: Seconds::default(),
            started: Instant::now(),
            log: Vec::new(),
            best: None,
        }
    }

    fn run(mut self, callback: &mut Callback<'_>) -> Solution {
        if !self.start() {
            return self.finish(Status::CannotEvaluate, f64::INFINITY);
        }
        let mut acceptable = 0;
        let mut line = self.log_line(Regularisation::default(), 0.0, 0.0, 0, ' ', 0.0);
        let mut iteration = 0;
        loop {
            let optimality = self.errors(0.0);
            line.iteration = iteration;
            line.objective = self.current.f / self.scale;
            line.primal_inf = optimality.primal;
            line.dual_inf = optimality.dual;
            line.mu = self.mu;
            self.log.push(line);
            self.keep_best();
            let interrupted = callback(&line, &self.current.x).is_break();
            if optimality.total <= self.settings.tol
                && optimality.primal <= self.settings.constraint_tol
            {
                return self.finish(Status::Solved, optimality.total);
            }
            acceptable = if optimality.total <= self.settings.acceptable_tol {
                acceptable + 1
            } else {
                0
            };
            let stop = if acceptable >= ACCEPTABLE_ITERATIONS {
                Some(Status::Acceptable)
            } else if interrupted {
                Some(Status::Interrupted)
            } else if iteration >= self.settings.max_iterations {
                Some(Status::IterationLimit)
            } else if self
                .settings
                .max_time
                .is_some_and(|t| self.started.elapsed() >= t)
            {
                Some(Status::TimeLimit)
            } else {
                None
            };
            if let Some(status) = stop {
                return self.finish(status, optimality.total);
            }
            self.update_barrier();
            line = match self.iterate() {
                Ok(line) => line,
                Err(_) if acceptable > 0 => {
                    return self.finish(Status::Acceptable, optimality.total);
                }
                Err(status) => return self.finish(status, optimality.total),
            };
            iteration += 1;
        }
    }

    /// Evaluates the start, scales the objective, estimates multipliers. False if the point cannot be evaluated.
    fn start(&mut self) -> bool {
        let x = std::mem::take(&mut self.current.x);
        self.timed(|s| s.problem.gradient(&x, &mut s.gradient));
        let largest = (0..self.n)
            .filter(|&j| !self.fixed[j])
            .fold(0.0_f64, |a, j| a.max(self.gradient[j].abs()))
            * self.scale;
        if largest > self.settings.max_gradient {
            self.scale *= self.settings.max_gradient / largest;
        }
        self.current.x = x;
        self.evaluate_current();
        if !self.current.is_finite() || !self.derivatives() {
            return false;
        }
        let theta = self.current.theta;
        self.filter = Filter::new(1e4 * theta.max(1.0));
        self.theta_min = 1e-4 * theta.max(1.0);
        self.estimate_multipliers();
        true
    }

    fn timed<T>(&mut self, work: impl FnOnce(&mut Self) -> T) -> T {
        let start = Instant::now();
        let out = work(self);
        self.seconds.evaluation += start.elapsed().as_secs_f64();
        out
    }

    fn evaluate_current(&mut self) {
        self.counts.functions += 1;
        self.timed(|s| s.current.evaluate(s.problem, s.scale));
    }

    /// Gradient and Jacobian at the current point; false if one is not finite.
    fn derivatives(&mut self) -> bool {
        self.counts.gradients += 1;
        self.timed(|s| {
            s.problem.gradient(&s.current.x, &mut s.gradient);
            s.problem.jacobian(&s.current.x, &mut s.jacobian);
        });
        self.gradient.iter_mut().for_each(|g| *g *= self.scale);
        self.gradient
            .iter()
            .chain(&self.jacobian)
            .all(|v| v.is_finite())
    }

    fn solve_system(&mut self) {
        let start = Instant::now();
        self.kkt
            .solve(&self.rx, &self.rc, &mut self.dx, &mut self.dlambda);
        self.seconds.linear += start.elapsed().as_secs_f64();
    }

    fn factorise_system(&mut self) -> Result<Regularisation, KktError> {
        let start = Instant::now();
        let values = KktValues {
            hessian: &self.hessian,
            jacobian: &self.jacobian,
            sigma: &self.sigma,
        };
        let outcome = self.kkt.factorise(values);
        self.seconds.linear += start.elapsed().as_secs_f64();
        self.counts.factorizations += outcome.map_or(1, |r| r.factorizations);
        outcome
    }

    /// Least-squares multipliers: `[I Jᵀ; J 0] (w, λ) = −(∇f − z_l + z_u, 0)`; zero when they come out large.
    fn estimate_multipliers(&mut self) {
        self.hessian.fill(0.0);
        for j in 0..self.n {
            self.sigma[j] = 1.0;
            self.rx[j] = -(self.gradient[j] - self.z_lower[j] + self.z_upper[j]);
        }
        self.rc.fill(0.0);
        self.lambda.fill(0.0);
        if self.factorise_system().is_ok() {
            self.solve_system();
            if self.dlambda.iter().all(|l| l.abs() <= 1e3) {
                self.lambda.copy_from_slice(&self.dlambda);
            }
        }
    }

    fn lower_gap(&self, j: usize) -> f64 {
        self.current.x[j] - self.lower[j]
    }

    fn upper_gap(&self, j: usize) -> f64 {
        self.upper[j] - self.current.x[j]
    }

    fn has_lower(&self, j: usize) -> bool {
        self.lower[j].is_finite() && !self.fixed[j]
    }

    fn has_upper(&self, j: usize) -> bool {
        self.upper[j].is_finite() && !self.fixed[j]
    }

    /// E_μ at the current point (Wächter & Biegler, equation 5).
    fn errors(&mut self, mu: f64) -> Errors {
        self.rx.copy_from_slice(&self.gradient);
        let pattern = self.problem.jacobian_pattern();
        pattern.transpose_multiply_add(&self.jacobian, &self.lambda, &mut self.rx);
        let (mut dual, mut complementarity, mut z_sum) = (0.0_f64, 0.0_f64, 0.0);
        let mut bounds = 0usize;
        for j in 0..self.n {
            if self.fixed[j] {
                continue;
            }
            dual = dual.max((self.rx[j] - self.z_lower[j] + self.z_upper[j]).abs());
            if self.has_lower(j) {
                complementarity =
                    complementarity.max((self.lower_gap(j) * self.z_lower[j] - mu).abs());
                z_sum += self.z_lower[j];
                bounds += 1;
            }
            if self.has_upper(j) {
                complementarity =
                    complementarity.max((self.upper_gap(j) * self.z_upper[j] - mu).abs());
                z_sum += self.z_upper[j];
                bounds += 1;
            }
        }
        let lambda_sum: f64 = self.lambda.iter().map(|l| l.abs()).sum();
        let scaled = |sum: f64, count: usize| (sum / count.max(1) as f64).max(S_MAX) / S_MAX;
        let s_dual = scaled(lambda_sum + z_sum, self.m + bounds);
        let s_comp = scaled(z_sum, bounds);
        let primal = self.current.c.iter().fold(0.0_f64, |a, c| a.max(c.abs()));
        let total = (dual / s_dual).max(primal).max(complementarity / s_comp);
        Errors {
            dual,
            primal,
            total,
        }
    }

    fn update_barrier(&mut self) {
        let smallest = self.settings.tol / 10.0;
        while self.mu > smallest && self.errors(self.mu).total <= KAPPA_EPS * self.mu {
            self.mu = smallest.max((KAPPA_MU * self.mu).min(self.mu.powf(THETA_MU)));
            self.filter.clear();
        }
    }

    fn tau(&self) -> f64 {
        TAU_MIN.max(1.0 - self.mu)
    }

    /// φ_μ at an iterate.
    fn barrier_objective(&self, point: &Iterate) -> f64 {
        let mut phi = point.f;
        for j in 0..self.n {
            if self.has_lower(j) {
                phi -= self.mu * (point.x[j] - self.lower[j]).ln();
            }
            if self.has_upper(j) {
                phi -= self.mu * (self.upper[j] - point.x[j]).ln();
            }
        }
        phi
    }

    /// ∂φ_μ/∂x_j at the current point.
    fn barrier_gradient(&self, j: usize) -> f64 {
        let mut g = self.gradient[j];
        if self.has_lower(j) {
            g -= self.mu / self.lower_gap(j);
        }
        if self.has_upper(j) {
            g += self.mu / self.upper_gap(j);
        }
        g
    }

    fn load_sigma(&mut self) {
        for j in 0..self.n {
            let mut s = 0.0;
            if self.has_lower(j) {
                s += self.z_lower[j] / self.lower_gap(j);
            }
            if self.has_upper(j) {
                s += self.z_upper[j] / self.upper_gap(j);
            }
            self.sigma[j] = s;
        }
    }

    /// One iteration: derivatives, step, line search or restoration.
    fn iterate(&mut self) -> Result<Iteration, Status> {
        self.counts.hessians += 1;
        self.timed(|s| {
            s.problem
                .hessian(&s.current.x, s.scale, &s.lambda, &mut s.hessian);
        });
        self.load_sigma();
        let regularisation = self.factorise_system().map_err(|e| match e {
            KktError::NotFinite => Status::NoProgress,
            _ => Status::SingularSystem,
        })?;
        self.rx.fill(0.0);
        let pattern = self.problem.jacobian_pattern();
        pattern.transpose_multiply_add(&self.jacobian, &self.lambda, &mut self.rx);
        for j in 0..self.n {
            self.rx[j] = if self.fixed[j] {
                0.0
            } else {
                -(self.rx[j] + self.barrier_gradient(j))
            };
        }
        for (r, c) in self.rc.iter_mut().zip(&self.current.c) {
            *r = -c;
        }
        self.solve_system();
        if !self.dx.iter().chain(&self.dlambda).all(|v| v.is_finite()) {
            return Err(Status::SingularSystem);
        }
        self.dual_steps();
        let alpha_dual = self.dual_fraction();
        let found = self.search();
        let step = self.dx.iter().fold(0.0_f64, |a, d| a.max(d.abs()));
        let Some(accepted) = found else {
            return self.restore(regularisation);
        };
        std::mem::swap(&mut self.current, &mut self.trial);
        for i in 0..self.m {
            self.lambda[i] += accepted.alpha * self.dlambda[i];
        }
        for j in 0..self.n {
            self.z_lower[j] += alpha_dual * self.dz_lower[j];
            self.z_upper[j] += alpha_dual * self.dz_upper[j];
        }
        self.safeguard_multipliers();
        if !self.derivatives() {
            return Err(Status::NoProgress);
        }
        let (alpha, trials, kind) = (accepted.alpha, accepted.trials, accepted.kind);
        Ok(self.log_line(regularisation, alpha_dual, alpha, trials, kind, step))
    }

    fn dual_steps(&mut self) {
        for j in 0..self.n {
            (self.dz_lower[j], self.dz_upper[j]) = (0.0, 0.0);
            if self.has_lower(j) {
                let gap = self.lower_gap(j);
                self.dz_lower[j] =
                    self.mu / gap - self.z_lower[j] - self.z_lower[j] / gap * self.dx[j];
            }
            if self.has_upper(j) {
                let gap = self.upper_gap(j);
                self.dz_upper[j] =
                    self.mu / gap - self.z_upper[j] + self.z_upper[j] / gap * self.dx[j];
            }
        }
    }

    fn dual_fraction(&self) -> f64 {
        let tau = self.tau();
        let mut alpha = 1.0_f64;
        let pairs = self.z_lower.iter().zip(&self.dz_lower);
        for (z, dz) in pairs.chain(self.z_upper.iter().zip(&self.dz_upper)) {
            if *dz < 0.0 {
                alpha = alpha.min(-tau * z / dz);
            }
        }
        alpha
    }

    /// Keeps z within a factor of μ / gap (Wächter & Biegler, equation 16).
    fn safeguard_multipliers(&mut self) {
        for j in 0..self.n {
            if self.has_lower(j) {
                let ideal = self.mu / self.lower_gap(j);
                self.z_lower[j] = self.z_lower[j].clamp(ideal / KAPPA_SIGMA, ideal * KAPPA_SIGMA);
            }
            if self.has_upper(j) {
                let ideal = self.mu / self.upper_gap(j);
                self.z_upper[j] = self.z_upper[j].clamp(ideal / KAPPA_SIGMA, ideal * KAPPA_SIGMA);
            }
        }
    }

    fn log_line(
        &self,
        regularisation: Regularisation,
        alpha_dual: f64,
        alpha: f64,
        trials: usize,
        kind: char,
        step: f64,
    ) -> Iteration {
        Iteration {
            iteration: 0,
            objective: 0.0,
            primal_inf: 0.0,
            dual_inf: 0.0,
            mu: self.mu,
            step,
            regularisation: regularisation.delta_x.max(regularisation.shift),
            alpha_dual,
            alpha,
            trials,
            kind,
        }
    }

    fn keep_best(&mut self) {
        let (theta, objective) = (self.current.theta, self.current.f);
        let tolerance = self.settings.constraint_tol;
        let better = self.best.as_ref().is_none_or(|b| {
            (theta.max(tolerance), objective) < (b.theta.max(tolerance), b.objective)
        });
        if better {
            match &mut self.best {
                Some(b) => {
                    b.x.copy_from_slice(&self.current.x);
                    b.lambda.copy_from_slice(&self.lambda);
                    (b.theta, b.objective) = (theta, objective);
                }
                None => {
                    self.best = Some(Best {
                        x: self.current.x.clone(),
                        lambda: self.lambda.clone(),
                        theta,
                        objective,
                    });
                }
            }
        }
    }

    fn finish(mut self, status: Status, error: f64) -> Solution {
        if !status.converged()
            && let Some(best) = self.best.take()
        {
            self.current.x = best.x;
            self.lambda = best.lambda;
            self.current.f = best.objective;
        }
        self.seconds.total = self.started.elapsed().as_secs_f64();
        let unscale = |v: Vec<f64>, s: f64| v.into_iter().map(|v| v / s).collect();
        Solution {
            status,
            objective: self.current.f / self.scale,
            x: self.current.x,
            lambda: unscale(self.lambda, self.scale),
            z_lower: unscale(self.z_lower, self.scale),
            z_upper: unscale(self.z_upper, self.scale),
            error,
            log: self.log,
            counts: self.counts,
            seconds: self.seconds,
        }
    }
}

/// A point pushed off its bounds by `push` of their distance (Wächter & Biegler, section 3.6).
fn interior(x: f64, lower: f64, upper: f64, push: f64) -> f64 {
    if lower == upper {
        return lower;
    }
    let width = upper - lower;
    let room = |bound: f64| (push * bound.abs().max(1.0)).min(push * width);
    match (lower.is_finite(), upper.is_finite()) {
        (true, true) => x.clamp(lower + room(lower), upper - room(upper)),
        (true, false) => x.max(lower + push * lower.abs().max(1.0)),
        (false, true) => x.min(upper - push * upper.abs().max(1.0)),
        (false, false) => x,
    }
}

#[cfg(test)]
mod tests;
