//! A primal-dual interior-point method with a filter line search.
//!
//! Follows A. Wächter, L. T. Biegler, Math. Program. 106 (2006): barrier problems
//! `min f(x) − μ Σ ln(x − l) − μ Σ ln(u − x)` subject to `c(x) = 0`, Newton steps on their
//! primal-dual conditions, fraction-to-the-boundary rule, filter, second-order corrections,
//! watchdog, feasibility restoration. Inequalities get slacks, and rows are scaled, before the
//! method sees them; the restoration phase is the same method on a feasibility problem. Two things
//! differ. The caller gives the linear system ([`Kkt`]), which also decides how the Hessian is made
//! convex on the null space of the constraints. Systems that cannot be relaxed first restore by
//! projected Newton steps on the constraints.

mod barrier;
mod bounds;
mod feasibility;
pub(super) mod filter;
mod iterate;
mod line_search;
mod program;
mod projection;
mod restoration;
mod standard;
mod start;
mod step;
mod turns;
mod valley;

use super::kkt::Kkt;
use super::kkt::sparse::SparseKkt;
use super::outcome::{Counts, Iteration, Seconds, Solution, Status};
use super::settings::Settings;
use crate::nlp::Nlp;
use barrier::Schedule;
use bounds::Bounds;
use filter::Filter;
use iterate::Iterate;
use line_search::Watchdog;
use program::Program;
use standard::{Standard, StandardKkt};
pub use start::Start;
use std::ops::ControlFlow;
use std::time::Instant;
use turns::Turns;
use valley::Valley;

/// Fraction-to-the-boundary parameter at large μ.
const TAU_MIN: f64 = 0.99;
/// Scaling of the optimality error for large multipliers.
const S_MAX: f64 = 100.0;
/// The solver stops after this many iterations at the acceptable level that did not halve the
/// optimality error.
const ACCEPTABLE_ITERATIONS: usize = 15;
const WORTHWHILE: f64 = 0.5;

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
    solve_from(problem, kkt, &Start::at(x0), settings, callback)
}

/// Minimises a problem from a start that may know multipliers (warm start).
///
/// Inequality rows need a linear system that can be relaxed ([`Kkt::relaxable`]); if `kkt` cannot,
/// [`SparseKkt`] takes its place.
pub fn solve_from(
    problem: &mut dyn Nlp,
    kkt: &mut dyn Kkt,
    start: &Start<'_>,
    settings: &Settings,
    callback: &mut Callback<'_>,
) -> Solution {
    let (n, m) = (problem.n(), problem.m());
    let started = Instant::now();
    let mut own = None;
    let needs_relaxing = start::has_ranges(problem);
    let system: &mut dyn Kkt = if needs_relaxing && !kkt.relaxable() {
        own.insert(SparseKkt::new(problem))
    } else {
        kkt
    };
    let push = start.push(settings);
    let (mut standard, x) = Standard::new(problem, start.x, push, settings);
    let mut adapted = StandardKkt::new(system, n, m, &standard.slack_rows);
    let warm = start.standard(&standard);
    let mut solver = Solver::new(&mut standard, &mut adapted, settings, started);
    solver.current.x.copy_from_slice(&x);
    solver.set_multipliers(warm, start.mu);
    let status = solver.run(callback);
    let mut solution = solver.finish(status);
    standard.recover(&mut solution);
    solution
}

/// Working state of a solve.
struct Solver<'a> {
    problem: &'a mut dyn Program,
    kkt: &'a mut dyn Kkt,
    settings: Settings,
    n: usize,
    m: usize,
    bounds: Bounds,
    mu: f64,
    schedule: Schedule,
    current: Iterate,
    trial: Iterate,
    lambda: Vec<f64>,
    z_lower: Vec<f64>,
    z_upper: Vec<f64>,
    /// Whether the multipliers came with the start.
    warm: bool,
    gradient: Vec<f64>,
    jacobian: Vec<f64>,
    hessian: Vec<f64>,
    sigma: Vec<f64>,
    /// ∇f + Jᵀλ for the errors. It is kept apart from the right-hand side, which second-order
    /// corrections use again.
    slopes: Vec<f64>,
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
    /// Limit of the step, if the linear system has one, and the norm in the current step that it
    /// limits.
    radius: f64,
    length: Option<f64>,
    /// Successive iterations with shortened steps.
    shortened: usize,
    watchdog: Option<Box<Watchdog>>,
    /// Successive soft restoration steps; 0 outside of one.
    soft: usize,
    /// Successive steps below the resolution of x.
    tiny: usize,
    /// Whether the last accepted step was too short to change x.
    unmoved: bool,
    /// Detects iterates that alternate.
    turns: Turns,
    /// The last step, if it led along a valley.
    valley: Valley,
    /// Depth of restoration.
    nested: bool,
    /// Restorations that ended at a feasible point which the filter refuses.
    forgiven: usize,
    /// Successive iterations at the acceptable level since the optimality error was last halved,
    /// and that error.
    acceptable: usize,
    accepted: f64,
    iteration: usize,
    counts: Counts,
    seconds: Seconds,
    started: Instant,
    log: Vec<Iteration>,
    best: Option<Best>,
    error: f64,
}

/// The best point so far: feasibility first, then objective.
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
        problem: &'a mut dyn Program,
        kkt: &'a mut dyn Kkt,
        settings: &Settings,
        started: Instant,
    ) -> Self {
        let (n, m) = (problem.n(), problem.m());
        let (mut lower, mut upper) = (vec![0.0; n], vec![0.0; n]);
        problem.bounds(&mut lower, &mut upper);
        let bounds = Bounds::new(lower, upper);
        let present = |has: bool| if has { 1.0 } else { 0.0 };
        let z_lower = (0..n).map(|j| present(bounds.has_lower(j))).collect();
        let z_upper = (0..n).map(|j| present(bounds.has_upper(j))).collect();
        let (nj, nh) = (
            problem.jacobian_pattern().nnz(),
            problem.hessian_pattern().nnz(),
        );
        Self {
            problem,
            kkt,
            settings: settings.clone(),
            n,
            m,
            bounds,
            mu: settings.mu_start,
            schedule: Schedule::new(settings.barrier),
            current: Iterate::new(n, m),
            trial: Iterate::new(n, m),
            lambda: vec![0.0; m],
            z_lower,
            z_upper,
            warm: false,
            gradient: vec![0.0; n],
            jacobian: vec![0.0; nj],
            hessian: vec![0.0; nh],
            sigma: vec![0.0; n],
            slopes: vec![0.0; n],
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
            radius: f64::INFINITY,
            length: None,
            shortened: 0,
            watchdog: None,
            soft: 0,
            tiny: 0,
            unmoved: false,
            turns: Turns::new(),
            valley: Valley::default(),
            nested: false,
            forgiven: 0,
            acceptable: 0,
            accepted: f64::INFINITY,
            iteration: 0,
            counts: Counts::default(),
            seconds: Seconds::default(),
            started,
            log: Vec::new(),
            best: None,
            error: f64::INFINITY,
        }
    }

    fn run(&mut self, callback: &mut Callback<'_>) -> Status {
        self.problem.barrier_changed(self.mu);
        if let Err(status) = self.start() {
            return status;
        }
        let mut line = Iteration::blank(self.mu);
        loop {
            let errors = self.errors(0.0);
            self.error = errors.total;
            line.iteration = self.iteration;
            line.objective = self.current.f / self.problem.scale();
            line.primal_inf = errors.primal;
            line.dual_inf = errors.dual;
            line.mu = self.mu;
            self.log.push(line);
            self.keep_best();
            let visible = self.problem.visible();
            let interrupted = callback(&line, &self.current.x[..visible]).is_break();
            if let Some(status) = self.finished(&errors, interrupted) {
                return status;
            }
            self.iteration += 1;
            line = match self.iterate() {
                Ok(line) => line,
                Err(Status::LocallyInfeasible) => return Status::LocallyInfeasible,
                Err(status) if status.is_limit() => return status,
                Err(_) if self.acceptable > 0 => return Status::Acceptable,
                Err(status) => return status,
            };
        }
    }

    /// Whether the iteration ends at this point, and why.
    fn finished(&mut self, errors: &Errors, interrupted: bool) -> Option<Status> {
        let feasible = self.problem.violation(&self.current.c) <= self.settings.constraint_tol;
        if errors.total <= self.settings.tol && feasible {
            return Some(Status::Solved);
        }
        if errors.total > self.settings.acceptable_tol || !feasible {
            (self.acceptable, self.accepted) = (0, f64::INFINITY);
        } else if errors.total <= WORTHWHILE * self.accepted {
            (self.acceptable, self.accepted) = (1, errors.total);
        } else {
            self.acceptable += 1;
        }
        let largest = self.current.x.iter().fold(0.0_f64, |a, x| a.max(x.abs()));
        let bottomless =
            feasible && self.current.f / self.problem.scale() <= -self.settings.divergence;
        if self.acceptable >= ACCEPTABLE_ITERATIONS {
            Some(Status::Acceptable)
        } else if interrupted {
            Some(Status::Interrupted)
        } else if largest > self.settings.divergence || bottomless {
            Some(Status::Unbounded)
        } else if self.iteration >= self.settings.max_iterations {
            Some(Status::IterationLimit)
        } else {
            self.stop_requested()
        }
    }

    /// Limits that hold at any place of the method.
    fn stop_requested(&self) -> Option<Status> {
        let flag = self.settings.interrupt.as_ref();
        if flag.is_some_and(super::settings::Interrupt::is_stopped) {
            Some(Status::Interrupted)
        } else if self
            .settings
            .max_time
            .is_some_and(|t| self.started.elapsed() >= t)
        {
            Some(Status::TimeLimit)
        } else {
            None
        }
    }

    fn timed<T>(&mut self, work: impl FnOnce(&mut Self) -> T) -> T {
        let start = Instant::now();
        let out = work(self);
        self.seconds.evaluation += start.elapsed().as_secs_f64();
        out
    }

    fn evaluate_current(&mut self) {
        self.counts.functions += 1;
        self.timed(|s| s.current.evaluate(s.problem));
    }

    fn evaluate_trial(&mut self) {
        self.counts.functions += 1;
        self.timed(|s| s.trial.evaluate(s.problem));
    }

    /// Gradient and Jacobian at the current point; false if one is not finite.
    fn derivatives(&mut self) -> bool {
        self.counts.gradients += 1;
        self.timed(|s| {
            s.problem.gradient(&s.current.x, &mut s.gradient);
            s.problem.jacobian(&s.current.x, &mut s.jacobian);
        });
        self.gradient
            .iter()
            .chain(&self.jacobian)
            .all(|v| v.is_finite())
    }

    fn lower_gap(&self, j: usize) -> f64 {
        self.current.x[j] - self.bounds.lower[j]
    }

    fn upper_gap(&self, j: usize) -> f64 {
        self.bounds.upper[j] - self.current.x[j]
    }

    fn tau(&self) -> f64 {
        TAU_MIN.max(1.0 - self.mu)
    }

    /// Largest step length up to 1 along `d` that stays inside the bounds and inside the program's
    /// own set.
    fn fraction(&self, d: &[f64], tau: f64) -> f64 {
        let within = self.bounds.fraction(&self.current.x, d, tau);
        within.min(self.problem.longest_step(&self.current.x, d, tau))
    }

    /// φ_μ at an iterate.
    fn barrier_objective(&self, point: &Iterate) -> f64 {
        self.bounds.barrier(point.f, &point.x, self.mu)
    }

    /// ∇f + Jᵀλ into `slopes`.
    fn lagrangian_gradient(&mut self) {
        self.slopes.copy_from_slice(&self.gradient);
        let pattern = self.problem.jacobian_pattern();
        pattern.transpose_multiply_add(&self.jacobian, &self.lambda, &mut self.slopes);
    }

    /// E_μ at the current point (Wächter & Biegler, equation 5).
    fn errors(&mut self, mu: f64) -> Errors {
        self.lagrangian_gradient();
        let (mut dual, mut complementarity, mut z_sum) = (0.0_f64, 0.0_f64, 0.0);
        for j in 0..self.n {
            if self.bounds.fixed[j] {
                continue;
            }
            dual = dual.max((self.slopes[j] - self.z_lower[j] + self.z_upper[j]).abs());
            if self.bounds.has_lower(j) {
                let product = self.lower_gap(j) * self.z_lower[j];
                complementarity = complementarity.max((product - mu).abs());
                z_sum += self.z_lower[j];
            }
            if self.bounds.has_upper(j) {
                let product = self.upper_gap(j) * self.z_upper[j];
                complementarity = complementarity.max((product - mu).abs());
                z_sum += self.z_upper[j];
            }
        }
        let lambda_sum: f64 = self.lambda.iter().map(|l| l.abs()).sum();
        let scaled = |sum: f64, count: usize| (sum / count.max(1) as f64).max(S_MAX) / S_MAX;
        let s_dual = scaled(lambda_sum + z_sum, self.m + self.bounds.count);
        let s_comp = scaled(z_sum, self.bounds.count);
        let primal = self.current.c.iter().fold(0.0_f64, |a, c| a.max(c.abs()));
        let total = (dual / s_dual).max(primal).max(complementarity / s_comp);
        Errors {
            dual,
            primal,
            total,
        }
    }

    fn keep_best(&mut self) {
        if !self.current.is_finite() {
            return;
        }
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

    /// The outcome in the standard form: the best point if the solve did not converge.
    fn finish(mut self, status: Status) -> Solution {
        if !status.converged()
            && let Some(best) = self.best.take()
        {
            self.current.x = best.x;
            self.lambda = best.lambda;
            self.current.f = best.objective;
        }
        self.seconds.total = self.started.elapsed().as_secs_f64();
        Solution {
            status,
            objective: self.current.f,
            x: self.current.x,
            lambda: self.lambda,
            z_lower: self.z_lower,
            z_upper: self.z_upper,
            error: self.error,
            log: self.log,
            counts: self.counts,
            seconds: self.seconds,
        }
    }
}

#[cfg(test)]
mod tests;
