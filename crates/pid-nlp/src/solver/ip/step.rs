//! One iteration: linear system, step, step length, next point.

use super::{Solver, Status};
use crate::solver::kkt::{KktError, KktValues, Regularisation};
use crate::solver::outcome::Iteration;
use std::time::Instant;

/// Bound multipliers stay within this factor of μ / gap.
const KAPPA_SIGMA: f64 = 1e10;
/// Above this relative residual of the linear system its rows are relaxed.
const POOR: f64 = 1e-6;
/// Function values cannot judge steps below this share of |x| + 1.
const TINY: f64 = 10.0 * f64::EPSILON;

impl Solver<'_> {
    pub(super) fn solve_system(&mut self) -> f64 {
        let start = Instant::now();
        let residual = self
            .kkt
            .solve(&self.rx, &self.rc, &mut self.dx, &mut self.dlambda);
        self.seconds.linear += start.elapsed().as_secs_f64();
        residual
    }

    pub(super) fn factorise_system(&mut self) -> Result<Regularisation, KktError> {
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

    fn load_sigma(&mut self) {
        for j in 0..self.n {
            let mut s = 0.0;
            if self.bounds.has_lower(j) {
                s += self.z_lower[j] / self.lower_gap(j);
            }
            if self.bounds.has_upper(j) {
                s += self.z_upper[j] / self.upper_gap(j);
            }
            self.sigma[j] = s;
        }
    }

    /// ∂φ_μ/∂x_j at the current point.
    pub(super) fn barrier_gradient(&self, j: usize, mu: f64) -> f64 {
        let mut g = self.gradient[j];
        if self.bounds.has_lower(j) {
            g -= mu / self.lower_gap(j);
        }
        if self.bounds.has_upper(j) {
            g += mu / self.upper_gap(j);
        }
        g
    }

    /// Right-hand side of the Newton system for a barrier parameter.
    pub(super) fn load_rhs(&mut self, mu: f64) {
        self.rx.fill(0.0);
        let pattern = self.problem.jacobian_pattern();
        pattern.transpose_multiply_add(&self.jacobian, &self.lambda, &mut self.rx);
        for j in 0..self.n {
            self.rx[j] = if self.bounds.fixed[j] {
                0.0
            } else {
                -(self.rx[j] + self.barrier_gradient(j, mu))
            };
        }
        for (r, c) in self.rc.iter_mut().zip(&self.current.c) {
            *r = -c;
        }
    }

    /// Factorises the system at the current point; the Hessian and Σ are loaded.
    fn prepare(&mut self) -> Result<Regularisation, Status> {
        self.counts.hessians += 1;
        self.timed(|s| {
            s.problem
                .hessian(&s.current.x, 1.0, &s.lambda, &mut s.hessian);
        });
        self.load_sigma();
        self.kkt.relax(&[]);
        self.kkt.expect_error(self.error);
        self.factorise_system().map_err(|e| match e {
            KktError::NotFinite => Status::InvalidNumber,
            _ => Status::SingularSystem,
        })
    }

    /// Solves for the step; rows that depend on each other make a poor solution and are relaxed.
    fn solve_step(&mut self, regularisation: &mut Regularisation) -> Result<(), Status> {
        let residual = self.solve_system();
        if (residual > POOR || residual.is_nan()) && self.m > 0 && self.kkt.relaxable() {
            let delta = 1e-8 * self.mu.powf(0.25);
            let relaxation = vec![delta; self.m];
            self.kkt.relax(&relaxation);
            if let Ok(again) = self.factorise_system() {
                self.solve_system();
                *regularisation = again;
                regularisation.delta_c = delta;
            }
        }
        if self.dx.iter().chain(&self.dlambda).all(|v| v.is_finite()) {
            Ok(())
        } else {
            Err(Status::SingularSystem)
        }
    }

    /// Solves for the step within the radius, with that of the bounds' multipliers.
    pub(super) fn newton_step(
        &mut self,
        regularisation: &mut Regularisation,
    ) -> Result<(), Status> {
        self.load_rhs(self.mu);
        if self.radius.is_finite() {
            self.kkt.limit(self.radius);
        }
        self.solve_step(regularisation)?;
        self.length = self.kkt.limit(f64::INFINITY);
        self.dual_steps();
        Ok(())
    }

    /// One iteration: derivatives, step, line search or restoration.
    pub(super) fn iterate(&mut self) -> Result<Iteration, Status> {
        self.update_barrier()?;
        let mut regularisation = self.prepare()?;
        self.choose_barrier();
        self.heed_valley();
        self.newton_step(&mut regularisation)?;
        self.enter_valley();
        let step = self.dx.iter().fold(0.0_f64, |a, d| a.max(d.abs()));
        let tiny = self.current.theta <= 1e-4
            && self
                .dx
                .iter()
                .zip(&self.current.x)
                .all(|(d, x)| d.abs() <= TINY * (1.0 + x.abs()));
        self.tiny = if tiny || self.unmoved {
            self.tiny + 1
        } else {
            0
        };
        let found = if tiny {
            self.full_step()
        } else {
            self.search_within(&mut regularisation)?
        };
        let Some(accepted) = found else {
            if let Some(status) = self.stop_requested() {
                return Err(status);
            }
            return self.restore(regularisation);
        };
        // A watchdog that gives up returns to the step it began with.
        let alpha_dual = self.dual_fraction();
        self.unmoved = self.trial.x == self.current.x;
        std::mem::swap(&mut self.current, &mut self.trial);
        self.turns.record(self.current.theta);
        for i in 0..self.m {
            self.lambda[i] += accepted.alpha * self.dlambda[i];
        }
        for j in 0..self.n {
            self.z_lower[j] += alpha_dual * self.dz_lower[j];
            self.z_upper[j] += alpha_dual * self.dz_upper[j];
        }
        self.safeguard_multipliers();
        if !self.derivatives() {
            std::mem::swap(&mut self.current, &mut self.trial);
            return Err(Status::InvalidNumber);
        }
        Ok(Iteration {
            mu: self.mu,
            step,
            regularisation: regularisation.delta_x.max(regularisation.shift),
            alpha_dual,
            alpha: accepted.alpha,
            trials: accepted.trials,
            kind: accepted.kind,
            ..Iteration::blank(self.mu)
        })
    }

    pub(super) fn dual_steps(&mut self) {
        for j in 0..self.n {
            (self.dz_lower[j], self.dz_upper[j]) = (0.0, 0.0);
            if self.bounds.has_lower(j) {
                let gap = self.lower_gap(j);
                self.dz_lower[j] =
                    self.mu / gap - self.z_lower[j] - self.z_lower[j] / gap * self.dx[j];
            }
            if self.bounds.has_upper(j) {
                let gap = self.upper_gap(j);
                self.dz_upper[j] =
                    self.mu / gap - self.z_upper[j] + self.z_upper[j] / gap * self.dx[j];
            }
        }
    }

    pub(super) fn dual_fraction(&self) -> f64 {
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
    pub(super) fn safeguard_multipliers(&mut self) {
        for j in 0..self.n {
            if self.bounds.has_lower(j) {
                let ideal = self.mu / self.lower_gap(j);
                self.z_lower[j] = self.z_lower[j].clamp(ideal / KAPPA_SIGMA, ideal * KAPPA_SIGMA);
            }
            if self.bounds.has_upper(j) {
                let ideal = self.mu / self.upper_gap(j);
                self.z_upper[j] = self.z_upper[j].clamp(ideal / KAPPA_SIGMA, ideal * KAPPA_SIGMA);
            }
        }
    }
}
