//! Full discretization over the training windows, from every start.

use super::spread::deviations;
use super::starts;
use super::{Callback, IdentError, Identification, InitialState, Run, Settings, Weighting};
use crate::data::{Dataset, Experiment, InputHold, Role, windows};
use crate::dynamics::{At, Hessian};
use crate::nlp::{Nlp, check_point};
use crate::signal::{StateEstimate, state_from_data};
use crate::solver::kkt::Kkt;
use crate::solver::kkt::sparse::SparseKkt;
use crate::solver::{self, Solution, ip};
use crate::transcribe::{
    Curvature, ExplicitForm, FullDiscretization, Loss, ResidualFit, Scheme, Setup, Track,
};
use std::ops::ControlFlow;
use std::time::Instant;

/// Most Gauss-Newton iterations before the exact Hessian takes over.
const APPROACH: usize = 60;
/// Violation of the steps, and relative change of the objective, below which it takes over.
const NEAR: f64 = 1e-1;
const SETTLED: f64 = 5e-2;
/// Optimality error at which the preparing fit of the residual ends.
const PREPARED: f64 = 1e-2;

/// Relative residual of a Newton step: on the two-link study no iteration more than with 1e-11, and two fifths of the solves less.
const REFINED: f64 = 1e-9;
/// Samples beyond which the tolerance grows with their number, as the objective does that the solver sees, and with it the rounding
/// errors of its gradient. That of the violation stays.
const MANY: f64 = 1000.0;

/// Windows of the training records and what is asked of their transcription.
#[derive(Clone)]
pub(super) struct Assembled {
    pub(super) tracks: Vec<Track>,
    /// For the residual; the solved form has unit inertia.
    pub(super) setup: Setup,
    pub(super) lower: Vec<f64>,
    pub(super) upper: Vec<f64>,
    pub(super) fixed: Vec<bool>,
    pub(super) notes: Vec<String>,
}

/// Cuts the training records into windows and weighs them.
pub(super) fn assemble(
    model: &dyn Hessian,
    dataset: &Dataset,
    settings: &Settings,
    start: &[f64],
) -> Result<Assembled, IdentError> {
    let (lower, upper, fixed) = super::bounds(model, start, &settings.hold);
    let mut tracks = Vec::new();
    let mut records = Vec::new();
    let mut notes = Vec::new();
    let mut inertia = MeanInertia::new(model, start);
    let held = settings.initial_state == InitialState::Measured;
    for (record, experiment) in dataset.with_role(Role::Train).enumerate() {
        let state = state_from_data(experiment, settings.cutoff)?;
        inertia.add(experiment, &state)?;
        if experiment.v.is_none() {
            notes.push(format!(
                "{}: velocities derived from positions, zero-phase filter at {:.1} Hz; they start the windows and are not fitted",
                experiment.name, state.cutoff
            ));
        }
        for range in windows(experiment, settings.horizon) {
            tracks.push(track(experiment, &state, range, held)?);
            records.push(record);
        }
    }
    let (mut loss, mut priors) = (Loss::Square, Vec::new());
    match &settings.likelihood {
        Some(likelihood) => {
            let level = |l: &Option<f64>| l.map_or(0.0, |l| 1.0 / (l * l));
            let weights: Vec<f64> = likelihood.noise.iter().map(level).collect();
            for track in &mut tracks {
                track.weights.clone_from(&weights);
            }
            (loss, priors) = (likelihood.loss, likelihood.priors.clone());
        }
        None => weigh(&mut tracks, &records, model.dims().nq, settings.weighting),
    }
    for j in anchored(model, dataset) {
        for track in &mut tracks {
            anchor(track, j, model.dims().nq);
        }
    }
    let setup = Setup {
        scheme: settings.scheme,
        curvature: settings.curvature,
        scale: super::scales(model),
        inertia: inertia.mean(),
        hold_initial: held,
        linear_inputs: dataset.input_hold == InputHold::Linear,
        substeps: settings.substeps,
        output: None,
        loss,
        priors,
        lower: lower.clone(),
        upper: upper.clone(),
    };
    Ok(Assembled {
        tracks,
        setup,
        lower,
        upper,
        fixed,
        notes,
    })
}

/// Coordinates whose value nothing depends on and that no record reads more than once (as that of a lagging velocity reading,
/// of which only the velocity means something): no reading determines where they start.
pub(super) fn anchored(model: &dyn Hessian, dataset: &Dataset) -> Vec<usize> {
    let nq = model.dims().nq;
    let (first, second) = (model.jacobian_pattern(), model.hessian_pattern());
    let used = |j: usize| {
        let places = first.cols.iter().chain(second.cols).chain(second.rows);
        places.into_iter().any(|c| *c as usize == j)
    };
    let read = |j: usize| {
        let readings = |e: &Experiment| {
            let own = e.q.iter().skip(j).step_by(nq);
            own.filter(|q| q.is_finite()).count()
        };
        dataset.with_role(Role::Train).map(readings).max()
    };
    (0..nq)
        .filter(|&j| read(j).unwrap_or(0) <= 1 && !used(j))
        .collect()
}

/// One reading of such a coordinate, at the start of a window; it costs nothing at the solution.
fn anchor(track: &mut Track, j: usize, nq: usize) {
    let nx = 2 * nq;
    for (k, row) in track.measured.chunks_exact_mut(nx).enumerate() {
        row[j] = if k == 0 { track.guess[j] } else { f64::NAN };
    }
    let velocity = track.weights[nq + j];
    track.weights[j] = if velocity > 0.0 { velocity } else { 1.0 };
}

/// Identifies by full discretization.
pub(super) fn identify(
    model: &dyn Hessian,
    dataset: &Dataset,
    settings: &Settings,
    start: &[f64],
    callback: &mut Callback<'_>,
) -> Result<Identification, IdentError> {
    let Assembled {
        tracks,
        mut setup,
        lower,
        upper,
        fixed,
        mut notes,
    } = assemble(model, dataset, settings, start)?;
    let explicit = ExplicitForm::new(model);
    let solved_form = solved_form(model, settings.scheme);
    if solved_form {
        setup.inertia = vec![1.0; model.dims().nq];
    }
    let program = || {
        if solved_form {
            FullDiscretization::solved(&explicit, &tracks, setup.clone())
        } else {
            FullDiscretization::new(model, &tracks, setup.clone())
        }
    };
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
        let mut problem = program();
        let start = all[index].clone();
        let (run, solution) = solve(&mut problem, settings, index, start, report);
        let motion = problem.states(&solution.x);
        (run, solution, motion)
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
    let mut problem = program();
    let (spread, noise) = deviations(
        &mut problem,
        &solutions[best],
        &fixed,
        &tracks[0].weights,
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
        windows: (tracks.len(), problem.samples()),
        force_error: Vec::new(),
        notes,
    })
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

fn system(problem: &FullDiscretization<'_>) -> Box<dyn Kkt> {
    let fixed = problem.fixed_parameters();
    if problem.layout().steps() == 0 {
        Box::new(SparseKkt::new(problem))
    } else {
        Box::new(problem.system(&fixed).refined_to(REFINED))
    }
}

fn solve(
    problem: &mut FullDiscretization<'_>,
    settings: &Settings,
    index: usize,
    start: Vec<f64>,
    report: &mut dyn FnMut(&'static str, &crate::solver::Iteration) -> ControlFlow<()>,
) -> (Run, Solution) {
    let started = Instant::now();
    let mut x0 = problem.starting_point(&start);
    let mut iterations = 0;
    if settings.prepare {
        let first = problem.layout().p();
        let options = crate::solver::Settings {
            // A start is wanted, not the optimum of the fit.
            tol: PREPARED,
            max_iterations: 100,
            ..settings.solver.clone()
        };
        let mut fit = ResidualFit::new(problem, &x0);
        let mut kkt = SparseKkt::new(&fit);
        let mut news = |line: &_, _: &[f64]| report("fitting the residual", line);
        let prepared = ip::solve(&mut fit, &mut kkt, &x0[first..], &options, &mut news);
        iterations += prepared.log.len().saturating_sub(1);
        if prepared.objective.is_finite() {
            x0[first..].copy_from_slice(&prepared.x);
        }
    }
    let samples = problem.samples() as f64;
    let growth = (samples / MANY).max(1.0);
    let options = crate::solver::Settings {
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
    let mut kkt = system(problem);
    let exact = settings.quasi_newton.is_none() && settings.curvature == Curvature::Exact;
    if settings.prepare && exact {
        iterations += approach(problem, kkt.as_mut(), &mut x0, &options, report);
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
    let check = check_point(problem, &solution.x, &solution.lambda);
    iterations += solution.log.len().saturating_sub(1);
    let run = Run {
        index,
        start,
        parameters: problem.parameters(&solution.x),
        objective: solution.objective,
        status: solution.status,
        iterations,
        seconds: started.elapsed().as_secs_f64(),
        check,
        log: solution.log.clone(),
    };
    (run, solution)
}

/// Gauss-Newton iterations until the steps nearly hold: far from that the multipliers, and with them the exact curvature of the
/// constraints, mean nothing. Returns the iterations it took.
fn approach(
    problem: &mut FullDiscretization<'_>,
    kkt: &mut dyn Kkt,
    x: &mut Vec<f64>,
    options: &crate::solver::Settings,
    report: &mut dyn FnMut(&'static str, &crate::solver::Iteration) -> ControlFlow<()>,
) -> usize {
    problem.set_curvature(Curvature::GaussNewton);
    let mut previous = f64::INFINITY;
    let options = crate::solver::Settings {
        max_iterations: APPROACH,
        ..options.clone()
    };
    let mut news = |line: &crate::solver::Iteration, _: &[f64]| {
        let settled = (line.objective - previous).abs() <= SETTLED * line.objective.abs();
        previous = line.objective;
        if report("approaching by Gauss-Newton", line).is_break()
            || line.primal_inf < NEAR && settled
        {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    };
    let near = ip::solve(problem, kkt, x, &options, &mut news);
    problem.set_curvature(Curvature::Exact);
    if near.objective.is_finite() {
        *x = near.x;
    }
    near.log.len().saturating_sub(1)
}

/// A window as the discretization wants it.
fn track(
    experiment: &Experiment,
    state: &StateEstimate,
    range: std::ops::Range<usize>,
    held: bool,
) -> Result<Track, IdentError> {
    let (nq, nu, first) = (experiment.nq, experiment.nu(), range.start);
    let mut track = Track {
        t: experiment.t[range.clone()].to_vec(),
        measured: vec![],
        guess: vec![],
        u: vec![],
        weights: vec![],
    };
    for k in range {
        let row = k * nq..(k + 1) * nq;
        let q = &experiment.q[row.clone()];
        let v = experiment.v.as_ref().map(|v| &v[row.clone()]);
        track.measured.extend_from_slice(q);
        let known = |j: usize| v.map_or(f64::NAN, |v| v[j]);
        track.measured.extend((0..nq).map(known));
        let or = |value: f64, other: f64| if value.is_nan() { other } else { value };
        track
            .guess
            .extend((0..nq).map(|j| or(q[j], state.q[row.start + j])));
        // A window that starts at its record takes the filtered velocity: a single sample is noisy.
        let filtered = held && k == first;
        let velocity = |j: usize| if filtered { f64::NAN } else { known(j) };
        track
            .guess
            .extend((0..nq).map(|j| or(velocity(j), state.v[row.start + j])));
        let u = &experiment.u[k * nu..(k + 1) * nu];
        if u.iter().any(|u| u.is_nan()) {
            return Err(IdentError::MissingInput {
                experiment: experiment.name.clone(),
                row: k + 1,
            });
        }
        track.u.extend_from_slice(u);
    }
    Ok(track)
}

/// Share of a channel's variance over all records below which a record's own variance does not count as motion.
const STILL: f64 = 1e-4;

/// Sets the channel weights of all windows; `records` tells which record each belongs to.
fn weigh(tracks: &mut [Track], records: &[usize], nq: usize, weighting: Weighting) {
    let nx = 2 * nq;
    let variance = |tracks: &[Track], channel: usize, record: Option<usize>| -> Option<f64> {
        let values: Vec<f64> = tracks
            .iter()
            .zip(records)
            .filter(|(_, r)| record.is_none_or(|only| only == **r))
            .flat_map(|(t, _)| t.measured.iter().skip(channel).step_by(nx).copied())
            .filter(|x| !x.is_nan())
            .collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / n;
        (variance > 0.0).then_some(variance)
    };
    let count = records.last().map_or(0, |r| r + 1);
    for channel in 0..nx {
        let overall = variance(tracks, channel, None).unwrap_or(1.0);
        let own: Vec<f64> = (0..count)
            .map(|r| match weighting {
                Weighting::Unit => 1.0,
                Weighting::Position => f64::from(u8::from(channel < nq)),
                Weighting::Spread => 1.0 / overall,
                Weighting::Record if channel >= nq => 0.0,
                Weighting::Record => {
                    let own = variance(tracks, channel, Some(r)).unwrap_or(0.0);
                    1.0 / own.max(STILL * overall)
                }
            })
            .collect();
        for (track, &record) in tracks.iter_mut().zip(records) {
            track.weights.push(own[record]);
        }
    }
}

/// Mean diagonal of M over the training samples; refuses a singular M.
struct MeanInertia<'a> {
    model: &'a dyn Hessian,
    p: &'a [f64],
    sum: Vec<f64>,
    count: f64,
}

impl<'a> MeanInertia<'a> {
    fn new(model: &'a dyn Hessian, p: &'a [f64]) -> Self {
        Self {
            model,
            p,
            sum: vec![0.0; model.dims().nq],
            count: 0.0,
        }
    }

    fn add(&mut self, experiment: &Experiment, state: &StateEstimate) -> Result<(), IdentError> {
        let dims = self.model.dims();
        let mut m = vec![0.0; dims.nm()];
        // A hundred samples a record tell the size of M and meet a structural singularity.
        let stride = experiment.len().div_ceil(100).max(1);
        for k in (0..experiment.len()).step_by(stride) {
            let row = k * dims.nq..(k + 1) * dims.nq;
            let at = At {
                q: &state.q[row.clone()],
                v: &state.v[row.clone()],
                a: &state.a[row.clone()],
                u: &experiment.u[k * dims.nu..(k + 1) * dims.nu],
                p: self.p,
            };
            self.model.mass_matrix(&at, &mut m);
            for j in 0..dims.nq {
                self.sum[j] += m[j * (j + 1) / 2 + j];
            }
            self.count += 1.0;
            if let Some((joint, pivot)) = singular(&mut m, dims.nq) {
                return Err(IdentError::SingularMassMatrix {
                    experiment: experiment.name.clone(),
                    time: experiment.t[k],
                    joint: self.model.joints()[joint].name.to_string(),
                    pivot,
                });
            }
        }
        Ok(())
    }

    fn mean(&self) -> Vec<f64> {
        self.sum.iter().map(|s| s / self.count.max(1.0)).collect()
    }
}

/// The joint whose Cholesky pivot of M is not clearly positive; M is overwritten.
fn singular(m: &mut [f64], n: usize) -> Option<(usize, f64)> {
    for i in 0..n {
        let diagonal = m[i * (i + 1) / 2 + i];
        for j in 0..=i {
            let mut sum = m[i * (i + 1) / 2 + j];
            for k in 0..j {
                sum -= m[i * (i + 1) / 2 + k] * m[j * (j + 1) / 2 + k];
            }
            if i == j {
                if sum.is_nan() || sum <= 1e-12 * diagonal.abs() {
                    return Some((i, sum));
                }
                m[i * (i + 1) / 2 + i] = sum.sqrt();
            } else {
                m[i * (i + 1) / 2 + j] = sum / m[j * (j + 1) / 2 + j];
            }
        }
    }
    None
}
