//! Coverage of the intervals: records are simulated with noise of known size and identified, and
//! the truth is looked for in the intervals.
//!
//! A model whose parameters enter through fewer combinations has no interval for each of them.
//! Parameters are therefore held at the truth until the others are determined one by one. In each
//! direction that the records leave open, the parameter that moves most is held. Each remaining
//! parameter then stands for the combination it is part of.

use std::ops::ControlFlow;

use pid_data::Dataset;
use pid_fit::ident::{self, IdentError, Identification, Profiler, Progress, Settings};
use pid_fit::integrate::SimulateError;
use pid_runtime::dynamics::Hessian;
use rayon::prelude::*;

use pid_fit::synthetic::{Recipe, records};

/// Half width of a 95 % interval in standard deviations; its square is χ²₁(0.95).
const QUANTILE: f64 = 1.959_963_984_540_054;
/// Most rounds of holding parameters.
const ROUNDS: usize = 20;

/// A mean error above this many scatters is no bias of an estimator near the truth: the fits found
/// another solution.
pub const FAR: f64 = 20.0;

/// A study that cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CoverageError {
    /// A motion cannot be simulated.
    #[error("the motion of set {set} cannot be simulated: {error}\n  help: lower the amplitudes")]
    Simulate {
        /// Number of the set, from 0.
        set: usize,
        /// Why.
        error: SimulateError,
    },
    /// An identification cannot start.
    #[error(transparent)]
    Identify(#[from] IdentError),
    /// Nothing is determined.
    #[error(
        "no parameter is determined by these records\n  help: longer records, larger amplitudes or less noise"
    )]
    NothingDetermined,
}

/// Coverage of one parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Position of the parameter.
    pub parameter: usize,
    /// Share of the sets whose 95 % interval holds the truth.
    pub share: f64,
    /// Sets with an interval; in the others the parameter lay at a bound or was not determined.
    pub sets: usize,
    /// Mean error over the scatter of the estimates.
    pub bias: f64,
    /// Scatter of the estimates.
    pub scatter: f64,
    /// Mean standard deviation they state.
    pub stated: f64,
    /// Share of the sets whose 95 % interval by profile likelihood holds the truth, and the sets
    /// with such an interval, those with the parameter at a bound included; `None` unless it was
    /// asked for.
    pub profile: Option<(f64, usize)>,
}

/// The size of a study.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Study {
    /// Number of data sets.
    pub sets: usize,
    /// Seed of the first; each further one has the next.
    pub seed: u64,
    /// Parameters whose intervals by profile likelihood are counted too, one more fit per set each;
    /// those held are passed over.
    pub profiled: Vec<usize>,
}

/// A finished study.
#[derive(Debug, Clone, PartialEq)]
pub struct Coverage {
    /// The parameters that were free.
    pub rows: Vec<Row>,
    /// Parameters held at the truth.
    pub held: Vec<usize>,
    /// Sets that were identified, and sets whose solver did not converge (left out).
    pub sets: (usize, usize),
    /// Whether the estimates lie together far from the truth ([`FAR`] deviations in a third of the
    /// parameters): other values of the free parameters then make the same motions. Held sets leave
    /// such discrete ambiguities where the combinations are not linear in the parameters.
    pub elsewhere: bool,
    /// Whether it was interrupted.
    pub interrupted: bool,
}

impl Coverage {
    /// Share over all parameters together.
    pub fn overall(&self) -> f64 {
        let (held, all) = self.rows.iter().fold((0.0, 0.0), |(h, a), r| {
            (h + r.share * r.sets as f64, a + r.sets as f64)
        });
        held / f64::max(all, 1.0)
    }
}

/// Simulates and identifies the data sets of a study; `settings` as for one of them, the fits start
/// at the truth.
///
/// `news` is called with the number of finished sets and may end the study.
///
/// # Errors
/// [`CoverageError`].
pub fn coverage(
    model: &dyn Hessian,
    truth: &[f64],
    recipe: &Recipe,
    settings: &Settings,
    study: &Study,
    news: &(dyn Fn(usize) -> ControlFlow<()> + Sync),
) -> Result<Coverage, CoverageError> {
    let make = |set: usize| -> Result<Dataset, CoverageError> {
        records(model, truth, recipe, study.seed.wrapping_add(set as u64))
            .map_err(|error| CoverageError::Simulate { set, error })
    };
    let fit = |dataset: &Dataset, settings: &Settings| -> Result<Identification, IdentError> {
        let go_on = &mut |_: &Progress<'_>| ControlFlow::Continue(());
        ident::identify(model, dataset, settings, Some(truth), go_on)
    };
    // What the first set leaves open is held.
    let mut settings = settings.clone();
    let first = make(0)?;
    hold_open(&mut settings, |settings| fit(&first, settings))?;
    let free: Vec<usize> = (0..truth.len())
        .filter(|j| !model.params()[*j].fixed && !settings.hold.contains(j))
        .collect();
    if free.is_empty() {
        return Err(CoverageError::NothingDetermined);
    }
    let done = std::sync::atomic::AtomicUsize::new(0);
    let stopped = std::sync::atomic::AtomicBool::new(false);
    use std::sync::atomic::Ordering::Relaxed;
    let profiled: Vec<usize> = free
        .iter()
        .copied()
        .filter(|j| study.profiled.contains(j))
        .collect();
    type Set = (Identification, Vec<f64>);
    let found: Vec<Option<Set>> = (0..study.sets)
        .into_par_iter()
        .map(|set| {
            if stopped.load(Relaxed) {
                return Ok(None);
            }
            let dataset = make(set)?;
            let found = fit(&dataset, &settings)?;
            let mut costs = Vec::with_capacity(profiled.len());
            if !profiled.is_empty() {
                let go_on = &mut |_: &Progress<'_>| ControlFlow::Continue(());
                let profiler = Profiler::new(model, &dataset, &settings, &found, go_on)?;
                for &j in &profiled {
                    costs.push(profiler.deviance(j, truth[j], go_on)?);
                }
            }
            if news(done.fetch_add(1, Relaxed) + 1).is_break() {
                stopped.store(true, Relaxed);
            }
            Ok(Some((found, costs)))
        })
        .collect::<Result<_, CoverageError>>()?;
    let all: Vec<Set> = found.into_iter().flatten().collect();
    let (good, bad): (Vec<_>, Vec<_>) = all
        .into_iter()
        .partition(|(f, _)| f.best().status.converged());
    let rows: Vec<Row> = free
        .iter()
        .map(|&j| {
            let at = profiled.iter().position(|&p| p == j);
            Row {
                profile: at.map(|at| held_by_profiles(good.iter().map(|(_, costs)| costs[at]))),
                ..row(j, truth[j], good.iter().map(|(f, _)| f))
            }
        })
        .collect();
    let far = rows.iter().filter(|r| r.bias.abs() > FAR).count();
    Ok(Coverage {
        elsewhere: good.len() > 2 && 3 * far >= rows.len(),
        rows,
        held: settings.hold,
        sets: (good.len(), bad.len()),
        interrupted: stopped.into_inner(),
    })
}

/// Holds the parameters that fits leave open, one of each direction, then those without an interval.
fn hold_open(
    settings: &mut Settings,
    fit: impl Fn(&Settings) -> Result<Identification, IdentError>,
) -> Result<(), IdentError> {
    for _ in 0..ROUNDS {
        let found = fit(settings)?;
        let hold: Vec<usize> = found
            .open
            .iter()
            .filter_map(|direction| {
                let most = direction
                    .iter()
                    .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
                most.map(|m| m.0)
            })
            .collect();
        if hold.is_empty() {
            // Too wide for an interval, although no direction is open by itself.
            let wide: Vec<usize> = (0..found.fixed.len())
                .filter(|&j| !found.fixed[j] && found.deviations[j].is_none())
                .collect();
            settings.hold.extend(wide);
            return Ok(());
        }
        settings.hold.extend(hold);
        settings.hold.sort_unstable();
        settings.hold.dedup();
    }
    Ok(())
}

/// Share of the deviances at the truth within an interval of 95 %, and their number.
fn held_by_profiles(costs: impl Iterator<Item = f64>) -> (f64, usize) {
    let known: Vec<f64> = costs.filter(|c| c.is_finite()).collect();
    let within = known.iter().filter(|c| **c <= QUANTILE * QUANTILE).count();
    (within as f64 / known.len().max(1) as f64, known.len())
}

fn row<'a>(parameter: usize, truth: f64, found: impl Iterator<Item = &'a Identification>) -> Row {
    let pairs: Vec<(f64, f64)> = found
        .filter_map(|f| Some((f.best().parameters[parameter], f.deviations[parameter]?)))
        .collect();
    let n = pairs.len().max(1) as f64;
    let within = |(x, s): &&(f64, f64)| (x - truth).abs() <= QUANTILE * s;
    let mean = pairs.iter().map(|p| p.0).sum::<f64>() / n;
    let square: f64 = pairs.iter().map(|p| (p.0 - mean).powi(2)).sum();
    let scatter = (square / (n - 1.0).max(1.0)).sqrt();
    Row {
        parameter,
        share: pairs.iter().filter(within).count() as f64 / n,
        sets: pairs.len(),
        bias: (mean - truth) / scatter.max(f64::MIN_POSITIVE),
        scatter,
        stated: pairs.iter().map(|p| p.1).sum::<f64>() / n,
        profile: None,
    }
}
