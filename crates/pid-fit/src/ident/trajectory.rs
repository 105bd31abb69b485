//! Identification by a program over the motions of all windows, from every start.

use super::assemble::Assembled;
use super::motions::Motions;
use super::outcome::{Callback, Identification, Run, best_of};
use super::settings::Settings;
use super::spread::deviations;
use super::starts::{self, Report};
use crate::transcribe::{Constrained, Constraint, ConstraintError, States};
use pid_nlp::check_point;
use pid_nlp::solver::Solution;
use pid_runtime::dynamics::Hessian;
use std::time::Instant;

/// The outcome of one start.
pub(super) struct Reached {
    run: Run,
    solution: Solution,
    /// States at the samples.
    motion: Vec<f64>,
}

/// Checks the point that a start reached.
pub(super) fn reached<P: Motions>(
    problem: &mut P,
    index: usize,
    start: &[f64],
    mut solution: Solution,
    before: usize,
    started: Instant,
) -> Reached {
    let check = check_point(problem, &solution.x, &solution.lambda);
    let motion = problem.states(&solution.x);
    solution.objective -= problem.barrier(&solution.x);
    let run = Run {
        index,
        start: start.to_vec(),
        parameters: problem.parameters(&solution.x),
        objective: solution.objective,
        status: solution.status,
        iterations: before + solution.log.len().saturating_sub(1),
        seconds: started.elapsed().as_secs_f64(),
        check,
        log: solution.log.clone(),
    };
    Reached {
        run,
        solution,
        motion,
    }
}

/// Programs with constraints of the user.
///
/// # Errors
/// [`ConstraintError`] if a constraint does not fit them.
pub(super) fn constrained<'a, P: States>(
    constraints: &'a [Constraint],
    program: impl Fn() -> P + Sync + 'a,
) -> Result<impl Fn() -> Constrained<P> + Sync + 'a, ConstraintError> {
    Constrained::new(program(), constraints.to_vec())?;
    Ok(move || {
        let with = Constrained::new(program(), constraints.to_vec());
        with.expect("invariant: they fit the same program before")
    })
}

/// Solves from every start, each on a program of its own; the best one with its deviations.
pub(super) fn from_starts<P: Motions>(
    model: &dyn Hessian,
    settings: &Settings,
    start: &[f64],
    assembled: &Assembled,
    program: impl Fn() -> P + Sync,
    solve: impl Fn(&mut P, usize, &[f64], &mut Report<'_>) -> Reached + Sync,
    callback: &mut Callback<'_>,
) -> Identification {
    let Assembled {
        tracks,
        lower,
        upper,
        fixed,
        notes,
        ..
    } = assembled;
    let mut notes = notes.clone();
    let all = starts::draw(
        settings.sampling,
        start,
        lower,
        upper,
        settings.starts,
        settings.seed,
    );
    let count = all.len();
    let (outcomes, stopped) = starts::run_all(count, callback, |index, report| {
        solve(&mut program(), index, &all[index], report)
    });
    if stopped {
        notes.push(format!(
            "interrupted after {} of {count} starts",
            outcomes.len()
        ));
    }
    let (mut runs, mut solutions, mut motions) = (Vec::new(), Vec::new(), Vec::new());
    for outcome in outcomes {
        runs.push(outcome.run);
        solutions.push(outcome.solution);
        motions.push(outcome.motion);
    }
    let best = best_of(&runs);
    let mut problem = program();
    notes.extend(problem.remarks(&solutions[best]));
    let (spread, noise) = deviations(
        &mut problem,
        &solutions[best],
        fixed,
        &tracks[0].weights,
        settings.sandwich,
    );
    let noise = match settings.likelihood {
        Some(_) => noise,
        None => vec![None; noise.len()],
    };
    Identification {
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
        dispersion: spread.dispersion,
        fixed: fixed.clone(),
        lower: lower.clone(),
        upper: upper.clone(),
        size: (problem.n(), problem.m()),
        windows: (tracks.len(), problem.samples()),
        force_error: Vec::new(),
        notes,
    }
}
