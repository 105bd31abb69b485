//! Restoration for linear systems that cannot be relaxed: damped Newton steps on the constraints alone.
//!
//! `min ½ ‖D (x + d − x_R)‖² − barrier  s.t.  J d = −c`, with a line search on ‖c‖₁. The KKT system is
//! the solver's own with the Hessian replaced by the metric, so that any structure is kept and the
//! inertia is right by construction.

use super::{Iterate, Solver};

/// The restoration ends at this share of the entering violation.
pub(super) const REDUCTION: f64 = 0.9;
/// The Newton steps count as stuck below this step length.
const SHORTEST: f64 = 1e-8;

impl Solver<'_> {
    /// Takes steps until the violation is below its share and the filter accepts. Returns the last
    /// step length, or `None` if that is not reached. The current point moves in either case.
    pub(super) fn project(&mut self, entering: &Iterate, trials: &mut usize) -> Option<f64> {
        let zeta = self.mu.sqrt().max(1e-6);
        for _ in 0..self.settings.max_restoration {
            if self.stop_requested().is_some() {
                return None;
            }
            self.hessian.fill(0.0);
            for j in 0..self.n {
                let metric = 1.0 / entering.x[j].abs().max(1.0).powi(2);
                let mut sigma = zeta * metric;
                let mut r = -zeta * metric * (self.current.x[j] - entering.x[j]);
                if self.bounds.has_lower(j) {
                    let gap = self.lower_gap(j);
                    sigma += self.mu / (gap * gap);
                    r += self.mu / gap;
                }
                if self.bounds.has_upper(j) {
                    let gap = self.upper_gap(j);
                    sigma += self.mu / (gap * gap);
                    r -= self.mu / gap;
                }
                self.sigma[j] = sigma;
                self.rx[j] = if self.bounds.fixed[j] { 0.0 } else { r };
            }
            for (r, c) in self.rc.iter_mut().zip(&self.current.c) {
                *r = -c;
            }
            self.factorise_system().ok()?;
            self.solve_system();
            let tau = self.tau();
            let mut alpha = self.fraction(&self.dx, tau);
            loop {
                for ((t, x), d) in self.trial.x.iter_mut().zip(&self.current.x).zip(&self.dx) {
                    *t = x + alpha * d;
                }
                self.evaluate_trial();
                *trials += 1;
                if self.trial.is_finite()
                    && self.trial.theta <= (1.0 - 1e-4 * alpha) * self.current.theta
                {
                    break;
                }
                alpha *= 0.5;
                if alpha < SHORTEST {
                    return None;
                }
            }
            std::mem::swap(&mut self.current, &mut self.trial);
            if !self.derivatives() {
                return None;
            }
            let phi = self.barrier_objective(&self.current);
            if self.current.theta <= REDUCTION * entering.theta
                && self.filter.accepts(self.current.theta, phi)
            {
                return Some(alpha);
            }
        }
        None
    }
}
