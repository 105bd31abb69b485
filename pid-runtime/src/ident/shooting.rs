//! Single and multiple shooting over the training windows, from every start.

use super::assemble::{Assembled, assemble, with_bodies};
use super::full::gains;
use super::starts::Report;
use super::trajectory::{Reached, from_starts, reached};
use super::{Callback, IdentError, Identification, Prepare, Settings};
use crate::data::Dataset;
use crate::dynamics::Hessian;
use crate::solver::kkt::sparse::SparseKkt;
use crate::solver::{self, ip};
use crate::transcribe::{FullDiscretization, ResidualFit, Shooting, ShootingKkt};
use std::time::Instant;

/// Barrier parameter and relative distance to the bounds of a start that is nearly optimal.
const WARM: f64 = 1e-9;

/// Identifies by shooting.
pub(super) fn identify(
    model: &dyn Hessian,
    dataset: &Dataset,
    settings: &Settings,
    start: &[f64],
    callback: &mut Callback<'_>,
) -> Result<Identification, IdentError> {
    let assembled = assemble(model, dataset, settings, start)?;
    let solve = |problem: &mut _, index, start: &[f64], report: &mut Report<'_>| {
        solve(model, problem, &assembled, settings, index, start, report)
    };
    let problem = || transcribe(model, &assembled, settings);
    Ok(from_starts(
        model, settings, start, &assembled, problem, solve, callback,
    ))
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
fn solve(
    model: &dyn Hessian,
    problem: &mut Shooting<'_>,
    assembled: &Assembled,
    settings: &Settings,
    index: usize,
    start: &[f64],
    report: &mut Report<'_>,
) -> Reached {
    let started = Instant::now();
    let setup = &assembled.setup;
    let start = &with_bodies(&setup.bodies, start, &setup.lower, &setup.upper);
    let mut x0 = problem.starting_point(start);
    let mut iterations = 0;
    if settings.prepare == Prepare::Everything {
        // Parameters that make the steps fit the data, states held: nothing is integrated.
        let mut full = FullDiscretization::new(model, &assembled.tracks, assembled.setup.clone());
        let point = full.starting_point(start);
        let first = full.layout().p();
        let options = crate::solver::Settings {
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
        iterations += prepared.log.len().saturating_sub(1);
        if prepared.objective.is_finite() {
            let at = x0.len() - prepared.x.len();
            x0[at..].copy_from_slice(&prepared.x);
        }
    }
    let mut options = crate::solver::Settings {
        objective_scale: settings.solver.objective_scale * problem.samples() as f64,
        ..settings.solver.clone()
    };
    if settings.lift && settings.adaptive.is_none() {
        let at = x0.len() - model.dims().np;
        let mut lifted = Shooting::new(
            model,
            &assembled.tracks,
            assembled.setup.clone(),
            usize::MAX,
            None,
        );
        let mut from = lifted.starting_point(start);
        let place = from.len() - model.dims().np;
        from[place..].copy_from_slice(&x0[at..]);
        let mut kkt = ShootingKkt::from(&lifted);
        let mut news = |line: &_, _: &[f64]| report("solving with a node at every sample", line);
        let solution = solver::solve(
            &mut lifted,
            &mut kkt,
            &from,
            (settings.algorithm, settings.quasi_newton),
            &options,
            &mut news,
        );
        iterations += solution.log.len().saturating_sub(1);
        if let Some(states) = lifted
            .states(&solution.x)
            .filter(|_| solution.objective.is_finite())
        {
            let nx = 2 * model.dims().nq;
            for (x, sample) in problem
                .node_positions()
                .into_iter()
                .zip(problem.node_samples())
            {
                x0[x..x + nx].copy_from_slice(&states[sample * nx..(sample + 1) * nx]);
            }
            x0[at..].copy_from_slice(&solution.x[place..]);
            // A long integration is sensitive: the start must stay where it is, also at its bounds.
            (options.mu_start, options.push) = (WARM, WARM);
        }
    }
    let mut kkt = ShootingKkt::from(&*problem);
    let mut news = |line: &_, _: &[f64]| report("solving", line);
    let mut solution = solver::solve(
        problem,
        &mut kkt,
        &x0,
        (settings.algorithm, settings.quasi_newton),
        &options,
        &mut news,
    );
    let motion = problem.states(&solution.x).unwrap_or_default();
    solution.objective -= problem.barrier(&solution.x);
    reached(problem, index, start, solution, motion, iterations, started)
}
