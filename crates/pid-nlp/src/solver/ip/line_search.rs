//! Backtracking along a step until the filter accepts, with second-order corrections.

use super::filter::{GAMMA_PHI, GAMMA_THETA};
use super::{Iterate, Solver, Status};
use crate::solver::kkt::Regularisation;

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

/// Where integrations are solved by iteration, the barrier objective carries an evaluation error up
/// to this share of it.
const NOISE: f64 = 1e-10;
/// A step too short for the objective to judge must reduce the primal-dual error by this factor.
pub(super) const UNSEEN_REDUCTION: f64 = 0.5;

/// An accepted trial point; it stands in `Solver::trial`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Accepted {
    pub(super) alpha: f64,
    pub(super) trials: usize,
    pub(super) kind: char,
}

/// The radius shrinks to a quarter, and grows fourfold after a full step at its limit.
pub(super) const SHRINKAGE: f64 = 0.25;
pub(super) const GROWTH: f64 = 4.0;
/// A step is at its limit from this share of the radius on.
pub(super) const AT_LIMIT: f64 = 0.8;
/// A smaller radius that leaves more than this share of the step is not tried.
const SHORTER: f64 = 0.9;

/// Trial iterations of a watchdog.
const WATCHDOG_TRIALS: usize = 3;
/// In one step the barrier objective may rise by at most this many orders of magnitude above its
/// size.
const MAX_RISE: f64 = 5.0;

/// State that a watchdog needs to judge later points and to return.
pub(super) struct Watchdog {
    point: Iterate,
    lambda: Vec<f64>,
    z: [Vec<f64>; 2],
    step: [Vec<f64>; 4],
    slope: f64,
    phi: f64,
    trials: usize,
}

impl Solver<'_> {
    pub(super) fn move_trial(&mut self, alpha: f64, corrected: bool) {
        let d = if corrected {
            &self.correction
        } else {
            &self.dx
        };
        for ((t, x), d) in self.trial.x.iter_mut().zip(&self.current.x).zip(d) {
            *t = x + alpha * d;
        }
        self.evaluate_trial();
    }

    /// Slope of the barrier objective along `dx`.
    fn slope(&self) -> f64 {
        (0..self.n)
            .map(|j| self.barrier_gradient(j, self.mu) * self.dx[j])
            .sum()
    }

    /// The full step without any test; `None` if it cannot be evaluated.
    pub(super) fn full_step(&mut self) -> Option<Accepted> {
        let alpha = self.fraction(&self.dx, self.tau());
        self.move_trial(alpha, false);
        self.trial.is_finite().then_some(Accepted {
            alpha,
            trials: 1,
            kind: 't',
        })
    }

    /// Whether the trial point is acceptable; `Some(true)` if the step decreased the objective (no
    /// filter entry needed).
    fn judge(&self, alpha: f64, slope: f64, phi: f64) -> Option<bool> {
        self.judge_from(self.current.theta, alpha, slope, phi)
    }

    /// The same against the violation `theta` of an earlier point.
    fn judge_from(&self, theta: f64, alpha: f64, slope: f64, phi: f64) -> Option<bool> {
        if !self.trial.is_finite() {
            return None;
        }
        let theta_trial = self.trial.theta;
        let phi_trial = self.barrier_objective(&self.trial);
        // Differences below rounding count as equal.
        let noise = 10.0 * f64::EPSILON * phi.abs();
        if !phi_trial.is_finite() || !self.filter.accepts(theta_trial, phi_trial - noise) {
            return None;
        }
        let rise = phi_trial - phi;
        if rise > 0.0 && rise.log10() > MAX_RISE + phi.abs().log10().max(1.0) {
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

    /// Moves the slacks of the trial point to the values of their rows, which corrects the
    /// curvature of the rows without an evaluation. A trial point that is refused stays as it was.
    fn judge_reset(&mut self, alpha: f64, slope: f64, phi: f64) -> Option<bool> {
        if self.n == self.problem.visible() || !self.trial.is_finite() {
            return None;
        }
        let kept = self.trial.clone();
        let tau = self.tau();
        let moved = self
            .problem
            .reset_slacks(&mut self.trial, &self.current.x, tau);
        let judged = if moved {
            self.judge(alpha, slope, phi)
        } else {
            None
        };
        if judged.is_none() {
            self.trial = kept;
        }
        judged
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

    /// Searches along `dx`. Where the linear system can limit the step in directions that the
    /// problem hardly determines, it shortens these first and the whole step only then.
    pub(super) fn search_within(
        &mut self,
        regularisation: &mut Regularisation,
    ) -> Result<Option<Accepted>, Status> {
        let (patience, watchdog) = (self.settings.patience, self.settings.watchdog);
        if self.soft > 0 || patience == 0 || watchdog > 0 {
            return Ok(self.search());
        }
        let largest = |d: &[f64]| d.iter().fold(0.0_f64, |a, d| a.max(d.abs()));
        let mut previous = f64::INFINITY;
        while let Some(length) = self.length
            && largest(&self.dx) < SHORTER * previous
        {
            previous = largest(&self.dx);
            let full = self.fraction(&self.dx, self.tau());
            if let Some(accepted) = self.backtrack(false, self.settings.patience) {
                if accepted.alpha < 0.9 * full && accepted.kind != 's' {
                    self.radius = self.radius.min(2.0 * length * accepted.alpha / full);
                } else if length > AT_LIMIT * self.radius && !self.valley.inside() {
                    self.radius *= GROWTH;
                }
                return Ok(Some(accepted));
            }
            if self.stop_requested().is_some() {
                return Ok(None);
            }
            self.radius = SHRINKAGE * length;
            self.newton_step(regularisation)?;
        }
        Ok(self.search())
    }

    /// Searches along `dx`; on success the accepted point stands in `trial` and the filter is updated.
    pub(super) fn search(&mut self) -> Option<Accepted> {
        if self.soft > 0 {
            return self.soft_step();
        }
        if let Some(mut watchdog) = self.watchdog.take() {
            let alpha = self.fraction(&self.dx, self.tau());
            self.move_trial(alpha, false);
            let judged = self.judge_from(watchdog.point.theta, 1.0, watchdog.slope, watchdog.phi);
            if let Some(decrease) = judged {
                self.shortened = 0;
                if !decrease {
                    self.filter.add(watchdog.point.theta, watchdog.phi);
                }
                return Some(Accepted {
                    alpha,
                    trials: 1,
                    kind: 'w',
                });
            }
            watchdog.trials += 1;
            if self.trial.is_finite() && watchdog.trials < WATCHDOG_TRIALS {
                self.watchdog = Some(watchdog);
                return Some(Accepted {
                    alpha,
                    trials: 1,
                    kind: 'w',
                });
            }
            self.return_from(*watchdog)?;
            return self.backtrack(true, usize::MAX);
        }
        let begin = self.settings.watchdog > 0 && self.shortened >= self.settings.watchdog;
        if begin {
            let slope = self.slope();
            let phi = self.barrier_objective(&self.current);
            let alpha = self.fraction(&self.dx, self.tau());
            self.move_trial(alpha, false);
            if self.trial.is_finite() && self.judge(alpha, slope, phi).is_none() {
                self.watchdog = Some(Box::new(Watchdog {
                    point: self.current.clone(),
                    lambda: self.lambda.clone(),
                    z: [self.z_lower.clone(), self.z_upper.clone()],
                    step: [
                        self.dx.clone(),
                        self.dlambda.clone(),
                        self.dz_lower.clone(),
                        self.dz_upper.clone(),
                    ],
                    slope,
                    phi,
                    trials: 1,
                }));
                self.shortened = 0;
                return Some(Accepted {
                    alpha,
                    trials: 1,
                    kind: 'w',
                });
            }
        }
        self.backtrack(false, usize::MAX)
    }

    /// Goes back to the point and step a watchdog began with.
    fn return_from(&mut self, watchdog: Watchdog) -> Option<()> {
        self.current = watchdog.point;
        self.lambda = watchdog.lambda;
        [self.z_lower, self.z_upper] = watchdog.z;
        [self.dx, self.dlambda, self.dz_lower, self.dz_upper] = watchdog.step;
        self.shortened = 0;
        self.derivatives().then_some(())
    }

    /// Halves the step until a trial point is accepted, at most `most` times.
    fn backtrack(&mut self, returned: bool, most: usize) -> Option<Accepted> {
        let slope = self.slope();
        let phi = self.barrier_objective(&self.current);
        let full = self.fraction(&self.dx, self.tau());
        let largest = self.turns.share() * full;
        // A step below the relative rounding of x cannot be told from none.
        let rounding = 10.0 * f64::EPSILON;
        let smallest = self.smallest_step(slope).max(rounding * 1e-3);
        let mut alpha = largest;
        let (mut trials, mut halvings) = (0, 0);
        while alpha >= smallest && halvings <= most {
            self.move_trial(alpha, false);
            trials += 1;
            if let Some(decrease) = self.judge(alpha, slope, phi) {
                self.shortened = if trials > 1 { self.shortened + 1 } else { 0 };
                return Some(self.accept(alpha, trials, decrease, phi, ' '));
            }
            if let Some(decrease) = self.judge_reset(alpha, slope, phi) {
                self.shortened = if trials > 1 { self.shortened + 1 } else { 0 };
                return Some(self.accept(alpha, trials, decrease, phi, ' '));
            }
            if trials == 1 && !returned && self.unseen(alpha, slope, phi) {
                self.shortened = 0;
                return Some(Accepted {
                    alpha,
                    trials,
                    kind: 'e',
                });
            }
            // After a watchdog the linear system belongs to another point.
            if trials == 1
                && !returned
                && self.trial.is_finite()
                && self.trial.theta >= self.current.theta
                && let Some(accepted) = self.correct(alpha, slope, phi, &mut trials)
            {
                self.shortened = 0;
                return Some(accepted);
            }
            if self.stop_requested().is_some() {
                return None;
            }
            alpha *= 0.5;
            halvings += 1;
        }
        None
    }

    /// Whether only the primal-dual error can judge the trial point, and calls it better: the point
    /// is as feasible as the current one, and the step changes the barrier objective by less than
    /// its rounding, to first order.
    fn unseen(&mut self, alpha: f64, slope: f64, phi: f64) -> bool {
        (alpha * slope).abs() <= f64::EPSILON * phi.abs()
            && self.feasible_trial()
            && self.barrier_objective(&self.trial) - phi <= NOISE * phi.abs()
            && self.error_falls(alpha, UNSEEN_REDUCTION)
    }

    /// Whether the constraints hold to the tolerance at the current point and at the trial point.
    pub(super) fn feasible_trial(&self) -> bool {
        let holds =
            |point: &Iterate| self.problem.violation(&point.c) <= self.settings.constraint_tol;
        self.trial.is_finite() && holds(&self.current) && holds(&self.trial)
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
            let along = self.fraction(&self.correction, self.tau());
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
}
