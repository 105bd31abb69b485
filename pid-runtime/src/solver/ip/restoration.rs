//! Feasibility restoration: find a point the filter accepts, without regard to the objective.
//!
//! Damped Newton steps on the constraints, projected by a diagonal metric:
//! `min ½ ‖D (x + d − x_R)‖² − barrier  s.t.  J d = −c`, with a line search on ‖c‖₁. The KKT system is the solver's own with the
//! Hessian replaced by the metric, so that any structure is kept and the inertia is right by construction.

use super::{Iteration, Regularisation, Solver, Status};

/// Share of the entering violation at which the restoration ends.
const REDUCTION: f64 = 0.9;
/// Weight of the pull towards the entering point, times √μ.
const PULL: f64 = 1.0;

impl Solver<'_> {
    /// Restores feasibility from the current point; the filter gets the point it left.
    pub(super) fn restore(&mut self, regularisation: Regularisation) -> Result<Iteration, Status> {
        self.counts.restorations += 1;
        let entering = self.current.clone();
        let phi = self.barrier_objective(&entering);
        self.filter.add(entering.theta, phi);
        if entering.theta <= 1e-2 * self.settings.tol {
            return Err(Status::NoProgress);
        }
        let zeta = PULL * self.mu.sqrt().max(1e-6);
        let mut trials = 0;
        for _ in 0..self.settings.max_restoration {
            self.hessian.fill(0.0);
            for j in 0..self.n {
                let metric = 1.0 / entering.x[j].abs().max(1.0).powi(2);
                let mut sigma = zeta * metric;
                let mut r = -zeta * metric * (self.current.x[j] - entering.x[j]);
                if self.has_lower(j) {
                    let gap = self.lower_gap(j);
                    sigma += self.mu / (gap * gap);
                    r += self.mu / gap;
                }
                if self.has_upper(j) {
                    let gap = self.upper_gap(j);
                    sigma += self.mu / (gap * gap);
                    r -= self.mu / gap;
                }
                self.sigma[j] = sigma;
                self.rx[j] = if self.fixed[j] { 0.0 } else { r };
            }
            for (r, c) in self.rc.iter_mut().zip(&self.current.c) {
                *r = -c;
            }
            self.factorise_system()
                .map_err(|_| Status::SingularSystem)?;
            self.solve_system();
            let mut alpha = self.primal_fraction(&self.dx);
            loop {
                for ((t, x), d) in self.trial.x.iter_mut().zip(&self.current.x).zip(&self.dx) {
                    *t = x + alpha * d;
                }
                self.counts.functions += 1;
                self.timed(|s| s.trial.evaluate(s.problem, s.scale));
                trials += 1;
                if self.trial.is_finite()
                    && self.trial.theta <= (1.0 - 1e-4 * alpha) * self.current.theta
                {
                    break;
                }
                alpha *= 0.5;
                if alpha < 1e-10 {
                    let feasible = self.current.theta <= self.settings.constraint_tol;
                    return Err(if feasible {
                        Status::NoProgress
                    } else {
                        Status::LocallyInfeasible
                    });
                }
            }
            std::mem::swap(&mut self.current, &mut self.trial);
            if !self.derivatives() {
                return Err(Status::NoProgress);
            }
            if self.current.theta <= REDUCTION * entering.theta
                && self.acceptable_after_restoration(&self.current)
            {
                self.leave_restoration();
                let step = (0..self.n)
                    .map(|j| (self.current.x[j] - entering.x[j]).abs())
                    .fold(0.0_f64, f64::max);
                return Ok(self.log_line(regularisation, 0.0, alpha, trials, 'R', step));
            }
        }
        Err(Status::LocallyInfeasible)
    }

    /// Multipliers at the restored point: z from the barrier, λ by least squares.
    fn leave_restoration(&mut self) {
        for j in 0..self.n {
            if self.has_lower(j) {
                self.z_lower[j] = (self.mu / self.lower_gap(j)).min(1e3);
            }
            if self.has_upper(j) {
                self.z_upper[j] = (self.mu / self.upper_gap(j)).min(1e3);
            }
        }
        self.estimate_multipliers();
    }
}
