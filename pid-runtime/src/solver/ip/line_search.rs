//! Backtracking along a step until the filter accepts, with second-order corrections.

use super::filter::{GAMMA_PHI, GAMMA_THETA};
use super::{Iterate, Solver};

/// Switching condition: `α (−∇φᵀd)^s_φ > δ θ^s_θ`.
const S_THETA: f64 = 1.1;
const S_PHI: f64 = 2.3;
const DELTA: f64 = 1.0;
/// Armijo's constant.
const ETA: f64 = 1e-8;
/// Safety factor of the smallest step length.
const GAMMA_ALPHA: f64 = 0.05;
/// A second-order correction must shrink θ by this factor to be repeated.
const KAPPA_SOC: f64 = 0.99;

/// An accepted trial point; it stands in `Solver::trial`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Accepted {
    pub(super) alpha: f64,
    pub(super) trials: usize,
    pub(super) kind: char,
}

impl Solver<'_> {
    /// Largest step length within the bounds along `d`.
    pub(super) fn primal_fraction(&self, d: &[f64]) -> f64 {
        let tau = self.tau();
        let mut alpha = 1.0_f64;
        for (j, &d) in d.iter().enumerate() {
            if d < 0.0 && self.has_lower(j) {
                alpha = alpha.min(-tau * self.lower_gap(j) / d);
            } else if d > 0.0 && self.has_upper(j) {
                alpha = alpha.min(tau * self.upper_gap(j) / d);
            }
        }
        alpha
    }

    fn move_trial(&mut self, alpha: f64, corrected: bool) {
        let d = if corrected {
            &self.correction
        } else {
            &self.dx
        };
        for ((t, x), d) in self.trial.x.iter_mut().zip(&self.current.x).zip(d) {
            *t = x + alpha * d;
        }
        self.counts.functions += 1;
        self.timed(|s| s.trial.evaluate(s.problem, s.scale));
    }

    /// Whether the trial point is acceptable; `Some(true)` if the step decreased the objective (no filter entry needed).
    fn judge(&self, alpha: f64, slope: f64, phi: f64) -> Option<bool> {
        if !self.trial.is_finite() {
            return None;
        }
        let (theta, theta_trial) = (self.current.theta, self.trial.theta);
        let phi_trial = self.barrier_objective(&self.trial);
        // Differences below rounding count as equal.
        let noise = 10.0 * f64::EPSILON * phi.abs();
        if !phi_trial.is_finite() || !self.filter.accepts(theta_trial, phi_trial - noise) {
            return None;
        }
        let switching = slope < 0.0
            && alpha * (-slope).powf(S_PHI) > DELTA * theta.powf(S_THETA)
            && theta <= self.theta_min;
        if switching {
            (phi_trial - phi - noise <= ETA * alpha * slope).then_some(true)
        } else {
            (theta_trial <= (1.0 - GAMMA_THETA) * theta
                || phi_trial - noise <= phi - GAMMA_PHI * theta)
                .then_some(false)
        }
    }

    /// Step length below which restoration takes over (Wächter & Biegler, equation 23).
    fn smallest_step(&self, slope: f64) -> f64 {
        let theta = self.current.theta;
        let mut alpha = GAMMA_THETA;
        if slope < 0.0 {
            alpha = alpha.min(GAMMA_PHI * theta / -slope);
            if theta <= self.theta_min {
                alpha = alpha.min(DELTA * theta.powf(S_THETA) / (-slope).powf(S_PHI));
            }
        }
        GAMMA_ALPHA * alpha
    }

    /// Searches along `dx`; on success the accepted point stands in `trial` and the filter is updated.
    pub(super) fn search(&mut self) -> Option<Accepted> {
        let slope: f64 = (0..self.n)
            .map(|j| self.barrier_gradient(j) * self.dx[j])
            .sum();
        let phi = self.barrier_objective(&self.current);
        let largest = self.primal_fraction(&self.dx);
        // Below relative rounding of x a step cannot be told from none.
        let rounding = 10.0 * f64::EPSILON;
        let smallest = self.smallest_step(slope).max(rounding * 1e-3);
        let mut alpha = largest;
        let mut trials = 0;
        while alpha >= smallest {
            self.move_trial(alpha, false);
            trials += 1;
            if let Some(decrease) = self.judge(alpha, slope, phi) {
                return Some(self.accept(alpha, trials, decrease, phi, ' '));
            }
            if trials == 1
                && self.trial.is_finite()
                && self.trial.theta >= self.current.theta
                && let Some(accepted) = self.correct(alpha, slope, phi, &mut trials)
            {
                return Some(accepted);
            }
            alpha *= 0.5;
        }
        None
    }

    fn accept(
        &mut self,
        alpha: f64,
        trials: usize,
        decrease: bool,
        phi: f64,
        kind: char,
    ) -> Accepted {
        if !decrease {
            self.filter.add(self.current.theta, phi);
        }
        let kind = match (kind, decrease) {
            ('s', _) => 's',
            (_, true) => 'f',
            (_, false) => 'h',
        };
        Accepted {
            alpha,
            trials,
            kind,
        }
    }

    /// Second-order corrections: steps with the constraint values of the trial points added up.
    fn correct(
        &mut self,
        alpha: f64,
        slope: f64,
        phi: f64,
        trials: &mut usize,
    ) -> Option<Accepted> {
        let mut sum: Vec<f64> = self
            .current
            .c
            .iter()
            .zip(&self.trial.c)
            .map(|(c, t)| alpha * c + t)
            .collect();
        let mut previous = self.current.theta;
        for _ in 0..self.settings.max_corrections {
            if self.trial.theta > KAPPA_SOC * previous && previous != self.current.theta {
                return None;
            }
            previous = self.trial.theta;
            for (r, c) in self.rc.iter_mut().zip(&sum) {
                *r = -c;
            }
            let start = std::time::Instant::now();
            self.kkt.solve(
                &self.rx,
                &self.rc,
                &mut self.correction,
                &mut self.correction_lambda,
            );
            self.seconds.linear += start.elapsed().as_secs_f64();
            let along = self.primal_fraction(&self.correction);
            self.move_trial(along, true);
            *trials += 1;
            if let Some(decrease) = self.judge(alpha, slope, phi) {
                self.dlambda.copy_from_slice(&self.correction_lambda);
                std::mem::swap(&mut self.dx, &mut self.correction);
                return Some(self.accept(along, *trials, decrease, phi, 's'));
            }
            if !self.trial.is_finite() {
                return None;
            }
            for (s, t) in sum.iter_mut().zip(&self.trial.c) {
                *s = along * *s + t;
            }
        }
        None
    }

    /// Whether a point may become the next iterate after a restoration.
    pub(super) fn acceptable_after_restoration(&self, point: &Iterate) -> bool {
        self.filter
            .accepts(point.theta, self.barrier_objective(point))
    }
}
