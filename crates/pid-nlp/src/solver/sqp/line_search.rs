//! The length of a step, by the filter.

use super::{Solver, Step};
use crate::solver::ip::filter::{GAMMA_PHI, GAMMA_THETA};

/// Switching condition and Armijo's constant, as in the interior point.
const S_THETA: f64 = 1.1;
const S_PHI: f64 = 2.3;
const ETA: f64 = 1e-4;
/// A restoration begins below this step length.
const SHORTEST: f64 = 1e-8;

/// A point that the line search accepted.
pub(super) struct Accepted {
    pub(super) x: Vec<f64>,
    pub(super) f: f64,
    pub(super) c: Vec<f64>,
    pub(super) alpha: f64,
    pub(super) trials: usize,
    pub(super) kind: char,
}

impl Solver<'_> {
    /// Whether the filter accepts; `Some(true)` for a sufficient decrease of the objective.
    fn judge(&self, theta: f64, f: f64, alpha: f64, slope: f64) -> Option<bool> {
        let current = self.theta(&self.model.c);
        let noise = 10.0 * f64::EPSILON * self.model.f.abs().max(1e-8);
        if !f.is_finite() || !theta.is_finite() || !self.filter.accepts(theta, f - noise) {
            return None;
        }
        let switching = slope < 0.0
            && current <= self.theta_min
            && alpha * (-slope).powf(S_PHI) > current.powf(S_THETA);
        if switching {
            (f - noise <= self.model.f + ETA * alpha * slope).then_some(true)
        } else {
            let better = theta <= (1.0 - GAMMA_THETA) * current
                || f - noise <= self.model.f - GAMMA_PHI * current;
            better.then_some(false)
        }
    }

    fn moved(&self, d: &[f64], alpha: f64) -> Vec<f64> {
        let bounds = self.lower.iter().zip(&self.upper);
        let steps = self.model.x.iter().zip(d).zip(bounds);
        steps
            .map(|((x, d), (l, u))| (x + alpha * d).max(*l).min(*u))
            .collect()
    }

    /// Backtracks along the step, with a second-order correction of the full one, whose multipliers
    /// then replace the step's.
    pub(super) fn search(&mut self, step: &mut Step) -> Option<Accepted> {
        let current = self.theta(&self.model.c);
        let (mut alpha, mut trials) = (1.0, 0);
        while alpha >= SHORTEST {
            let x = self.moved(&step.d, alpha);
            let (f, c) = self.evaluate(&x);
            trials += 1;
            let theta = self.theta(&c);
            if let Some(decrease) = self.judge(theta, f, alpha, step.slope) {
                return Some(self.accept(x, f, c, alpha, trials, decrease));
            }
            if trials == 1
                && theta.is_finite()
                && theta >= current
                && self.settings.max_corrections > 0
                && let Some((corrected, x, f, c)) = self.corrected(step, &c)
            {
                trials += 1;
                let theta = self.theta(&c);
                if let Some(decrease) = self.judge(theta, f, 1.0, step.slope) {
                    *step = corrected;
                    let mut accepted = self.accept(x, f, c, 1.0, trials, decrease);
                    accepted.kind = 's';
                    return Some(accepted);
                }
            }
            if self.stop_requested().is_some() {
                return None;
            }
            alpha *= 0.5;
        }
        None
    }

    /// The step that also takes the curvature of the rows, as the trial point shows it, out of them.
    fn corrected(&mut self, step: &Step, c: &[f64]) -> Option<(Step, Vec<f64>, f64, Vec<f64>)> {
        let back: Vec<f64> = step.d.iter().map(|d| -d).collect();
        let mut constant = c.to_vec();
        let pattern = self.problem.jacobian_pattern();
        pattern.multiply_add(&self.model.jacobian, &back, &mut constant);
        let corrected = self.quadratic_step(&constant, Some(step))?;
        let x = self.moved(&corrected.d, 1.0);
        let (f, c) = self.evaluate(&x);
        Some((corrected, x, f, c))
    }

    fn accept(
        &mut self,
        x: Vec<f64>,
        f: f64,
        c: Vec<f64>,
        alpha: f64,
        trials: usize,
        decrease: bool,
    ) -> Accepted {
        if !decrease {
            self.filter.add(self.theta(&self.model.c), self.model.f);
        }
        Accepted {
            x,
            f,
            c,
            alpha,
            trials,
            kind: if decrease { 'f' } else { 'h' },
        }
    }
}
