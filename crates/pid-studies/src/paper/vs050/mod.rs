//! The job of figures 6 and 7: the DENSO VS-050 with axes 3 to 6 fixed.
//!
//! The records come from the arm with all its six axes; the model that is fitted holds axes 3 to 6
//! fixed. As in the paper: joint angles and velocities with equal weights, one window, trapezoidal
//! rule. Beyond it: the exact Hessian beside BFGS, and the fit with one record of the other kind
//! added.

mod page;
mod records;

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::time::Duration;

use pid_data::{Dataset, Horizon, Role};
use pid_fit::gap::metrics::{FreeRunSettings, free_run, free_run_table};
use pid_fit::ident::{self, IdentError, Identification, InitialState, Method, Settings, Weighting};
use pid_fit::transcribe::Scheme;
use pid_models::Vs050TwoAxis;
use pid_nlp::solver;
use pid_runtime::dynamics::Dynamics;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use super::study::{self, Second};
use crate::Failure;

pub(super) use page::{html, row, text};

/// Steps that BFGS remembers: a limited memory of the usual size, since each step costs much with
/// 68 parameters.
const MEMORY: usize = 10;

/// Seconds after which a simulation is restarted from the record in the second of the two scores.
const HORIZON: f64 = 1.0;

/// One fit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Fit {
    pub(super) hessian: Second,
    /// Whether a record of the other kind is fitted too.
    pub(super) both_kinds: bool,
    pub(super) start: usize,
    pub(super) objective: f64,
    pub(super) violation: f64,
    pub(super) converged: bool,
    pub(super) limited: bool,
    pub(super) status: String,
    pub(super) iterations: usize,
    pub(super) seconds: f64,
    pub(super) undetermined: usize,
    pub(super) parameters: Vec<f64>,
    /// RMS of the joint angles, rad, per record of the set: simulated over the whole record, and restarted.
    pub(super) whole: Vec<Option<f64>>,
    pub(super) restarted: Vec<Option<f64>>,
    /// Joint angles simulated over the whole of each record; empty where the motion diverges.
    #[serde(skip)]
    pub(super) simulated: Vec<Vec<f64>>,
}

/// The fits and their records.
#[derive(Debug, Serialize)]
pub(super) struct Arm {
    pub(super) starts: usize,
    pub(super) parameters: usize,
    pub(super) fits: Vec<Fit>,
    /// Names of the records, in the order of the scores.
    pub(super) records: Vec<String>,
    #[serde(skip)]
    pub(super) dataset: Dataset,
}

impl Arm {
    /// The fits of one kind.
    fn group(&self, hessian: Second, both_kinds: bool) -> Vec<&Fit> {
        let wanted = |f: &&Fit| (f.hessian, f.both_kinds) == (hessian, both_kinds);
        self.fits.iter().filter(wanted).collect()
    }

    /// The feasible one of a kind with the lowest objective.
    fn best(&self, hessian: Second, both_kinds: bool) -> Option<&Fit> {
        let usable = |f: &&Fit| f.objective.is_finite() && f.violation <= study::FEASIBLE;
        let fits = self.group(hessian, both_kinds).into_iter().filter(usable);
        fits.min_by(|a, b| a.objective.total_cmp(&b.objective))
    }
}

/// Hessian, and whether both kinds of motion are fitted.
const KINDS: [(Second, bool); 3] = [
    (Second::Exact, false),
    (Second::Bfgs, false),
    (Second::Exact, true),
];

/// Starts: each body as a whole by a factor 10^U(−0.3, 0.3), so that it stays one that can exist,
/// and the same for every constant of drive and friction.
fn starts(count: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x0074_776f);
    let infos = Vs050TwoAxis.params();
    let body = |name: &str| {
        let link = name.split_once('_').map_or("", |(link, _)| link);
        link.starts_with('l').then(|| link.to_owned())
    };
    let mut one = || {
        let mut factors: BTreeMap<String, f64> = BTreeMap::new();
        let mut start = Vec::with_capacity(infos.len());
        for info in infos {
            let key = body(&info.name).unwrap_or_else(|| info.name.to_string());
            let factor = *factors
                .entry(key)
                .or_insert_with(|| 10f64.powf(0.6 * random.random::<f64>() - 0.3));
            start.push((factor * info.nominal).clamp(info.lower, info.upper));
        }
        start
    };
    (0..count).map(|_| one()).collect()
}

fn settings(hessian: Second, max_iterations: usize, limit: Duration) -> Settings {
    Settings {
        method: Method::FullDiscretization,
        scheme: Scheme::Trapezoidal,
        quasi_newton: (hessian == Second::Bfgs).then_some(MEMORY),
        horizon: Horizon::Record,
        initial_state: InitialState::Free,
        weighting: Weighting::Unit,
        solver: solver::Settings {
            max_iterations,
            max_time: Some(limit),
            ..Settings::default().solver
        },
        ..Settings::default()
    }
}

/// The records with the last one fitted too.
fn with_both_kinds(dataset: &Dataset) -> Dataset {
    let mut both = dataset.clone();
    if let Some(last) = both.experiments.last_mut() {
        last.role = Role::Train;
    }
    both
}

fn judged(
    dataset: &Dataset,
    (hessian, both_kinds): (Second, bool),
    start: usize,
    found: &Identification,
) -> Fit {
    let best = found.best();
    let p = &best.parameters;
    let whole_settings = FreeRunSettings::new(Horizon::Record);
    let rms = |settings: &FreeRunSettings| -> Vec<Option<f64>> {
        let Ok(table) = free_run_table(&Vs050TwoAxis, p, dataset, settings) else {
            return vec![None; dataset.experiments.len()];
        };
        let of_record = |e: &pid_fit::gap::metrics::FreeRunScore| {
            let squares: Option<f64> = e.joints.iter().map(|j| Some(j.q?.rms.powi(2))).sum();
            squares
                .filter(|_| e.diverged == 0)
                .map(|s| (s / e.joints.len() as f64).sqrt())
        };
        table.experiments.iter().map(of_record).collect()
    };
    let simulated = |e| {
        free_run(&Vs050TwoAxis, p, dataset, e, &whole_settings)
            .ok()
            .filter(|run| run.diverged.is_empty())
            .map_or_else(Vec::new, |run| run.q)
    };
    Fit {
        hessian,
        both_kinds,
        start,
        objective: best.objective,
        violation: best.check.primal_inf,
        converged: best.status.converged(),
        limited: best.status.is_limit(),
        status: best.status.reason().to_owned(),
        iterations: best.iterations,
        seconds: best.seconds,
        undetermined: found.undetermined,
        parameters: p.clone(),
        whole: rms(&whole_settings),
        restarted: rms(&FreeRunSettings::new(Horizon::Seconds(HORIZON))),
        simulated: dataset.experiments.iter().map(simulated).collect(),
    }
}

/// Simulates the arm and makes all fits. `news` is told how many are done; `stop` ends early and
/// keeps the finished ones.
///
/// # Errors
/// That of the simulation, and of an identification that cannot begin.
pub(super) fn run(
    (count, seed): (usize, u64),
    (max_iterations, limit): (usize, Duration),
    news: &(dyn Fn(usize) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Arm, Failure> {
    let dataset = records::dataset(seed)?;
    let both = with_both_kinds(&dataset);
    let starts = starts(count, seed);
    let jobs: Vec<((Second, bool), usize)> = (0..count)
        .flat_map(|start| KINDS.map(|kind| (kind, start)))
        .collect();
    let fit = |index: usize| -> Result<Fit, IdentError> {
        let (kind, start) = jobs[index];
        let data = if kind.1 { &both } else { &dataset };
        let mut news = |_: &ident::Progress<'_>| {
            if stop() {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        };
        let settings = settings(kind.0, max_iterations, limit);
        let found = ident::identify(
            &Vs050TwoAxis,
            data,
            &settings,
            Some(&starts[start]),
            &mut news,
        )?;
        Ok(judged(data, kind, start, &found))
    };
    let fits = study::parallel(jobs.len(), news, stop, fit);
    Ok(Arm {
        starts: count,
        parameters: Vs050TwoAxis.dims().np,
        fits: fits.into_iter().collect::<Result<_, _>>()?,
        records: dataset.experiments.iter().map(|e| e.name.clone()).collect(),
        dataset,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A body that is scaled as a whole stays one that can exist: M is positive definite at every start.
    #[test]
    fn starts_are_arms_that_can_exist() {
        use pid_runtime::dynamics::At;
        for p in starts(20, 3) {
            for q in [[0.0, 0.0], [1.0, 1.5], [-2.0, -0.7]] {
                let zero = [0.0; 2];
                let at = At {
                    q: &q,
                    v: &zero,
                    a: &zero,
                    u: &zero,
                    p: &p,
                };
                let mut m = [0.0; 3];
                Vs050TwoAxis.mass_matrix(&at, &mut m);
                assert!(m[0] > 0.0 && m[0] * m[2] > m[1] * m[1], "{m:?}");
            }
        }
    }
}
