//! Single and multiple shooting over the training windows, from every start.

use super::full::{self, Assembled};
use super::spread::deviations;
use super::starts::{self, Report};
use super::{Callback, IdentError, Identification, Run, Settings};
use crate::data::Dataset;
use crate::dynamics::Hessian;
use crate::nlp::{Nlp, check_point};
use crate::solver::kkt::sparse::SparseKkt;
use crate::solver::{self, Solution, ip};
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
    let assembled = full::assemble(model, dataset, settings, start)?;
    let Assembled {
        lower,
        upper,
        fixed,
        mut notes,
        ..
    } = assembled.clone();
    let problem = || transcribe(model, &assembled, settings);
    let all = starts::draw(
        settings.sampling,
        start,
        &lower,
        &upper,
        settings.starts,
        settings.seed,
    );
    let count = all.len();
    let (outcomes, stopped) = starts::run_all(count, callback, |index, report| {
        let mut problem = problem();
        solve(
            model,
            &mut problem,
            &assembled,
            settings,
            index,
            &all[index],
            report,
        )
    });
    if stopped {
        notes.push(format!(
            "interrupted after {} of {count} starts",
            outcomes.len()
        ));
    }
    let (mut runs, mut solutions, mut motions) = (Vec::new(), Vec::new(), Vec::new());
    for (run, solution, motion) in outcomes {
        runs.push(run);
        solutions.push(solution);
        motions.push(motion);
    }
    let best = super::best_of(&runs);
    let mut problem = problem();
    let (spread, noise) = deviations(
        &mut problem,
        &solutions[best],
        &fixed,
        &assembled.tracks[0].weights,
        settings.sandwich,
    );
    let noise = match settings.likelihood {
        Some(_) => noise,
        None => vec![None; noise.len()],
    };
    Ok(Identification {
        optima: starts::optima(&runs, &motions, 2 * model.dims().nq),
        motion: motions.swap_remove(best),
        best,
        runs,
        deviations: spread.deviations,
        undetermined: spread.undetermined,
        open: spread.open,
        covariance: spread.covariance,
        sandwich: spread.sandwich,
        noise,
        correlation_factor: spread.correlation_factor,
        fixed,
        lower,
        upper,
        size: (problem.n(), problem.m()),
        windows: (assembled.tracks.len(), problem.samples()),
        force_error: Vec::new(),
        notes,
    })
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

/// Solves from one start; its run, the solution and the fitted motion.
fn solve(
    model: &dyn Hessian,
    problem: &mut Shooting<'_>,
    assembled: &Assembled,
    settings: &Settings,
    index: usize,
    start: &[f64],
    report: &mut Report<'_>,
) -> (Run, Solution, Vec<f64>) {
    let started = Instant::now();
    let mut x0 = problem.starting_point(start);
    let mut iterations = 0;
    if settings.prepare {
        // Parameters that make the steps fit the data, states held: nothing is integrated.
        let mut full = FullDiscretization::new(model, &assembled.tracks, assembled.setup.clone());
        let point = full.starting_point(start);
        let first = full.layout().p();
        let options = crate::solver::Settings {
            tol: 1e-6,
            max_iterations: 100,
            ..settings.solver.clone()
        };
        let mut fit = ResidualFit::new(&mut full, &point);
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
    let solution = solver::solve(
        problem,
        &mut kkt,
        &x0,
        (settings.algorithm, settings.quasi_newton),
        &options,
        &mut news,
    );
    let check = check_point(problem, &solution.x, &solution.lambda);
    iterations += solution.log.len().saturating_sub(1);
    let motion = problem.states(&solution.x).unwrap_or_default();
    let run = Run {
        index,
        start: start.to_vec(),
        parameters: problem.parameters(&solution.x),
        objective: solution.objective,
        status: solution.status,
        iterations,
        seconds: started.elapsed().as_secs_f64(),
        check,
        log: solution.log.clone(),
    };
    (run, solution, motion)
}
