//! A damped step on the quadratic model of an objective, within the ranges of the unknowns.

use nalgebra::DVector;

use super::quadratic::Quadratic;
use crate::point::Point;

/// Damping of the first step.
const FIRST: f64 = 1e-3;
/// Factor on the damping after a step that served and after one that did not, with the ends of its range.
const RELAXED: (f64, f64) = (0.1, 1e-6);
const TIGHTENED: (f64, f64) = (10.0, 1e-2);

/// Damping of the steps on the way to an optimum (D. W. Marquardt, SIAM J. Appl. Math. 11, 1963).
#[derive(Debug, Clone, Copy)]
pub(super) struct Damping {
    size: f64,
    /// What it adds to the curvature of a deviation: so much; `None`: in proportion to the curvature.
    of_theta: Option<f64>,
}

/// What became of a step.
pub(super) struct Stepped<T> {
    /// Where it led and what was found there; `None` where no trial was better.
    pub(super) to: Option<(Point, T)>,
    /// Decrease of the objective as the model of the last trial has it.
    pub(super) predicted: f64,
    /// Trials whose point is no minimiser of the model; see [`Quadratic::minimise`].
    pub(super) unsettled: usize,
}

/// How far a point may move down and up: deviations within their tolerances, effects' parameters within `bounds`.
pub(super) fn room(at: &Point, bounds: &[(f64, f64)]) -> (DVector<f64>, DVector<f64>) {
    let own = at.theta.iter().map(|t| (-1.0 - t, 1.0 - t));
    let effects = at.e.iter().zip(bounds).map(|(e, b)| (b.0 - e, b.1 - e));
    let (low, high): (Vec<f64>, Vec<f64>) = own.chain(effects).unzip();
    (DVector::from_vec(low), DVector::from_vec(high))
}

impl Damping {
    pub(super) fn new(of_theta: Option<f64>) -> Self {
        Self {
            size: FIRST,
            of_theta,
        }
    }

    /// One step from a point: the damping grows until a trial is `better`, in at most so many trials.
    pub(super) fn step<T>(
        &mut self,
        (at, bounds): (&Point, &[(f64, f64)]),
        quadratic: &Quadratic,
        trials: usize,
        better: impl Fn(&Point) -> Option<T>,
    ) -> Stepped<T> {
        let size = at.theta.len();
        let number = size + at.e.len();
        let (low, high) = room(at, bounds);
        let mut out = Stepped {
            to: None,
            predicted: 0.0,
            unsettled: 0,
        };
        for _ in 0..trials {
            let mut damped = quadratic.clone();
            for i in 0..number {
                damped.h[(i, i)] += match self.of_theta.filter(|_| i < size) {
                    Some(more) => self.size * more,
                    None => self.size * quadratic.h[(i, i)] + 1e-300,
                };
            }
            let (x, minimal) = damped.minimise(&low, &high);
            out.unsettled += usize::from(!minimal);
            out.predicted = -2.0 * quadratic.at(&x);
            let mut next = at.clone();
            let all = next.theta.iter_mut().chain(&mut next.e);
            all.zip(x.iter()).for_each(|(t, x)| *t += x);
            if let Some(there) = better(&next) {
                self.size = (self.size * RELAXED.0).max(RELAXED.1);
                out.to = Some((next, there));
                break;
            }
            self.size = (self.size * TIGHTENED.0).max(TIGHTENED.1);
        }
        out
    }
}
