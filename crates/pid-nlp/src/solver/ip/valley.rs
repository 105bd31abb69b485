//! Shorter steps along curved valleys.
//!
//! Near the solution a step may lead along directions that the problem hardly determines and change
//! the objective by little more than its rounding. If such a valley is curved, the optimality error
//! after the step grows with the square of its length. The next step takes that back and brings its
//! own, so the iterates creep. The slope along the valley, at the length of the step, explains part
//! of the error (the pull). An error that the pull does not explain asks for a shorter step in
//! these directions.

use super::Solver;
use super::line_search::{AT_LIMIT, GROWTH, SHRINKAGE};

/// A step leads along a valley if it changes the barrier objective by less than this share, to
/// first order.
const UNTOLD: f64 = 1e-8;
/// A step is expected to leave at most this share of the error before it.
const EXPECTED: f64 = 0.5;
/// If the optimality error after a step exceeds 3 times the pull, the valley's curvature caused it:
/// shorten. Up to 2 times the pull, the slope alone explains it: lengthen.
const FOREIGN: f64 = 3.0;
const OWN: f64 = 2.0;
/// After a step of length s proved too long, later steps of this barrier problem have at most
/// length s/2.
const LESS: f64 = 0.5;

/// A step that the objective could not judge.
#[derive(Debug, Clone, Copy)]
struct Step {
    mu: f64,
    /// Optimality error before it.
    error: f64,
    length: f64,
    /// Slope of the Lagrangian along the step, at the length of the step.
    pull: f64,
}

/// The last step, if it led along a valley, and the shortest step that was too long.
#[derive(Debug, Default)]
pub(super) struct Valley {
    last: Option<Step>,
    /// Barrier parameter and length of the shortest step that was too long.
    refused: Option<(f64, f64)>,
}

impl Valley {
    /// Whether the last step led along a valley.
    pub(super) fn inside(&self) -> bool {
        self.last.is_some()
    }

    /// The radius of the next step, from the radius of the last one and the error after it.
    fn radius(&mut self, mu: f64, error: f64, radius: f64) -> f64 {
        let Some(step) = self.last.filter(|s| s.mu == mu) else {
            return radius;
        };
        let refused = self.refused.filter(|r| r.0 == mu);
        let shortest = refused.map_or(f64::INFINITY, |r| r.1);
        if error > FOREIGN * step.pull && error > EXPECTED * step.error {
            self.refused = Some((mu, step.length.min(shortest)));
            SHRINKAGE * step.length
        } else if error <= OWN * step.pull && step.length > AT_LIMIT * radius {
            (GROWTH * radius).min(LESS * shortest)
        } else {
            radius
        }
    }
}

impl Solver<'_> {
    /// Adapts the radius to the effect of the last step along a valley.
    pub(super) fn heed_valley(&mut self) {
        if self.valley.inside() {
            let error = self.errors(self.mu).total;
            self.radius = self.valley.radius(self.mu, error, self.radius);
        }
    }

    /// Notes whether the current step leads along a valley. The slope is that of the Lagrangian,
    /// since the objective's own has the rounding of the constraints times their multipliers.
    pub(super) fn enter_valley(&mut self) {
        self.valley.last = None;
        let steers = self.settings.patience > 0 && self.settings.watchdog == 0 && self.soft == 0;
        let feasible = self.problem.violation(&self.current.c) <= self.settings.constraint_tol;
        let (true, true, Some(length)) = (steers, feasible, self.length) else {
            return;
        };
        let products = self.rx.iter().zip(&self.dx).map(|(r, d)| r * d);
        let slope = products.sum::<f64>().abs();
        if slope <= UNTOLD * self.barrier_objective(&self.current).abs() {
            let error = self.errors(self.mu).total;
            self.valley.last = Some(Step {
                mu: self.mu,
                error,
                length,
                pull: slope / length,
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Takes steps as long as the radius allows, at most 1, in a valley whose curvature makes an
    /// error of 20 times their square.
    fn walk(valley: &mut Valley, mu: f64, pull: f64, steps: usize) -> Vec<(f64, f64)> {
        let (mut radius, mut error) = (f64::INFINITY, pull);
        let mut path = Vec::new();
        for _ in 0..steps {
            let length = f64::min(radius, 1.0);
            valley.last = Some(Step {
                mu,
                error,
                length,
                pull,
            });
            error = pull + 20.0 * length * length;
            radius = valley.radius(mu, error, radius);
            path.push((length, error));
        }
        path
    }

    #[test]
    fn steps_shorten_until_the_pull_explains_the_error() {
        for pull in [1e-7, 1e-5, 1e-3] {
            let path = walk(&mut Valley::default(), 1e-6, pull, 40);
            let settled = &path[path.len() - 20..];
            let limit = FOREIGN * pull;
            assert!(settled.iter().all(|(_, e)| *e <= limit), "{pull}: {path:?}");
            // Nor are they shorter than need be.
            let longest = (limit / 20.0).sqrt();
            let short = settled.iter().any(|(s, _)| *s < longest / 16.0);
            assert!(!short, "{pull}: {path:?}");
        }
    }

    #[test]
    fn straight_valleys_and_other_barrier_problems_leave_the_radius() {
        let mut valley = Valley::default();
        assert_eq!(valley.radius(1e-6, 1.0, 0.3), 0.3);
        let step = Step {
            mu: 1e-6,
            error: 1e-3,
            length: 0.3,
            pull: 1e-9,
        };
        valley.last = Some(step);
        assert_eq!(valley.radius(1e-6, 4e-4, 0.3), 0.3, "the error falls");
        assert_eq!(valley.radius(1e-8, 1.0, 0.3), 0.3, "another problem");
        assert_eq!(valley.radius(1e-6, 1e-3, 0.3), SHRINKAGE * 0.3);
        assert_eq!(
            valley.radius(1e-6, 1e-9, 0.3),
            LESS * 0.3,
            "no longer than refused"
        );
    }
}
