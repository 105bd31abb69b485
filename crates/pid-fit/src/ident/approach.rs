//! Iterations ahead of the exact Hessian: by Gauss-Newton, then until the constraints hold.

use super::motions::Motions;
use super::starts::Report;
use crate::transcribe::Curvature;
use pid_nlp::solver::kkt::Kkt;
use pid_nlp::solver::{Iteration, Settings, ip};
use std::ops::ControlFlow;

/// When Gauss-Newton iterations end and the exact Hessian takes over.
#[derive(Debug, Clone, Copy)]
pub(super) struct Approach {
    /// Most iterations.
    most: usize,
    /// The exact Hessian takes over below this violation of the constraints (`near`) and this
    /// relative change of the objective (`settled`).
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
/// For links that are kept bodies. Stiff joints, such as a wrist whose friction outweighs its
/// inertia a hundredfold, still have meaningless multipliers at a violation of 0.1: with it an arm
/// of 84 parameters does not converge from 3 000 samples on.
pub(super) const LONG_APPROACH: Approach = Approach {
    most: 150,
    near: 1e-3,
    settled: 1e-2,
    // Where these iterations find no step, the exact Hessian does. A restoration here would cost
    // twice the time and 2.5 times the memory (arm with rotors, 10 000 samples).
    restoration: 0,
};
/// A change of the objective counts only if the step has at least half its full length.
const WHOLE: f64 = 0.5;

/// Runs Gauss-Newton iterations until the constraints nearly hold. Far from that the multipliers
/// mean nothing, and neither does the exact curvature of the constraints. Returns the number of
/// iterations.
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
        // A shortened step says nothing about the change of the objective.
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

/// The closing phase ends after two consecutive iterations with a violation below 1e-2.
const CLOSED: f64 = 1e-2;

/// Runs iterations with the exact Hessian until the constraints nearly hold. Returns the number of
/// iterations.
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

/// Solves until `last` accepts a line of the log; x is then the best point. Returns the number of
/// iterations.
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
        // Both closures count every line.
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
