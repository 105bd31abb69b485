//! Sequential quadratic programming with a filter line search.
//!
//! A step d minimises the quadratic model of the Lagrangian subject to the linearised constraints
//! and the bounds; the filter of A. Wächter, L. T. Biegler (Line search filter methods for
//! nonlinear programming: motivation and global convergence, SIAM J. Optim. 16 (2005), which covers
//! this method beside the interior point) decides on its length, with a second-order correction of
//! the full step. The quadratic program is solved by the interior point of [`super::ip`] on the
//! linear system of the problem, so that its structure serves here too; H gets δ I, as much as the
//! system needs for the right inertia on the null space of the equations. Where the linearised
//! constraints contradict each other or no step length is accepted, the nearest point that
//! satisfies the constraints takes the filter's point of view as restoration.
//!
//! Near a solution the multipliers come from the quadratic program and convergence is quadratic
//! with the exact Hessian, superlinear with damped BFGS (J. Nocedal, S. J. Wright, Numerical
//! Optimization, 2nd ed. 2006, chapter 18).

mod line_search;
mod quadratic;
mod restoration;
#[cfg(test)]
mod tests;

use super::ip::{self, Callback};
use super::kkt::{Kkt, KktValues};
use super::outcome::{Counts, Iteration, Seconds, Solution, Status};
use super::quasi_newton::{self, Shared};
use super::settings::{Interrupt, Settings};
use crate::nlp::Nlp;
use crate::solver::ip::filter::Filter;
use quadratic::{Model, Quadratic, Shifted};
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

/// Scaling of the optimality error for large multipliers.
const S_MAX: f64 = 100.0;
/// Iterations of one quadratic program.
const INNER: usize = 200;
/// The method stops after this many iterations at the acceptable level.
const ACCEPTABLE_ITERATIONS: usize = 15;
/// Largest stiffness of an active bound or row.
const STIFF: f64 = 1e10;
/// Relaxation of rows that are not equations when the null space is asked for.
const FREE: f64 = 1e20;

/// Minimises a problem from `x0`, with damped BFGS from the last `memory` steps or with the
/// problem's Hessian.
///
/// Multipliers of constraints and bounds have the signs of [`ip::solve`]. `kkt` must have been
/// built for the same problem; inequality rows need one that can be relaxed, otherwise the
/// quadratic programs fall back to the sparse one.
pub fn solve(
    problem: &mut dyn Nlp,
    kkt: &mut dyn Kkt,
    x0: &[f64],
    memory: Option<usize>,
    settings: &Settings,
    callback: &mut Callback<'_>,
) -> Solution {
    match memory.filter(|_| problem.hessian_pattern().nnz() > 0) {
        None => Solver::new(problem, kkt, None, x0, settings).run(callback),
        Some(memory) => {
            let (mut wrapped, mut system, shared) = quasi_newton::wrap(problem, kkt, memory);
            Solver::new(&mut wrapped, &mut system, Some(shared), x0, settings).run(callback)
        }
    }
}

struct Solver<'a> {
    problem: &'a mut dyn Nlp,
    kkt: &'a mut dyn Kkt,
    memory: Option<Shared>,
    settings: Settings,
    lower: Vec<f64>,
    upper: Vec<f64>,
    c_lower: Vec<f64>,
    c_upper: Vec<f64>,
    scale: f64,
    model: Model,
    lambda: Vec<f64>,
    z: [Vec<f64>; 2],
    filter: Filter,
    theta_min: f64,
    counts: Counts,
    seconds: Seconds,
    started: Instant,
    log: Vec<Iteration>,
    best: Option<(f64, f64, Vec<f64>)>,
}

/// A step and the multipliers that came with it.
struct Step {
    d: Vec<f64>,
    lambda: Vec<f64>,
    z: [Vec<f64>; 2],
    slope: f64,
}

impl<'a> Solver<'a> {
    fn new(
        problem: &'a mut dyn Nlp,
        kkt: &'a mut dyn Kkt,
        memory: Option<Shared>,
        x0: &[f64],
        settings: &Settings,
    ) -> Self {
        let (n, m) = (problem.n(), problem.m());
        let (mut lower, mut upper) = (vec![0.0; n], vec![0.0; n]);
        problem.bounds(&mut lower, &mut upper);
        let (mut c_lower, mut c_upper) = (vec![0.0; m], vec![0.0; m]);
        problem.constraint_bounds(&mut c_lower, &mut c_upper);
        let inside = |(x, (l, u)): (&f64, (&f64, &f64))| x.max(*l).min(*u);
        let x = x0
            .iter()
            .zip(lower.iter().zip(&upper))
            .map(inside)
            .collect();
        let model = Model {
            x,
            f: f64::NAN,
            c: vec![0.0; m],
            gradient: vec![0.0; n],
            jacobian: vec![0.0; problem.jacobian_pattern().nnz()],
            hessian: vec![0.0; problem.hessian_pattern().nnz()],
            shift: 0.0,
        };
        Self {
            problem,
            kkt,
            memory,
            settings: settings.clone(),
            lower,
            upper,
            c_lower,
            c_upper,
            scale: settings.objective_scale,
            model,
            lambda: vec![0.0; m],
            z: [vec![0.0; n], vec![0.0; n]],
            filter: Filter::new(f64::INFINITY),
            theta_min: 0.0,
            counts: Counts::default(),
            seconds: Seconds::default(),
            started: Instant::now(),
            log: Vec::new(),
            best: None,
        }
    }

    /// Σ of the rows' distances from their ranges.
    fn theta(&self, c: &[f64]) -> f64 {
        self.distances(c).sum()
    }

    fn distances<'b>(&'b self, c: &'b [f64]) -> impl Iterator<Item = f64> + 'b {
        let ranges = self.c_lower.iter().zip(&self.c_upper);
        c.iter()
            .zip(ranges)
            .map(|(c, (l, u))| (l - c).max(c - u).max(if c.is_nan() { *c } else { 0.0 }))
    }

    fn evaluate(&mut self, x: &[f64]) -> (f64, Vec<f64>) {
        let begun = Instant::now();
        let mut c = vec![0.0; self.c_lower.len()];
        let f = self.scale * self.problem.objective(x);
        self.problem.constraints(x, &mut c);
        self.counts.functions += 1;
        self.seconds.evaluation += begun.elapsed().as_secs_f64();
        (f, c)
    }

    /// Gradient and Jacobian at the point; false if one is not finite.
    fn derivatives(&mut self) -> bool {
        let begun = Instant::now();
        let model = &mut self.model;
        self.problem.gradient(&model.x, &mut model.gradient);
        self.problem.jacobian(&model.x, &mut model.jacobian);
        model.gradient.iter_mut().for_each(|g| *g *= self.scale);
        self.counts.gradients += 1;
        self.seconds.evaluation += begun.elapsed().as_secs_f64();
        let values = model.gradient.iter().chain(&model.jacobian);
        values.into_iter().all(|v| v.is_finite())
    }

    fn hessian(&mut self) {
        let begun = Instant::now();
        let model = &mut self.model;
        self.problem
            .hessian(&model.x, self.scale, &self.lambda, &mut model.hessian);
        self.counts.hessians += 1;
        self.seconds.evaluation += begun.elapsed().as_secs_f64();
    }

    fn start(&mut self) -> Result<(), Status> {
        let x = self.model.x.clone();
        (self.model.f, self.model.c) = self.evaluate(&x);
        let theta = self.theta(&self.model.c);
        if !self.model.f.is_finite() || !theta.is_finite() || !self.derivatives() {
            return Err(Status::CannotEvaluate);
        }
        let free = |j: usize| self.lower[j] != self.upper[j];
        let steepest = (0..x.len())
            .filter(|&j| free(j))
            .fold(0.0_f64, |a, j| a.max(self.model.gradient[j].abs()));
        if steepest > self.settings.max_gradient {
            let factor = (self.settings.max_gradient / steepest).max(1e-8);
            self.scale *= factor;
            self.model.f *= factor;
            self.model.gradient.iter_mut().for_each(|g| *g *= factor);
        }
        self.filter = Filter::new(1e4 * theta.max(1.0));
        self.theta_min = 1e-4 * theta.max(1.0);
        Ok(())
    }

    /// Dual infeasibility, violation and scaled optimality error with the multipliers at hand.
    fn errors(&self) -> (f64, f64, f64) {
        let mut r = self.model.gradient.clone();
        let pattern = self.problem.jacobian_pattern();
        pattern.transpose_multiply_add(&self.model.jacobian, &self.lambda, &mut r);
        let (mut dual, mut complementarity) = (0.0_f64, 0.0_f64);
        let x = &self.model.x;
        for j in 0..x.len() {
            if self.lower[j] == self.upper[j] {
                continue;
            }
            dual = dual.max((r[j] - self.z[0][j] + self.z[1][j]).abs());
            for (z, gap) in [
                (self.z[0][j], x[j] - self.lower[j]),
                (self.z[1][j], self.upper[j] - x[j]),
            ] {
                if z > 0.0 && gap.is_finite() {
                    complementarity = complementarity.max(z * gap);
                }
            }
        }
        let ranges = self.c_lower.iter().zip(&self.c_upper);
        for ((l, c), (low, high)) in self.lambda.iter().zip(&self.model.c).zip(ranges) {
            let gap = if *l > 0.0 { high - c } else { c - low };
            if low != high && gap.is_finite() {
                complementarity = complementarity.max((l * gap).abs());
            }
        }
        let primal = self.distances(&self.model.c).fold(0.0, f64::max);
        let sum: f64 = self
            .lambda
            .iter()
            .chain(&self.z[0])
            .chain(&self.z[1])
            .map(|v| v.abs())
            .sum();
        let count = (self.lambda.len() + 2 * x.len()).max(1) as f64;
        let s = (sum / count).max(S_MAX) / S_MAX;
        (
            dual,
            primal,
            (dual / s).max(primal).max(complementarity / s),
        )
    }

    fn stop_requested(&self) -> Option<Status> {
        let flag = self.settings.interrupt.as_ref();
        if flag.is_some_and(Interrupt::is_stopped) {
            Some(Status::Interrupted)
        } else if self.time_left() == Some(Duration::ZERO) {
            Some(Status::TimeLimit)
        } else {
            None
        }
    }

    fn time_left(&self) -> Option<Duration> {
        let limit = self.settings.max_time?;
        Some(limit.saturating_sub(self.started.elapsed()))
    }

    fn keep_best(&mut self) {
        let tolerance = self.settings.constraint_tol;
        let key = (self.theta(&self.model.c).max(tolerance), self.model.f);
        if self.best.as_ref().is_none_or(|b| key < (b.0, b.1)) {
            self.best = Some((key.0, key.1, self.model.x.clone()));
        }
    }

    fn run(mut self, callback: &mut Callback<'_>) -> Solution {
        let status = match self.start() {
            Ok(()) => self.iterate(callback),
            Err(status) => status,
        };
        let (_, _, error) = self.errors();
        if !status.converged()
            && let Some((_, f, x)) = self.best.take()
        {
            (self.model.x, self.model.f) = (x, f);
        }
        let unscaled = |v: Vec<f64>| v.into_iter().map(|v| v / self.scale).collect();
        let [z_lower, z_upper] = self.z.map(unscaled);
        self.seconds.total = self.started.elapsed().as_secs_f64();
        Solution {
            status,
            objective: self.model.f / self.scale,
            lambda: unscaled(self.lambda),
            z_lower,
            z_upper,
            x: self.model.x,
            error,
            log: self.log,
            counts: self.counts,
            seconds: self.seconds,
        }
    }

    fn iterate(&mut self, callback: &mut Callback<'_>) -> Status {
        let mut line = Iteration::blank(0.0);
        let mut acceptable = 0;
        for iteration in 0.. {
            let (dual, primal, error) = self.errors();
            line.iteration = iteration;
            line.objective = self.model.f / self.scale;
            (line.primal_inf, line.dual_inf) = (primal, dual);
            self.log.push(line);
            self.keep_best();
            let interrupted = callback(&line, &self.model.x).is_break();
            let feasible = primal <= self.settings.constraint_tol;
            // The first multipliers are zero: only a step tells their size.
            if iteration > 0 && error <= self.settings.tol && feasible {
                return Status::Solved;
            }
            let near = iteration > 0 && error <= self.settings.acceptable_tol && feasible;
            acceptable = if near { acceptable + 1 } else { 0 };
            if acceptable >= ACCEPTABLE_ITERATIONS {
                return Status::Acceptable;
            }
            let largest = self.model.x.iter().fold(0.0_f64, |a, x| a.max(x.abs()));
            let bottomless = feasible && line.objective <= -self.settings.divergence;
            let far = self.settings.divergence.sqrt();
            if interrupted {
                return Status::Interrupted;
            } else if largest > self.settings.divergence || bottomless {
                return Status::Unbounded;
            } else if iteration >= self.settings.max_iterations {
                return Status::IterationLimit;
            } else if let Some(status) = self.stop_requested() {
                return status;
            }
            line = match self.advance() {
                Ok(line) => line,
                Err(status) if status.is_limit() => return status,
                Err(_) if acceptable > 0 => return Status::Acceptable,
                // Far out, the rounding of a step is larger than the step.
                Err(Status::NoProgress) if feasible && largest.max(-line.objective) >= far => {
                    return Status::Unbounded;
                }
                Err(status) => return status,
            };
        }
        Status::IterationLimit
    }

    /// One iteration.
    fn advance(&mut self) -> Result<Iteration, Status> {
        self.hessian();
        let constant = self.model.c.clone();
        let mut found = None;
        // A model that is convex only on the rows that seem active may have no minimiser, or one
        // that leads uphill.
        for equations_only in [false, true] {
            let before = self.model.shift;
            self.convexify(equations_only)?;
            if equations_only && (self.memory.is_some() || self.model.shift <= before) {
                break;
            }
            if let Some(mut step) = self.quadratic_step(&constant, None)
                && let Some(accepted) = self.search(&mut step)
            {
                found = Some((step, accepted));
                break;
            }
            if let Some(status) = self.stop_requested() {
                return Err(status);
            }
        }
        let Some((step, accepted)) = found else {
            return self.restore();
        };
        let size = step.d.iter().fold(0.0_f64, |a, d| a.max(d.abs()));
        let alpha = accepted.alpha;
        (self.model.x, self.model.f, self.model.c) = (accepted.x, accepted.f, accepted.c);
        let blend = |now: &mut [f64], then: &[f64]| {
            now.iter_mut()
                .zip(then)
                .for_each(|(a, b)| *a += alpha * (b - *a));
        };
        blend(&mut self.lambda, &step.lambda);
        blend(&mut self.z[0], &step.z[0]);
        blend(&mut self.z[1], &step.z[1]);
        if !self.derivatives() {
            return Err(Status::InvalidNumber);
        }
        Ok(Iteration {
            step: size,
            regularisation: self.model.shift,
            alpha_dual: alpha,
            alpha,
            trials: accepted.trials,
            kind: accepted.kind,
            ..Iteration::blank(0.0)
        })
    }

    /// δ that makes H + δ I positive definite on the null space of the equations and of what else
    /// is active: bounds and rows count by the stiffness z / gap and λ / gap that the interior
    /// point gives them, or not at all if `equations_only`.
    fn convexify(&mut self, equations_only: bool) -> Result<(), Status> {
        self.model.shift = 0.0;
        let model = &self.model;
        if model.hessian.iter().any(|h| !h.is_finite()) {
            return Err(Status::InvalidNumber);
        }
        if self.memory.is_some() {
            return Ok(());
        }
        let stiffness = |z: f64, gap: f64| {
            if equations_only || z <= 0.0 || !gap.is_finite() {
                0.0
            } else {
                (z / gap.max(0.0)).min(STIFF)
            }
        };
        let rows = self.c_lower.iter().zip(&self.c_upper);
        let rows = rows.zip(self.lambda.iter().zip(&model.c));
        let relaxation: Vec<f64> = rows
            .map(|((l, u), (lambda, c))| {
                if l == u {
                    0.0
                } else {
                    let gap = if *lambda > 0.0 { u - c } else { c - l };
                    1.0 / stiffness(lambda.abs(), gap).max(1.0 / FREE)
                }
            })
            .collect();
        let plain = relaxation.iter().all(|r| *r == 0.0);
        if !plain && !self.kkt.relaxable() {
            return Ok(());
        }
        let sigma: Vec<f64> = (0..model.x.len())
            .map(|j| {
                stiffness(self.z[0][j], model.x[j] - self.lower[j])
                    + stiffness(self.z[1][j], self.upper[j] - model.x[j])
            })
            .collect();
        let begun = Instant::now();
        self.kkt.relax(if plain { &[] } else { &relaxation });
        let done = self.kkt.factorise(KktValues {
            hessian: &model.hessian,
            jacobian: &model.jacobian,
            sigma: &sigma,
        });
        self.kkt.relax(&[]);
        self.seconds.linear += begun.elapsed().as_secs_f64();
        self.counts.factorizations += done.map_or(1, |d| d.factorizations);
        // A matrix that stays singular, as with rows that depend on each other, is left to the
        // quadratic program.
        self.model.shift = done.map_or(0.0, |d| d.delta_x);
        Ok(())
    }

    /// The minimiser of the model with these constants of the rows; `None` if there is none.
    fn quadratic_step(&mut self, constant: &[f64], warm: Option<&Step>) -> Option<Step> {
        let settings = Settings {
            tol: (0.01 * self.settings.tol).max(1e-11),
            acceptable_tol: 0.1 * self.settings.tol,
            constraint_tol: 0.1 * self.settings.constraint_tol,
            max_iterations: INNER,
            max_time: self.time_left(),
            interrupt: self.settings.interrupt.clone(),
            mu_start: if warm.is_some() { 1e-6 } else { 1e-2 },
            barrier: self.settings.barrier,
            max_gradient: f64::INFINITY,
            scale_constraints: false,
            ..Settings::default()
        };
        let mut program = Quadratic {
            problem: &*self.problem,
            model: &self.model,
            constant,
            memory: self.memory.as_ref(),
        };
        let mut system = Shifted {
            inner: &mut *self.kkt,
            shift: self.model.shift,
            sigma: Vec::new(),
        };
        let begun = Instant::now();
        let zero = vec![0.0; self.model.x.len()];
        let from = warm.map_or(&zero[..], |w| &w.d);
        let found = ip::solve(&mut program, &mut system, from, &settings, &mut |_, _| {
            ControlFlow::Continue(())
        });
        self.counts.factorizations += found.counts.factorizations;
        self.seconds.linear += begun.elapsed().as_secs_f64();
        let near = found.status == Status::IterationLimit || found.status == Status::NoProgress;
        let violation = found.log.last().map_or(f64::NAN, |l| l.primal_inf);
        let usable = found.status.converged() || near && violation <= settings.constraint_tol;
        let finite = found.x.iter().chain(&found.lambda).all(|v| v.is_finite());
        if !usable || !finite {
            return None;
        }
        let slope = found.x.iter().zip(&self.model.gradient);
        Some(Step {
            slope: slope.map(|(d, g)| d * g).sum(),
            d: found.x,
            lambda: found.lambda,
            z: [found.z_lower, found.z_upper],
        })
    }
}
