//! Single and multiple shooting over the training windows, from every start.

use super::approach::{APPROACH, approach};
use super::assemble::{Assembled, assemble, with_bodies};
use super::error::IdentError;
use super::full::gains;
use super::motions::Around;
use super::outcome::{Callback, Identification};
use super::settings::{Prepare, Settings};
use super::starts::Report;
use super::trajectory::{Reached, constrained, from_starts, reached};
use crate::transcribe::{Curvature, FullDiscretization, ResidualFit, Shooting, ShootingKkt};
use pid_data::Dataset;
use pid_nlp::solver::kkt::sparse::SparseKkt;
use pid_nlp::solver::{self, ip};
use pid_runtime::dynamics::Hessian;
use std::time::Instant;

/// First barrier parameter, and relative distance to the bounds, of a start that is nearly optimal.
const WARM: f64 = 1e-9;

/// From this mean length of an arc on, in samples, directions that are hardly determined are
/// shortened alone. It helps where a long integration bends them and hinders over shorter arcs
/// (docs/decisions/0006).
const LONG_ARC: usize = 20;

/// Identifies by shooting.
pub(super) fn identify(
    model: &dyn Hessian,
    dataset: &Dataset,
    settings: &Settings,
    start: &[f64],
    callback: &mut Callback<'_>,
) -> Result<Identification, IdentError> {
    let assembled = assemble(model, dataset, settings, start)?;
    let program = || transcribe(model, &assembled, settings);
    Ok(if settings.constraints.is_empty() {
        run(model, settings, start, &assembled, program, callback)
    } else {
        let program = constrained(&settings.constraints, program)?;
        run(model, settings, start, &assembled, program, callback)
    })
}

/// Solves from every start.
fn run<'m, P: Around<Shooting<'m>>>(
    model: &dyn Hessian,
    settings: &Settings,
    start: &[f64],
    assembled: &Assembled,
    program: impl Fn() -> P + Sync,
    callback: &mut Callback<'_>,
) -> Identification {
    let solve = |problem: &mut P, index, start: &[f64], report: &mut Report<'_>| {
        solve(model, problem, assembled, settings, index, start, report)
    };
    from_starts(model, settings, start, assembled, program, solve, callback)
}

fn transcribe<'m>(
    model: &'m dyn Hessian,
    assembled: &Assembled,
    settings: &Settings,
) -> Shooting<'m> {
    Shooting::new(
        model,
        &assembled.tracks,
        assembled.setup.clone(),
        settings.nodes,
        settings.adaptive,
    )
}

/// Solves from one start.
fn solve<'m, P: Around<Shooting<'m>>>(
    model: &dyn Hessian,
    problem: &mut P,
    assembled: &Assembled,
    settings: &Settings,
    index: usize,
    start: &[f64],
    report: &mut Report<'_>,
) -> Reached {
    let started = Instant::now();
    let setup = &assembled.setup;
    let start = &with_bodies(&setup.bodies, start, &setup.lower, &setup.upper);
    let mut x0 = problem.program().starting_point(start);
    let mut iterations = 0;
    if settings.prepare == Prepare::Everything {
        iterations += fit_residual(model, assembled, settings, start, &mut x0, report);
    }
    let lift_first = settings
        .lift
        .unwrap_or(settings.prepare == Prepare::Everything);
    let lifted = lift_first && settings.adaptive.is_none();
    let arcs: usize = problem.program().nodes().iter().sum();
    let long = settings.nodes > 1 && !lifted && problem.samples() >= LONG_ARC * arcs;
    let mut options = solver::Settings {
        objective_scale: settings.solver.objective_scale * problem.samples() as f64,
        patience: if long { settings.solver.patience } else { 0 },
        ..settings.solver.clone()
    };
    if lifted {
        let every = Shooting::new(
            model,
            &assembled.tracks,
            assembled.setup.clone(),
            usize::MAX,
            None,
        );
        let (reached, took) = lift(
            problem.program(),
            every,
            &mut x0,
            settings,
            &options,
            report,
        );
        iterations += took;
        if reached {
            // A long integration is sensitive: the start must stay where it is, also at its bounds.
            (options.mu_start, options.push) = (WARM, WARM);
        }
    }
    x0 = problem.extend(x0);
    let mut kkt = problem.linear();
    let exact = settings.quasi_newton.is_none() && settings.curvature == Curvature::Exact;
    // A single arc has no multipliers that could be wrong, and a lifted start is nearly optimal.
    if settings.nodes > 1 && settings.prepare != Prepare::Nothing && exact && !lifted {
        iterations += approach(problem, kkt.as_mut(), &mut x0, (&options, APPROACH), report);
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

/// Fits the parameters of the start to the data with the states held; nothing is integrated.
/// Returns the number of iterations.
fn fit_residual(
    model: &dyn Hessian,
    assembled: &Assembled,
    settings: &Settings,
    start: &[f64],
    x0: &mut [f64],
    report: &mut Report<'_>,
) -> usize {
    let mut full = FullDiscretization::new(model, &assembled.tracks, assembled.setup.clone());
    let point = full.starting_point(start);
    let first = full.layout().p();
    let options = solver::Settings {
        tol: 1e-6,
        max_iterations: 100,
        ..settings.solver.clone()
    };
    let held = match settings.consistent {
        true => gains(model),
        false => Vec::new(),
    };
    let mut fit = ResidualFit::new(&mut full, &point).holding(&held);
    let mut kkt = SparseKkt::new(&fit);
    let mut news = |line: &_, _: &[f64]| report("fitting the residual", line);
    let prepared = ip::solve(&mut fit, &mut kkt, &point[first..], &options, &mut news);
    if prepared.objective.is_finite() {
        let at = x0.len() - prepared.x.len();
        x0[at..].copy_from_slice(&prepared.x);
    }
    prepared.log.len().saturating_sub(1)
}

/// Puts the solution of the program with a node at every sample into the start. Returns whether
/// there is one, and the number of iterations.
fn lift(
    problem: &Shooting<'_>,
    mut every: Shooting<'_>,
    x0: &mut [f64],
    settings: &Settings,
    options: &solver::Settings,
    report: &mut Report<'_>,
) -> (bool, usize) {
    let dims = every.model().dims();
    let (nx, at) = (2 * dims.nq, x0.len() - dims.np);
    // Nodes start at the data, which do not depend on the parameters.
    let mut from = every.starting_point(&vec![0.0; dims.np]);
    let place = from.len() - dims.np;
    from[place..].copy_from_slice(&x0[at..]);
    let mut kkt = ShootingKkt::from(&every);
    let mut news = |line: &_, _: &[f64]| report("solving with a node at every sample", line);
    let solution = solver::solve(
        &mut every,
        &mut kkt,
        &from,
        (settings.algorithm, settings.quasi_newton),
        options,
        &mut news,
    );
    let iterations = solution.log.len().saturating_sub(1);
    let states = every.states(&solution.x);
    let Some(states) = states.filter(|_| solution.objective.is_finite()) else {
        return (false, iterations);
    };
    let nodes = problem.node_positions().into_iter();
    for (x, sample) in nodes.zip(problem.node_samples()) {
        x0[x..x + nx].copy_from_slice(&states[sample * nx..(sample + 1) * nx]);
    }
    x0[at..].copy_from_slice(&solution.x[place..]);
    (true, iterations)
}
