//! Full discretization over the training windows, from every start.

use super::approach::{APPROACH, LONG_APPROACH, approach, close};
use super::assemble::{Assembled, assemble, with_bodies};
use super::motions::Around;
use super::starts::Report;
use super::trajectory::{Reached, constrained, from_starts, reached};
use super::{Callback, IdentError, Identification, Prepare, Settings};
use crate::transcribe::{Curvature, ExplicitForm, FullDiscretization, ResidualFit, Scheme};
use pid_data::Dataset;
use pid_nlp::solver::kkt::sparse::SparseKkt;
use pid_nlp::solver::{self, ip};
use pid_runtime::dynamics::Hessian;
use std::time::Instant;

/// Optimality error at which the preparing fit of the residual ends.
const PREPARED: f64 = 1e-2;

/// Samples beyond which the tolerance grows with their number, as the objective does that the solver sees, and with it the rounding
/// errors of its gradient. That of the violation stays.
const MANY: f64 = 1000.0;

/// Power of that growth by which the first barrier parameter grows where links are kept bodies. With 1/2 an arm with rotors is slow on
/// 100 000 samples (J 1.6355e-2 after 67 iterations at the first barrier parameter, 1.6235e-2 at the optimum); with 1 one without is
/// on 10 000 (233 iterations, 181 with 3/4).
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

/// Variables of the residual up to which the trapezoidal rule solves for the accelerations: their second derivatives are dense.
const FEW: usize = 40;

/// Whether the accelerations are solved for: by explicit schemes, and by the trapezoidal rule, which then needs no stages, where
/// the residual is not affine in the parameters. An affine one is kept as it is: that is what it is good for.
fn solved_form(model: &dyn Hessian, scheme: Scheme) -> bool {
    let dims = model.dims();
    let pairs = model.hessian_pattern().cols;
    let curved = || pairs.iter().any(|&col| col as usize >= dims.p());
    scheme.explicit() || scheme == Scheme::Trapezoidal && dims.nz() <= FEW && curved()
}

/// Parameters that multiply inputs. A residual that is linear in inertias, friction and gains alike has the scale of all of them
/// open: least squares on it make all of them small, as far as bounds let them.
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

/// States from the data, the start's parameters with its links inside the bodies' domain.
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
        // Explicit steps have many neighbouring optima; shortened as a whole, steps reach better ones (20 instead of 15 of 20
        // starts of the two-link study within 1 % of the best).
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
            // The objective grows with the samples, and the nearer to the boundary of the bodies' domain a barrier of the same
            // weight lets the iterates lie. It is curved: steps there have the size of the root of their distance, and 100 000
            // samples of six joints did not get on. A heavier barrier far from the motions' equations led astray.
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
