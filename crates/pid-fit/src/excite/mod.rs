//! Optimal excitation: motions from which a record tells most.
//!
//! ```text
//! minimise   Φ( 1/N Σ_i Y_iᵀ W Y_i )        Y_i: regressor of the parameters a motion determines, at sample i
//! subject to limits on q, v, a and on the force of every joint, and on the places of points, at every sample;
//!            at rest where a period begins
//! ```
//!
//! over the coefficients of a finite Fourier series (J. Swevers, C. Ganseman, D. Tükel, J. De
//! Schutter, H. Van Brussel, IEEE Trans. Robot. Autom. 13 (1997)). The regressor is the force's
//! derivative by the parameters at their nominal values, its columns those that are independent
//! there; parameters in which the force is no polynomial, and those whose effect depends on the
//! inputs, are taken as known. The program has exact first and second derivatives, all from the
//! model's generated Jacobian and Hessian, and is solved by [`ip`].

mod columns;
mod criterion;
mod error;
mod fourier;
mod limits;
mod program;
mod sensitivity;
mod settings;
mod workspace;

pub use columns::Without;
pub use criterion::Criterion;
pub use error::ExciteError;
pub use fourier::Fourier;
pub use limits::Limits;
pub use settings::Settings;
pub use workspace::Workspace;

use columns::{Columns, choose};
use criterion::measure;
use error::TRIES;
use pid_nlp::Nlp;
use pid_nlp::solver::kkt::sparse::SparseKkt;
use pid_nlp::solver::{Iteration, Status, ip};
use pid_runtime::dynamics::Hessian;
use program::{Binding, Program};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sensitivity::Sensitivity;
use std::ops::ControlFlow;

/// Samples of the check per sample of the program.
const FINER: usize = 10;
/// Most steps of shrinking, by 0.2 % each: 500 of them leave 37 % of a motion.
const SHRINKS: usize = 500;

/// Information of one period of a motion.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Information {
    /// Condition number of the weighted regressor, its columns scaled to their size over random poses.
    pub condition: f64,
    /// The criterion.
    pub value: f64,
    /// Standard deviation of each chosen parameter from white noise of the stated force, as if the
    /// others were known; in the order of [`Excitation::params`], in the parameter's unit.
    pub deviations: Vec<f64>,
}

/// An exciting motion.
#[derive(Debug, Clone)]
pub struct Excitation {
    /// The motion.
    pub motion: Fourier,
    /// Parameters that it determines: positions in p. Where others enter only together with them,
    /// the combination is meant.
    pub params: Vec<usize>,
    /// The other parameters, and why.
    pub without: Vec<(usize, Without)>,
    /// Information of the motion.
    pub information: Information,
    /// Information of each random start: multisines of the same harmonics, scaled up until a limit
    /// binds.
    pub random: Vec<Information>,
    /// Largest use of a limit on a grid ten times as fine, 1 = at the limit.
    pub largest_use: f64,
    /// How the solver ended.
    pub status: Status,
    /// Iterations of the best start.
    pub iterations: usize,
}

fn check(settings: &Settings, nq: usize) -> Result<(), ExciteError> {
    let setting = |what, value, help| Err(ExciteError::Setting { what, value, help });
    if !(settings.period.is_finite() && settings.period > 0.0) {
        return setting(
            "the period",
            settings.period,
            "give a positive time in seconds",
        );
    }
    if settings.harmonics < 2 {
        return setting(
            "the number of harmonics",
            settings.harmonics as f64,
            "at least 2: one harmonic cannot begin at rest",
        );
    }
    if settings.samples < 4 * settings.harmonics {
        return setting(
            "the number of samples",
            settings.samples as f64,
            "at least four per harmonic, or limits are passed between the samples",
        );
    }
    if settings.starts == 0 {
        return setting("the number of starts", 0.0, "at least 1");
    }
    if !(0.0..1.0).contains(&settings.margin) {
        return setting("the margin", settings.margin, "a share from 0 to below 1");
    }
    if !settings.deviations.is_empty() && settings.deviations.len() != nq {
        return Err(ExciteError::Count {
            what: "deviations of the force",
            len: settings.deviations.len(),
            nq,
        });
    }
    if let Some(bad) = settings
        .deviations
        .iter()
        .find(|s| !(s.is_finite() && **s > 0.0))
    {
        return setting("a deviation of the force", *bad, "give a positive number");
    }
    Ok(())
}

/// Seeks the motion at parameters p. The callback sees the start's number and every iteration;
/// `Break` ends the search and keeps the results so far.
pub fn excite(
    model: &dyn Hessian,
    p: &[f64],
    limits: &Limits<'_>,
    settings: &Settings,
    callback: &mut dyn FnMut(usize, &Iteration) -> ControlFlow<()>,
) -> Result<Excitation, ExciteError> {
    let nq = model.dims().nq;
    limits.check(model)?;
    check(settings, nq)?;
    let deviations = deviations(settings, nq);
    let columns = choose(model, p, limits, &deviations, settings.seed)?;
    let sensitivity = Sensitivity::new(model, p, &columns, &deviations);
    let mut program = Program::new(sensitivity, limits, settings);
    let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
    let (mut best, mut random) = (None::<(f64, Fourier, Status, usize)>, Vec::new());
    let mut stopped = false;
    for start in 0..settings.starts {
        let x0 = multisine(model, &mut program, limits, settings, &mut rng)?;
        random.push(judge(&mut program, &columns, settings, &x0));
        if stopped {
            continue;
        }
        let mut kkt = SparseKkt::new(&program);
        let solution = ip::solve(
            &mut program,
            &mut kkt,
            &x0,
            &settings.solver,
            &mut |i, _| {
                let flow = callback(start, i);
                stopped |= flow.is_break();
                flow
            },
        );
        let within = program.largest_use(&solution.x) <= 1.0;
        let (value, x) = match within && solution.objective.is_finite() {
            true => (program.objective(&solution.x), solution.x),
            false => (program.objective(&x0), x0),
        };
        if best.as_ref().is_none_or(|b| value < b.0) {
            let motion = Fourier {
                period: settings.period,
                harmonics: settings.harmonics,
                coefficients: x,
            };
            let iterations = solution.log.last().map_or(0, |i| i.iteration);
            best = Some((value, motion, solution.status, iterations));
        }
    }
    let (_, mut motion, status, iterations) = best.ok_or(ExciteError::NothingToDetermine)?;
    let largest_use = fit(model, p, limits, settings, &mut motion);
    let information = judge(&mut program, &columns, settings, &motion.coefficients);
    Ok(Excitation {
        information,
        largest_use,
        motion,
        params: columns.params,
        without: columns.without,
        random,
        status,
        iterations,
    })
}

/// The program of [`excite`] itself: variables are [`Fourier::coefficients`], rows the limits of
/// every sample as shares.
pub fn program<'a>(
    model: &'a dyn Hessian,
    p: &[f64],
    limits: &Limits<'a>,
    settings: &Settings,
) -> Result<impl Nlp + use<'a>, ExciteError> {
    let nq = model.dims().nq;
    limits.check(model)?;
    check(settings, nq)?;
    let deviations = deviations(settings, nq);
    let columns = choose(model, p, limits, &deviations, settings.seed)?;
    let sensitivity = Sensitivity::new(model, p, &columns, &deviations);
    Ok(Program::new(sensitivity, limits, settings))
}

fn deviations(settings: &Settings, nq: usize) -> Vec<f64> {
    match settings.deviations.is_empty() {
        true => vec![1.0; nq],
        false => settings.deviations.clone(),
    }
}

/// Shrinks a motion about its middle until it keeps its limits on a fine grid, and returns the
/// largest use of a limit there. Where the middle itself is outside a box, shrinking does not help:
/// then it takes the motion that exceeds its limits least.
fn fit(
    model: &dyn Hessian,
    p: &[f64],
    limits: &Limits<'_>,
    settings: &Settings,
    motion: &mut Fourier,
) -> f64 {
    let fine = Settings {
        samples: FINER * settings.samples,
        ..settings.clone()
    };
    let none = Columns {
        params: Vec::new(),
        scale: Vec::new(),
        without: Vec::new(),
    };
    let ones = vec![1.0; limits.v.len()];
    let mut program = Program::new(Sensitivity::new(model, p, &none, &ones), limits, &fine);
    let width = motion.width();
    let mut used = program.largest_use(&motion.coefficients);
    let mut smaller = motion.coefficients.clone();
    for _ in 0..SHRINKS {
        if used <= 1.0 {
            break;
        }
        let amplitudes = smaller.iter_mut().enumerate();
        amplitudes
            .filter(|(k, _)| k % width != 0)
            .for_each(|(_, x)| *x *= 0.998);
        let now = program.largest_use(&smaller);
        if now < used {
            used = now;
            motion.coefficients.copy_from_slice(&smaller);
        }
    }
    used
}

/// A random multisine at rest where its period begins, as large as the limits allow.
fn multisine(
    model: &dyn Hessian,
    program: &mut Program<'_>,
    limits: &Limits<'_>,
    settings: &Settings,
    rng: &mut ChaCha8Rng,
) -> Result<Vec<f64>, ExciteError> {
    let (nq, width) = (limits.v.len(), 2 * settings.harmonics + 1);
    let ranges: Vec<(f64, f64)> = (0..nq).map(|j| limits.range(j)).collect();
    let mut nearest = None::<(f64, Binding)>;
    for _ in 0..TRIES {
        let mut x = vec![0.0; nq * width];
        for (j, x) in x.chunks_exact_mut(width).enumerate() {
            let (low, high) = ranges[j];
            x[0] = rng.random_range(low + 0.25 * (high - low)..=high - 0.25 * (high - low));
            for k in 1..width {
                x[k] = limits.v[j] * rng.random_range(-1.0..=1.0);
            }
            if settings.at_rest {
                let last = settings.harmonics;
                x[2 * last - 1] = -(1..last).map(|k| x[2 * k - 1]).sum::<f64>();
                x[2 * last] = -(1..last).map(|k| k as f64 * x[2 * k]).sum::<f64>() / last as f64;
            }
        }
        if let Some(places) = program.places() {
            let mut pose: Vec<f64> = x.iter().step_by(width).copied().collect();
            places.bring_inside(&mut pose, &ranges);
            x.iter_mut()
                .step_by(width)
                .zip(pose)
                .for_each(|(x, q)| *x = q);
        }
        let scaled = |s: f64| -> Vec<f64> {
            let shrink = |(k, x): (usize, &f64)| if k % width == 0 { *x } else { s * x };
            x.iter().enumerate().map(shrink).collect()
        };
        let within = 1.0 - settings.margin;
        let at_rest = program.binding(&scaled(0.0));
        if at_rest.0 > 0.9 * within {
            if nearest.is_none_or(|n| at_rest.0 < n.0) {
                nearest = Some(at_rest);
            }
            continue;
        }
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if program.largest_use(&scaled(middle)) <= within {
                low = middle;
            } else {
                high = middle;
            }
        }
        return Ok(scaled(low));
    }
    Err(match nearest {
        Some((_, Binding::Place(at, value))) => {
            let named = program.places().map(|places| places.named(at));
            let (point, axis, (low, high)) = named.unwrap_or_default();
            ExciteError::OutOfReach {
                point,
                axis,
                value,
                low,
                high,
            }
        }
        Some((share, Binding::Force(joint))) => ExciteError::TooWeak {
            joint: model.joints()[joint].name.to_string(),
            needed: share * limits.force[joint],
            limit: limits.force[joint],
        },
        _ => ExciteError::NothingToDetermine,
    })
}

/// Computes the information of a motion.
fn judge(
    program: &mut Program<'_>,
    columns: &Columns,
    settings: &Settings,
    x: &[f64],
) -> Information {
    let a = program.information(x);
    let measured = measure(settings.criterion, &a);
    let (l, q) = (&measured.eigen.eigenvalues, &measured.eigen.eigenvectors);
    let variance = |k: usize| -> f64 {
        l.iter()
            .enumerate()
            .map(|(i, l)| q[(k, i)] * q[(k, i)] / l)
            .sum()
    };
    Information {
        condition: measured.condition(),
        value: measured.value,
        deviations: columns
            .scale
            .iter()
            .enumerate()
            .map(|(k, s)| s * (variance(k) / settings.samples as f64).sqrt())
            .collect(),
    }
}
