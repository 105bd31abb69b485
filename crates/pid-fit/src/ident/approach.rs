//! Iterations ahead of those that end at the optimum: by Gauss-Newton, and until the constraints hold.

use super::motions::Motions;
use super::starts::Report;
use crate::transcribe::Curvature;
use pid_nlp::solver::kkt::Kkt;
use pid_nlp::solver::{Iteration, Settings, ip};
use std::ops::ControlFlow;

/// How long Gauss-Newton iterations go on before the exact Hessian takes over.
#[derive(Debug, Clone, Copy)]
pub(super) struct Approach {
    /// Most iterations.
    most: usize,
    /// Violation of the constraints, and relative change of the objective, below which it takes over.
    near: f64,
    settled: f64,
    /// Iterations of a restoration phase.
    restoration: usize,
}

/// The usual approach.
pub(super) const APPROACH: Approach = Approach {
    most: 60,
    near: 1e-1,
    settled: 5e-2,
    restoration: 200,
};
/// With links kept bodies. Stiff joints (a wrist whose friction outweighs its inertia a hundredfold) leave multipliers at the
/// violation above that mean nothing yet: an arm of 84 parameters then did not converge at 3 000 samples and more.
pub(super) const LONG_APPROACH: Approach = Approach {
    most: 150,
    near: 1e-3,
    settled: 1e-2,
    // Where these iterations find no step, the exact Hessian does (an arm with rotors, 10 000 samples: a restoration took twice the
    // time and two and a half times the memory).
    restoration: 0,
};
/// Share of a step from which its change of the objective counts.
const WHOLE: f64 = 0.5;

/// Gauss-Newton iterations until the constraints nearly hold: far from that the multipliers, and with them the exact curvature of
/// the constraints, mean nothing. Returns the iterations it took.
pub(super) fn approach<P: Motions>(
    problem: &mut P,
    kkt: &mut dyn Kkt,
    x: &mut Vec<f64>,
    (options, how): (&Settings, Approach),
    report: &mut Report<'_>,
) -> usize {
    problem.curve(Curvature::GaussNewton);
    let mut previous = f64::INFINITY;
    let options = Settings {
        max_iterations: how.most,
        max_restoration: how.restoration,
        ..options.clone()
    };
    let mut near = |line: &Iteration| {
        // A step that was cut short tells nothing.
        let settled = line.alpha >= WHOLE
            && (line.objective - previous).abs() <= how.settled * line.objective.abs();
        previous = line.objective;
        line.primal_inf < how.near && settled
    };
    let phase = "approaching by Gauss-Newton";
    let iterations = until(problem, kkt, x, &options, phase, &mut near, report);
    problem.curve(Curvature::Exact);
    iterations
}

/// Violation of the constraints at which they count as closed, twice in a row.
const CLOSED: f64 = 1e-2;

/// Iterations with the exact Hessian until the constraints hold but for little. Returns the iterations it took.
pub(super) fn close<P: Motions>(
    problem: &mut P,
    kkt: &mut dyn Kkt,
    x: &mut Vec<f64>,
    options: &Settings,
    report: &mut Report<'_>,
) -> usize {
    let mut before = false;
    let mut closed = |line: &Iteration| {
        let now = line.primal_inf < CLOSED;
        std::mem::replace(&mut before, now) && now
    };
    let phase = "closing the constraints";
    until(problem, kkt, x, options, phase, &mut closed, report)
}

/// Solves until a line of the log is the last one; x is the best point seen. Returns the iterations it took.
fn until<P: Motions>(
    problem: &mut P,
    kkt: &mut dyn Kkt,
    x: &mut Vec<f64>,
    options: &Settings,
    phase: &'static str,
    last: &mut dyn FnMut(&Iteration) -> bool,
    report: &mut Report<'_>,
) -> usize {
    let mut news = |line: &Iteration, _: &[f64]| {
        // Both count every line.
        let (stop, last) = (report(phase, line).is_break(), last(line));
        match stop || last {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    };
    let near = ip::solve(problem, kkt, x, options, &mut news);
    if near.objective.is_finite() {
        *x = near.x;
    }
    near.log.len().saturating_sub(1)
}
