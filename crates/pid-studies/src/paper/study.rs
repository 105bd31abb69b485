//! The runs behind the figures.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use pid_data::{Dataset, Horizon};
use pid_fit::gap::metrics::{FreeRunSettings, free_run_table};
use pid_fit::ident::{
    self, IdentError, Identification, InitialState, Method, Prepare, Settings, Weighting,
};
use pid_fit::transcribe::{Curvature, Scheme};
use pid_models::TwoLink;
use pid_nlp::solver;
use serde::Serialize;
use std::ops::ControlFlow;

/// Second derivatives that the study compares.
pub(super) const HESSIANS: [(Second, &str); 3] = [
    (Second::Exact, "exact"),
    (Second::Bfgs, "BFGS, the paper's setting"),
    (Second::GaussNewton, "Gauss-Newton"),
];

/// Where second derivatives come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub(super) enum Second {
    /// The second derivatives themselves.
    Exact,
    /// Damped BFGS from the last [`MEMORY`] steps.
    Bfgs,
    /// Without the second derivatives of the steps.
    GaussNewton,
}

/// Steps that BFGS remembers.
pub(super) const MEMORY: usize = 40;

/// One identification to be made.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Job {
    /// Nodes M of shooting; `None` for full discretization.
    pub(super) nodes: Option<usize>,
    pub(super) scheme: Scheme,
    pub(super) substeps: usize,
    pub(super) hessian: Second,
    /// Whether shooting starts from the solution with a node at every sample.
    pub(super) lift: bool,
    /// Number of the start.
    pub(super) start: usize,
}

/// Its outcome.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Outcome {
    pub(super) job: Job,
    /// J; `None` where the point is not feasible to 1e-6 or not finite.
    pub(super) objective: Option<f64>,
    /// J of an accurate simulation with the parameters: train, then the unseen records; `None`
    /// where it diverges.
    pub(super) accurate: Vec<Option<f64>>,
    pub(super) converged: bool,
    /// Whether a limit on time or iterations ended it.
    pub(super) limited: bool,
    pub(super) status: String,
    pub(super) iterations: usize,
    pub(super) seconds: f64,
    pub(super) parameters: Vec<f64>,
    /// Directions in parameter space that the record does not determine.
    pub(super) undetermined: usize,
    /// Fitted states.
    #[serde(skip)]
    pub(super) motion: Vec<f64>,
}

/// Largest violation of a constraint at a point that counts.
pub(super) const FEASIBLE: f64 = 1e-6;

fn settings(job: &Job, max_iterations: usize, limit: Duration) -> Settings {
    Settings {
        method: if job.nodes.is_some() {
            Method::Shooting
        } else {
            Method::FullDiscretization
        },
        scheme: job.scheme,
        substeps: job.substeps,
        nodes: job.nodes.unwrap_or(1),
        lift: Some(job.lift),
        curvature: if job.hessian == Second::GaussNewton {
            Curvature::GaussNewton
        } else {
            Curvature::Exact
        },
        quasi_newton: (job.hessian == Second::Bfgs).then_some(MEMORY),
        horizon: Horizon::Record,
        initial_state: InitialState::Free,
        weighting: Weighting::Unit,
        prepare: Prepare::Nothing,
        solver: solver::Settings {
            max_iterations,
            max_time: Some(limit),
            ..Settings::default().solver
        },
        ..Settings::default()
    }
}

fn outcome(dataset: &Dataset, job: &Job, found: Identification) -> Outcome {
    let best = found.best();
    let usable = best.objective.is_finite() && best.check.primal_inf <= FEASIBLE;
    let accurate = free_run_table(
        &TwoLink,
        &best.parameters,
        dataset,
        &FreeRunSettings::new(Horizon::Record),
    )
    .map(|table| table.experiments.iter().map(|e| e.objective).collect())
    .unwrap_or_default();
    Outcome {
        job: job.clone(),
        objective: usable.then_some(best.objective),
        accurate,
        converged: best.status.converged(),
        limited: best.status.is_limit(),
        status: best.status.reason().to_owned(),
        iterations: best.iterations,
        seconds: best.seconds,
        parameters: best.parameters.clone(),
        undetermined: found.undetermined,
        motion: found.motion,
    }
}

/// Makes all identifications; `limit` is the time for each solve. `news` is told how many are done;
/// `stop` ends early and keeps the finished ones.
pub(super) fn run(
    dataset: &Dataset,
    starts: &[Vec<f64>],
    jobs: &[Job],
    (max_iterations, limit): (usize, Duration),
    news: &(dyn Fn(usize) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Vec<Outcome>, IdentError> {
    let one = |index: usize| {
        let job = &jobs[index];
        let found = ident::identify(
            &TwoLink,
            dataset,
            &settings(job, max_iterations, limit),
            Some(&starts[job.start]),
            &mut |_| {
                if stop() {
                    ControlFlow::Break(())
                } else {
                    ControlFlow::Continue(())
                }
            },
        );
        found.map(|found| outcome(dataset, job, found))
    };
    parallel(jobs.len(), news, stop, one).into_iter().collect()
}

/// Does `count` pieces of work, as many at a time as there are cores, and returns the results in
/// order. If `stop` says so, it leaves out those not yet begun.
pub(super) fn parallel<T: Send>(
    count: usize,
    news: &(dyn Fn(usize) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
    work: impl Fn(usize) -> T + Sync,
) -> Vec<T> {
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let results: Mutex<Vec<(usize, T)>> = Mutex::new(Vec::new());
    let workers = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..workers.min(count) {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= count || stop() {
                        return;
                    }
                    let result = work(index);
                    if let Ok(mut results) = results.lock() {
                        results.push((index, result));
                    }
                    news(done.fetch_add(1, Ordering::Relaxed) + 1);
                }
            });
        }
    });
    let mut results = results.into_inner().unwrap_or_default();
    results.sort_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}
