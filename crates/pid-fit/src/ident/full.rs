//! Full discretization over the training windows, from every start.

use super::approach::{APPROACH, LONG_APPROACH, approach, close};
use super::assemble::{Assembled, assemble, with_bodies};
use super::error::IdentError;
use super::motions::Around;
use super::outcome::{Callback, Identification};
use super::settings::{Prepare, Settings};
use super::starts::Report;
use super::trajectory::{Reached, constrained, from_starts, reached};
use crate::transcribe::{Curvature, ExplicitForm, FullDiscretization, ResidualFit, Scheme};
use pid_data::Dataset;
use pid_nlp::solver::kkt::sparse::SparseKkt;
use pid_nlp::solver::{self, ip};
use pid_runtime::dynamics::Hessian;
use std::time::Instant;

/// The preparing fit of the residual ends at this optimality error: a start is wanted, not its
/// optimum.
const PREPARED: f64 = 1e-2;

/// From this many samples on, the tolerance of optimality grows with their number. The objective
/// that the solver sees is a sum over samples, and so are the rounding errors of its gradient. The
/// tolerance of the violation stays.
const MANY: f64 = 1000.0;

/// With the barrier of bodies, the first barrier parameter grows as (samples/1000)^0.75. A power of
/// 0.5 is too small at 1e5 samples, a power of 1 too large at 1e4 (docs/experiments.md, Solver).
const HEAVIER: f64 = 0.75;

/// Identifies by full discretization.
pub(super) fn identify(
    model: &dyn Hessian,
    dataset: &Dataset,
    settings: &Settings,
    start: &[f64],
    callback: &mut Callback<'_>,
) -> Result<Identification, IdentError> {
    let mut assembled = assemble(model, dataset, settings, start)?;
    let explicit = ExplicitForm::new(model);
    let solved_form = solved_form(model, settings.scheme);
    if solved_form {
        assembled.setup.inertia = vec![1.0; model.dims().nq];
    }
    let program = || {
        let (tracks, setup) = (&assembled.tracks, assembled.setup.clone());
        match solved_form {
            true => FullDiscretization::solved(&explicit, tracks, setup),
            false => FullDiscretization::new(model, tracks, setup),
        }
    };
    let held = match settings.consistent {
        true => gains(model),
        false => Vec::new(),
    };
    Ok(if settings.constraints.is_empty() {
        run(model, settings, start, &assembled, &held, program, callback)
    } else {
        let program = constrained(&settings.constraints, program)?;
        run(model, settings, start, &assembled, &held, program, callback)
    })
}

/// Solves from every start; `held`: parameters that the preparing fit holds.
fn run<'m, P: Around<FullDiscretization<'m>>>(
    model: &dyn Hessian,
    settings: &Settings,
    start: &[f64],
    assembled: &Assembled,
    held: &[usize],
    program: impl Fn() -> P + Sync,
    callback: &mut Callback<'_>,
) -> Identification {
    let solve = |problem: &mut P, index, start: &[f64], report: &mut Report<'_>| {
        solve(problem, settings, held, index, start, report)
    };
    from_starts(model, settings, start, assembled, program, solve, callback)
}

/// The trapezoidal rule solves for the accelerations only if the residual has at most this many
/// variables, since their second derivatives are dense.
const FEW: usize = 40;

/// Whether the program solves for the accelerations. Explicit schemes do. The trapezoidal rule does
/// where the residual is not affine in the parameters, and then needs no stages; an affine residual
/// is worth more than fewer unknowns.
fn solved_form(model: &dyn Hessian, scheme: Scheme) -> bool {
    let dims = model.dims();
    let pairs = model.hessian_pattern().cols;
    let curved = || pairs.iter().any(|&col| col as usize >= dims.p());
    scheme.explicit() || scheme == Scheme::Trapezoidal && dims.nz() <= FEW && curved()
}

/// Parameters that multiply inputs. A residual that is linear in inertias, friction and gains alike
/// leaves the scale of all of them open, and least squares on it make all of them small, as far as
/// bounds allow.
pub(super) fn gains(model: &dyn Hessian) -> Vec<usize> {
    let (dims, pattern) = (model.dims(), model.hessian_pattern());
    let inputs = dims.u()..dims.p();
    let pairs = pattern.rows.iter().zip(pattern.cols);
    let mut found: Vec<usize> = pairs
        .filter(|(_, col)| inputs.contains(&(**col as usize)))
        .filter_map(|(row, _)| (*row as usize).checked_sub(dims.p()))
        .collect();
    found.sort_unstable();
    found.dedup();
    found
}

/// A starting point: states from the data, parameters from the start with its links moved inside
/// the bodies' domain.
fn starting_point(problem: &FullDiscretization<'_>, start: &[f64]) -> Vec<f64> {
    let setup = problem.setup();
    problem.starting_point(&with_bodies(
        &setup.bodies,
        start,
        &setup.lower,
        &setup.upper,
    ))
}

fn solve<'m, P: Around<FullDiscretization<'m>>>(
    problem: &mut P,
    settings: &Settings,
    held: &[usize],
    index: usize,
    start: &[f64],
    report: &mut Report<'_>,
) -> Reached {
    let started = Instant::now();
    let samples = problem.samples() as f64;
    let growth = (samples / MANY).max(1.0);
    let mut x0 = starting_point(problem.program(), start);
    let mut iterations = 0;
    if settings.prepare == Prepare::Everything {
        let first = problem.program().layout().p();
        let options = pid_nlp::solver::Settings {
            // A start is wanted, not the optimum of the fit.
            tol: PREPARED,
            max_iterations: 100,
            // Its objective is a sum over the samples, its tolerance is not.
            objective_scale: settings.solver.objective_scale / growth,
            ..settings.solver.clone()
        };
        let mut fit = ResidualFit::new(problem.program_mut(), &x0).holding(held);
        let mut kkt = SparseKkt::new(&fit);
        let mut news = |line: &_, _: &[f64]| report("fitting the residual", line);
        let prepared = ip::solve(&mut fit, &mut kkt, &x0[first..], &options, &mut news);
        iterations += prepared.log.len().saturating_sub(1);
        if prepared.objective.is_finite() {
            x0[first..].copy_from_slice(&prepared.x);
        }
    }
    x0 = problem.extend(x0);
    let mut options = pid_nlp::solver::Settings {
        objective_scale: settings.solver.objective_scale * samples,
        tol: growth * settings.solver.tol,
        acceptable_tol: growth * settings.solver.acceptable_tol,
        // Explicit schemes have many optima close to each other. Shortening whole steps reaches
        // better ones: 20 instead of 15 of 20 starts of the two-link study end within 1 % of the
        // best.
        patience: if settings.scheme.explicit() {
            0
        } else {
            settings.solver.patience
        },
        ..settings.solver.clone()
    };
    let mut kkt = problem.linear();
    let exact = settings.quasi_newton.is_none() && settings.curvature == Curvature::Exact;
    if settings.prepare != Prepare::Nothing && exact {
        let how = match settings.consistent {
            true => LONG_APPROACH,
            false => APPROACH,
        };
        iterations += approach(problem, kkt.as_mut(), &mut x0, (&options, how), report);
        if growth > 1.0 && !problem.program().setup().bodies.is_empty() {
            // The objective grows with the samples, so a barrier of the same weight lets the
            // iterates lie nearer to the boundary of the bodies' domain. That boundary is curved,
            // and steps near it are as short as the root of their distance. The heavier barrier
            // starts only once the constraints hold; before, it would lead astray.
            iterations += close(problem, kkt.as_mut(), &mut x0, &options, report);
            options.mu_start *= growth.powf(HEAVIER);
        }
    }
    let mut news = |line: &_, _: &[f64]| report("solving", line);
    let solution = solver::solve(
        problem,
        kkt.as_mut(),
        &x0,
        (settings.algorithm, settings.quasi_newton),
        &options,
        &mut news,
    );
    reached(problem, index, start, solution, iterations, started)
}
