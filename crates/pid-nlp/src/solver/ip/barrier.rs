//! The barrier parameter: monotone, or chosen anew in every iteration while that helps.
//!
//! Free and monotone mode alternate as in J. Nocedal, A. Wächter, R. A. Waltz, Adaptive barrier
//! update strategies for nonlinear interior methods, SIAM J. Optim. 19 (2009), sections 3 to 5:
//! free mode lasts while the optimality error falls below that of the last few iterates.

use super::{Solver, Status};
use crate::solver::settings::{Barrier, Oracle};
use std::collections::VecDeque;

/// Barrier update: μ ← max(tol/10, min(κ μ, μ^θ)).
const KAPPA_MU: f64 = 0.2;
const THETA_MU: f64 = 1.5;
/// A barrier problem is solved to this multiple of μ.
const KAPPA_EPS: f64 = 10.0;
/// The error of a free iteration must fall below 0.9999 times the largest of the last four.
const REFERENCES: usize = 4;
const PROGRESS: f64 = 0.9999;
/// Monotone mode begins with this share of the mean complementarity.
const MONOTONE_START: f64 = 0.8;

/// State of the barrier parameter's strategy.
#[derive(Debug)]
pub(super) struct Schedule {
    oracle: Option<Oracle>,
    free: bool,
    errors: VecDeque<f64>,
    largest: f64,
}

impl Schedule {
    pub(super) fn new(barrier: Barrier) -> Self {
        let oracle = match barrier {
            Barrier::Monotone => None,
            Barrier::Adaptive(oracle) => Some(oracle),
        };
        Self {
            oracle,
            free: oracle.is_some(),
            errors: VecDeque::new(),
            largest: 0.0,
        }
    }

    fn progresses(&self, error: f64) -> bool {
        let highest = self.errors.iter().fold(0.0_f64, |a, e| a.max(*e));
        self.errors.len() < REFERENCES || error <= PROGRESS * highest
    }

    fn remember(&mut self, error: f64) {
        if self.errors.len() == REFERENCES {
            self.errors.pop_front();
        }
        self.errors.push_back(error);
    }
}

impl Solver<'_> {
    fn smallest_mu(&self) -> f64 {
        self.settings.tol / 10.0
    }

    fn set_mu(&mut self, mu: f64) {
        if mu == self.mu {
            return;
        }
        self.mu = mu;
        self.filter.clear();
        self.watchdog = None;
        self.shortened = 0;
        if self.problem.barrier_changed(mu) {
            self.evaluate_current();
            let (x, gradient) = (&self.current.x, &mut self.gradient);
            self.problem.gradient(x, gradient);
        }
    }

    /// Mean and smallest complementarity product.
    fn complementarity(&self) -> (f64, f64) {
        let (mut sum, mut smallest) = (0.0, f64::INFINITY);
        for j in 0..self.n {
            if self.bounds.has_lower(j) {
                let product = self.lower_gap(j) * self.z_lower[j];
                sum += product;
                smallest = smallest.min(product);
            }
            if self.bounds.has_upper(j) {
                let product = self.upper_gap(j) * self.z_upper[j];
                sum += product;
                smallest = smallest.min(product);
            }
        }
        (sum / self.bounds.count.max(1) as f64, smallest)
    }

    /// Mean squared violation of the optimality conditions.
    fn squared_error(&mut self) -> f64 {
        self.lagrangian_gradient();
        let (mut dual, mut complementarity) = (0.0, 0.0);
        for j in 0..self.n {
            if !self.bounds.fixed[j] {
                dual += (self.slopes[j] - self.z_lower[j] + self.z_upper[j]).powi(2);
            }
            if self.bounds.has_lower(j) {
                complementarity += (self.lower_gap(j) * self.z_lower[j]).powi(2);
            }
            if self.bounds.has_upper(j) {
                complementarity += (self.upper_gap(j) * self.z_upper[j]).powi(2);
            }
        }
        let primal: f64 = self.current.c.iter().map(|c| c * c).sum();
        let mean = |sum: f64, count: usize| sum / count.max(1) as f64;
        mean(dual, self.n) + mean(primal, self.m) + mean(complementarity, self.bounds.count)
    }

    /// Monotone updates, and the change between the modes. Tiny steps force an update, and end the
    /// solve if no update is left.
    pub(super) fn update_barrier(&mut self) -> Result<(), Status> {
        let stuck = self.tiny >= 2;
        if stuck && self.mu <= self.smallest_mu() {
            // Steps that are small only beside the size of x go on.
            let largest = self.current.x.iter().fold(0.0_f64, |a, x| a.max(x.abs()));
            return Err(if largest >= self.settings.divergence.sqrt() {
                Status::Unbounded
            } else {
                Status::NoProgress
            });
        }
        if self.schedule.oracle.is_some() {
            let error = self.squared_error();
            let (mean, _) = self.complementarity();
            if self.schedule.largest == 0.0 {
                self.schedule.largest = 1e3 * mean.max(self.smallest_mu());
            }
            if self.schedule.progresses(error) && !stuck {
                self.schedule.remember(error);
                self.schedule.free = true;
                return Ok(());
            }
            if self.schedule.free {
                self.schedule.free = false;
                let largest = self.schedule.largest;
                let mu = (MONOTONE_START * mean).clamp(self.smallest_mu(), largest);
                self.set_mu(mu);
                return Ok(());
            }
        }
        let smallest = self.smallest_mu();
        let mut forced = stuck;
        while self.mu > smallest && (forced || self.errors(self.mu).total <= KAPPA_EPS * self.mu) {
            forced = false;
            let mu = smallest.max((KAPPA_MU * self.mu).min(self.mu.powf(THETA_MU)));
            self.set_mu(mu);
        }
        Ok(())
    }

    /// In free mode, asks the oracle for the next parameter; the system is factorised.
    pub(super) fn choose_barrier(&mut self) {
        let (Some(oracle), true) = (self.schedule.oracle, self.schedule.free) else {
            return;
        };
        let (mean, smallest) = self.complementarity();
        let mu = if self.bounds.count == 0 {
            self.smallest_mu()
        } else {
            mean * match oracle {
                Oracle::Loqo => {
                    let evenness = smallest / mean;
                    0.1 * (0.05 * (1.0 - evenness) / evenness).min(2.0).powi(3)
                }
                Oracle::Probing => self.probe(mean),
                Oracle::Quality => self.quality(mean),
            }
        };
        let mu = mu.clamp(self.smallest_mu(), self.schedule.largest);
        self.set_mu(mu);
    }

    /// Mehrotra's centring parameter from the affine step.
    fn probe(&mut self, mean: f64) -> f64 {
        self.step_for(0.0);
        let primal = self.fraction(&self.dx, 1.0);
        let dual = self.dual_fraction_to(1.0);
        let mut sum = 0.0;
        for j in 0..self.n {
            if self.bounds.has_lower(j) {
                sum += (self.lower_gap(j) + primal * self.dx[j])
                    * (self.z_lower[j] + dual * self.dz_lower[j]);
            }
            if self.bounds.has_upper(j) {
                sum += (self.upper_gap(j) - primal * self.dx[j])
                    * (self.z_upper[j] + dual * self.dz_upper[j]);
            }
        }
        let after = sum / self.bounds.count as f64;
        (after / mean).powi(3).min(100.0)
    }

    /// Step with barrier parameter `mu` into `dx`, `dlambda`, `dz`.
    fn step_for(&mut self, mu: f64) {
        let kept = std::mem::replace(&mut self.mu, mu);
        self.load_rhs(mu);
        self.solve_system();
        self.dual_steps();
        self.mu = kept;
    }

    fn dual_fraction_to(&self, tau: f64) -> f64 {
        let pairs = self.z_lower.iter().zip(&self.dz_lower);
        let pairs = pairs.chain(self.z_upper.iter().zip(&self.dz_upper));
        pairs.fold(
            1.0,
            |a, (z, dz)| if *dz < 0.0 { a.min(-tau * z / dz) } else { a },
        )
    }

    /// The centring parameter that minimises the linear model of the optimality error, by golden
    /// section over log σ.
    fn quality(&mut self, mean: f64) -> f64 {
        // The step is affine in σ: affine part at σ = 0, centring part the difference to σ = 1.
        self.step_for(mean);
        let centred = [
            self.dx.clone(),
            self.dz_lower.clone(),
            self.dz_upper.clone(),
        ];
        self.step_for(0.0);
        let affine = [
            self.dx.clone(),
            self.dz_lower.clone(),
            self.dz_upper.clone(),
        ];
        self.lagrangian_gradient();
        let dual: f64 = (0..self.n)
            .filter(|&j| !self.bounds.fixed[j])
            .map(|j| (self.slopes[j] - self.z_lower[j] + self.z_upper[j]).powi(2))
            .sum::<f64>()
            / self.n.max(1) as f64;
        let primal: f64 = self.current.c.iter().map(|c| c * c).sum::<f64>() / self.m.max(1) as f64;
        let (tau, count) = (self.tau(), self.bounds.count as f64);
        let mut model = |log_sigma: f64| {
            let sigma = log_sigma.exp();
            let mix = |k: usize, j: usize| affine[k][j] + sigma * (centred[k][j] - affine[k][j]);
            for j in 0..self.n {
                self.dx[j] = mix(0, j);
                self.dz_lower[j] = mix(1, j);
                self.dz_upper[j] = mix(2, j);
            }
            let alpha = self.fraction(&self.dx, tau);
            let alpha_dual = self.dual_fraction_to(tau);
            let mut sum = 0.0;
            for j in 0..self.n {
                if self.bounds.has_lower(j) {
                    sum += ((self.lower_gap(j) + alpha * self.dx[j])
                        * (self.z_lower[j] + alpha_dual * self.dz_lower[j]))
                        .powi(2);
                }
                if self.bounds.has_upper(j) {
                    sum += ((self.upper_gap(j) - alpha * self.dx[j])
                        * (self.z_upper[j] + alpha_dual * self.dz_upper[j]))
                        .powi(2);
                }
            }
            (1.0 - alpha_dual).powi(2) * dual + (1.0 - alpha).powi(2) * primal + sum / count
        };
        let (mut a, mut b) = (1e-6_f64.ln(), 100.0_f64.ln());
        let ratio = 0.5 * (5.0_f64.sqrt() - 1.0);
        let (mut c, mut d) = (b - ratio * (b - a), a + ratio * (b - a));
        let (mut fc, mut fd) = (model(c), model(d));
        for _ in 0..12 {
            if fc <= fd {
                (b, d, fd) = (d, c, fc);
                c = b - ratio * (b - a);
                fc = model(c);
            } else {
                (a, c, fc) = (c, d, fd);
                d = a + ratio * (b - a);
                fd = model(d);
            }
        }
        (0.5 * (a + b)).exp()
    }
}
