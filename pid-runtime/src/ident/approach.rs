//! Gauss-Newton iterations ahead of those with the exact Hessian.

use super::starts::Report;
use crate::nlp::Nlp;
use crate::solver::kkt::Kkt;
use crate::solver::{Iteration, Settings, ip};
use crate::transcribe::{Curvature, FullDiscretization, Shooting};
use std::ops::ControlFlow;

/// How long Gauss-Newton iterations go on before the exact Hessian takes over.
#[derive(Debug, Clone, Copy)]
pub(super) struct Approach {
    /// Most iterations.
    most: usize,
    /// Violation of the constraints, and relative change of the objective, below which it takes over.
    near: f64,
    settled: f64,
    /// Iterations in a row that leave the objective as it is, after which it takes over.
    idle: usize,
}

/// The usual approach.
pub(super) const APPROACH: Approach = Approach {
    most: 60,
    near: 1e-1,
    settled: 5e-2,
    idle: usize::MAX,
};
/// With links kept bodies. Stiff joints (a wrist whose friction outweighs its inertia a hundredfold) leave multipliers at the
/// violation above that mean nothing yet: an arm of 84 parameters then did not converge at 3 000 samples and more.
pub(super) const LONG_APPROACH: Approach = Approach {
    most: 150,
    near: 1e-3,
    settled: 1e-2,
    idle: 10,
};
/// Share of a step from which its change of the objective counts.
const WHOLE: f64 = 0.5;
/// Relative change of an objective that stays as it is: single steps whose friction changes its sign back and forth hold up the
/// violation, which the exact curvature ends.
const SAME: f64 = 1e-4;

/// A program whose second derivatives can be chosen.
pub(super) trait Curved: Nlp {
    /// Changes the second derivatives that are given to the solver.
    fn curve(&mut self, curvature: Curvature);
}

impl Curved for FullDiscretization<'_> {
    fn curve(&mut self, curvature: Curvature) {
        self.set_curvature(curvature);
    }
}

impl Curved for Shooting<'_> {
    fn curve(&mut self, curvature: Curvature) {
        self.set_curvature(curvature);
    }
}

/// Gauss-Newton iterations until the constraints nearly hold: far from that the multipliers, and with them the exact curvature of
/// the constraints, mean nothing. Returns the iterations it took.
pub(super) fn approach<P: Curved>(
    problem: &mut P,
    kkt: &mut dyn Kkt,
    x: &mut Vec<f64>,
    (options, how): (&Settings, Approach),
    report: &mut Report<'_>,
) -> usize {
    problem.curve(Curvature::GaussNewton);
    let (mut previous, mut idle) = (f64::INFINITY, 0);
    let options = Settings {
        max_iterations: how.most,
        ..options.clone()
    };
    let mut news = |line: &Iteration, _: &[f64]| {
        let change = (line.objective - previous).abs() / line.objective.abs();
        previous = line.objective;
        // A step that was cut short tells nothing, many of them do.
        let settled = line.alpha >= WHOLE && change <= how.settled;
        idle = if change <= SAME { idle + 1 } else { 0 };
        if report("approaching by Gauss-Newton", line).is_break()
            || line.primal_inf < how.near && settled
            || idle >= how.idle
        {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    };
    let near = ip::solve(problem, kkt, x, &options, &mut news);
    problem.curve(Curvature::Exact);
    if near.objective.is_finite() {
        *x = near.x;
    }
    near.log.len().saturating_sub(1)
}
