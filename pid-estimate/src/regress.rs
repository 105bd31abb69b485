//! The whole regression: records in, base parameters with deviations, checks on records never fitted, and what they cover out.

use std::time::Instant;

use nalgebra::DVector;
use pid_runtime::data::{Dataset, Role};
use pid_runtime::dynamics::{Hessian, ParamInfo};
use pid_runtime::signal::SignalError;
use rayon::prelude::*;

use crate::columns::LinearModel;
use crate::consistent::{self, Consistent};
use crate::control::Controllers;
use crate::filter_choice::{self, Choice};
use crate::instruments::{self, InstrumentError, Rounds};
use crate::normal::Normal;
use crate::poses::indefinite_share;
use crate::range::{self, Excess};
use crate::record::{Filtering, Record};
use crate::solution::{self, RegressionError, Solution, as_columns, weighted};
use crate::term::{REST_ROTATION, REST_TRANSLATION};

/// Values of each shape parameter that are tried over its range, and passes over all of them.
const SHAPES: usize = 12;
/// Passes over the shape parameters.
const SHAPE_PASSES: usize = 2;
/// Folds of a record that stands alone.
const FOLDS: usize = 4;

/// What can be chosen.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Filters.
    pub filtering: Filtering,
    /// Whether the cut-off is chosen by left-out training records; that of `filtering` then does not count.
    pub choose_filter: bool,
    /// Names of parameters held at their start.
    pub hold: Vec<String>,
    /// Multiple of the transition velocity v₀ below which a joint counts as resting; its rows are then left out of the fit
    /// (not of the judgement). 0 keeps all.
    pub rest: f64,
    /// The controllers of the records, for instrumental variables in place of least squares.
    pub instruments: Option<Controllers>,
    /// Whether shape parameters (Stribeck velocities) are sought, or held at their start.
    pub shapes: bool,
    /// Whether physically consistent values are sought.
    pub consistent: bool,
    /// Random poses for the check of the mass matrix.
    pub poses: usize,
    /// Draws of the block bootstrap; 0 for none.
    pub bootstrap: usize,
    /// Seed of poses and bootstrap.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            filtering: Filtering::default(),
            choose_filter: false,
            hold: Vec::new(),
            rest: 2.0,
            instruments: None,
            shapes: true,
            consistent: true,
            poses: 10_000,
            bootstrap: 0,
            seed: 0,
        }
    }
}

/// A regression that cannot be done.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RegressError {
    /// A record cannot be filtered.
    #[error(transparent)]
    Signal(#[from] SignalError),
    /// Instruments cannot be made.
    #[error(transparent)]
    Instruments(#[from] InstrumentError),
    /// The normal equations cannot be solved.
    #[error(transparent)]
    Regression(#[from] RegressionError),
    /// A parameter to hold that does not exist.
    #[error(
        "the model has no parameter `{name}` to hold\n  help: `pid models` lists the models, the report their parameters"
    )]
    UnknownParameter {
        /// Its name.
        name: String,
    },
}

/// Residual force of the joints over some records.
#[derive(Debug, Clone, PartialEq)]
pub struct Errors {
    /// Name of the record, or of the role for all of them together.
    pub records: String,
    /// RMS of the residual of each joint, N·m or N.
    pub rms: Vec<f64>,
    /// The same over the RMS of the drive's force; `None` where the drive does not act.
    pub relative: Vec<Option<f64>>,
    /// All joints together.
    pub overall: Option<f64>,
}

/// One base parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// In words.
    pub formula: String,
    /// Whether it is one parameter by itself.
    pub single: bool,
    /// Unit of the parameter that stands for it.
    pub unit: String,
    /// Value.
    pub value: f64,
    /// Standard deviation by the jackknife.
    pub deviation: f64,
    /// Standard deviation under white residuals of the fitted size.
    pub white: f64,
    /// Bootstrap interval of 95 %.
    pub interval: Option<(f64, f64)>,
    /// Spread over the records, each fitted by itself: `√(Σ ((β_r − β̄)/σ_r)²/(R − 1))`, β̄ the weighted mean; about 1 where
    /// they agree within their own deviations. `None` with fewer than two records that determine it.
    pub agreement: Option<f64>,
}

impl Row {
    /// Whether the data pin the value: its deviation is less than half of it.
    pub fn pinned(&self) -> bool {
        self.deviation < 0.5 * self.value.abs()
    }
}

/// A finished regression.
#[derive(Debug, Clone, PartialEq)]
pub struct Regression {
    /// Base parameters.
    pub rows: Vec<Row>,
    /// Linear parameters.
    pub linear: usize,
    /// All parameters of the model: those with the estimated β nearest to the start.
    pub parameters: Vec<f64>,
    /// Parameters that do not enter any combination.
    pub absent: Vec<String>,
    /// Parameters held though free in the model, with their values: gains, and shapes where found.
    pub held: Vec<(String, f64)>,
    /// Residuals of training records and of each test record.
    pub errors: Vec<Errors>,
    /// Residuals of left-out training records: mean overall share.
    pub folds: Option<f64>,
    /// Where test records leave the range of the training records.
    pub excess: Vec<Excess>,
    /// Range of the training records.
    pub ranges: Vec<range::Range>,
    /// How the filter was chosen, if it was.
    pub filter_choice: Option<Choice>,
    /// Physically consistent values and their residuals.
    pub consistent: Option<(Consistent, Vec<f64>, Vec<Errors>)>,
    /// Share of random poses with an indefinite mass matrix: unconstrained, consistent.
    pub indefinite: (f64, Option<f64>),
    /// Kept samples and blocks.
    pub samples: (usize, usize),
    /// What the filters did, per record.
    pub remarks: Vec<String>,
    /// Seconds.
    pub seconds: f64,
    /// What the rounds of instrumental variables did, and how far they moved each combination from least squares.
    pub instruments: Option<(Rounds, Vec<f64>)>,
    /// The solution.
    pub solution: Solution,
}

/// Runs a regression on the training records and judges it on the test records.
///
/// `start`: all parameters; those that are not linear are held there, open directions settle near it.
///
/// # Errors
/// [`RegressError`].
pub fn regress(
    model: &dyn Hessian,
    dataset: &Dataset,
    start: &[f64],
    options: &Options,
) -> Result<Regression, RegressError> {
    let started = Instant::now();
    let hold = positions(model, &options.hold)?;
    let mut split = LinearModel::new(model, start, &hold);
    if split.linear().is_empty() {
        return Err(RegressionError::NothingLinear {
            model: model.name().to_owned(),
        }
        .into());
    }
    let rest: Vec<f64> = model
        .joints()
        .iter()
        .map(|j| {
            options.rest
                * if j.prismatic {
                    REST_TRANSLATION
                } else {
                    REST_ROTATION
                }
        })
        .collect();
    let choice = match options.choose_filter {
        true => Some(filter_choice::choose(
            &split,
            dataset,
            &rest,
            options.filtering.decimate,
        )?),
        false => None,
    };
    let filtering = choice.as_ref().map_or(options.filtering, |c| c.filtering);
    let train = Record::of(dataset, filtering, |e| e.role == Role::Train)?;
    let test = Record::of(dataset, filtering, |e| e.role == Role::Test)?;
    if options.shapes {
        tune(&mut split, &train, &rest, &hold)?;
    }
    let normal = Normal::new(&split, &train, Some(&rest));
    let judged = Normal::new(&split, &test, None);
    let mut solution = solution::solve(&normal)?;
    let infos: Vec<&ParamInfo> = split.linear().iter().map(|&j| &model.params()[j]).collect();
    let names: Vec<&str> = infos.iter().map(|i| i.name.as_ref()).collect();
    let scale = scales(&infos);
    let near = DVector::from_iterator(
        split.linear().len(),
        split.linear().iter().map(|&j| start[j]),
    );
    let instruments = match &options.instruments {
        Some(controllers) => {
            let before = solution.beta.clone();
            let base = solution.base.clone();
            let full =
                |beta: &DVector<f64>| split.complete(base.nearest(beta, &near, &scale).as_slice());
            let rounds = instruments::refine(
                &split,
                dataset,
                &train,
                &rest,
                controllers,
                &full,
                &mut solution,
            )?;
            Some((rounds, (&solution.beta - before).as_slice().to_vec()))
        }
        None => None,
    };
    let p = as_columns(&solution.base, &solution.beta, normal.columns());
    let full = solution.base.nearest(&solution.beta, &near, &scale);
    let parameters = split.complete(full.as_slice());

    let bootstrap = match options.bootstrap {
        // The draws are of the normal equations, which instruments leave.
        _ if instruments.is_some() => None,
        0 => None,
        draws => solution::bootstrap(&normal, &solution, draws, options.seed),
    };
    let agreement = agreement(&normal, &solution);
    let deviations = solution.deviations();
    let rows = (0..solution.base.rank())
        .map(|i| Row {
            formula: solution.base.formula(i, &names),
            single: solution.base.single(i),
            unit: infos[solution.base.independent[i]].unit.to_string(),
            value: solution.beta[i],
            deviation: deviations[i],
            white: solution.white[(i, i)].max(0.0).sqrt(),
            interval: bootstrap.as_ref().map(|b| b[i]),
            agreement: agreement[i],
        })
        .collect();

    let consistent = (options.consistent && instruments.is_none()).then(|| {
        let (a, b) = weighted(&normal.total(|_| true), &solution.weights);
        let c: f64 = normal
            .total(|_| true)
            .iter()
            .zip(&solution.weights)
            .map(|(s, w)| w * s.c)
            .sum();
        let least = p.dot(&(&a * &p)) - 2.0 * p.dot(&b) + c;
        let found = consistent::fit(&a, &b, c, &infos, &near, &scale, least);
        let errors = errors(&normal, &judged, &found.p);
        (split.complete(found.p.as_slice()), found, errors)
    });
    let share = |p: &[f64]| indefinite_share(model, p, options.poses, options.seed);
    let indefinite = (
        share(&parameters),
        consistent.as_ref().map(|(p, ..)| share(p)),
    );
    let ranges = range::of(model, &train);
    Ok(Regression {
        rows,
        linear: normal.columns(),
        parameters,
        absent: solution
            .base
            .dependent
            .iter()
            .enumerate()
            .filter(|(c, _)| solution.base.k.column(*c).iter().all(|&k| k == 0.0))
            .map(|(_, &d)| names[d].to_owned())
            .collect(),
        held: split
            .held()
            .iter()
            .map(|&j| (model.params()[j].name.to_string(), split.held_value(j)))
            .collect(),
        errors: errors(&normal, &judged, &p),
        folds: folds(&normal),
        excess: range::excess(&ranges, &test),
        filter_choice: choice,
        ranges,
        consistent: consistent.map(|(p, found, errors)| (found, p, errors)),
        indefinite,
        samples: (normal.samples(), normal.blocks.len()),
        remarks: train.iter().chain(&test).map(Record::in_words).collect(),
        seconds: started.elapsed().as_secs_f64(),
        instruments,
        solution,
    })
}

fn positions(model: &dyn Hessian, names: &[String]) -> Result<Vec<usize>, RegressError> {
    names
        .iter()
        .map(|name| {
            model
                .params()
                .iter()
                .position(|i| i.name == *name)
                .ok_or_else(|| RegressError::UnknownParameter { name: name.clone() })
        })
        .collect()
}

/// Typical sizes: for a link by its mass and a tenth of a metre, otherwise the nominal value, 1 where that is zero.
fn scales(infos: &[&ParamInfo]) -> Vec<f64> {
    let names: Vec<&str> = infos.iter().map(|i| i.name.as_ref()).collect();
    let mut scale: Vec<f64> = infos
        .iter()
        .map(|i| {
            if i.nominal == 0.0 {
                1.0
            } else {
                i.nominal.abs()
            }
        })
        .collect();
    for (_, columns) in consistent::links(&names) {
        let m = infos[columns[0]].nominal.abs().max(0.1);
        for (k, &c) in columns.iter().enumerate() {
            scale[c] = match k {
                0 => m,
                1..4 => 0.1 * m,
                _ => 0.01 * m,
            };
        }
    }
    scale
}

/// Shape parameters by coordinate search over a logarithmic grid of their ranges: the sum of logarithms of the joints'
/// residual variances at the best linear parameters (the likelihood with the joints' variances eliminated) decides.
fn tune(
    split: &mut LinearModel<'_>,
    records: &[Record],
    rest: &[f64],
    hold: &[usize],
) -> Result<(), RegressError> {
    let params = split.model().params();
    let shapes: Vec<usize> = split
        .held()
        .iter()
        .copied()
        .filter(|j| {
            let i = &params[*j];
            !hold.contains(j) && i.doc.starts_with("term ") && i.lower > 0.0 && i.upper.is_finite()
        })
        .collect();
    if shapes.is_empty() {
        return Ok(());
    }
    for _ in 0..SHAPE_PASSES {
        for &shape in &shapes {
            let info = &params[shape];
            let ratio = (info.upper / info.lower).ln() / (SHAPES - 1) as f64;
            let mut best = (f64::INFINITY, split.held_value(shape));
            for k in 0..SHAPES {
                split.set(shape, info.lower * (ratio * k as f64).exp());
                let normal = Normal::new(split, records, Some(rest));
                let solution = solution::solve(&normal)?;
                let p = as_columns(&solution.base, &solution.beta, normal.columns());
                let cost: f64 = normal
                    .total(|_| true)
                    .iter()
                    .map(|s| s.count as f64 * s.residual(&p).max(f64::MIN_POSITIVE).ln())
                    .sum();
                if cost < best.0 {
                    best = (cost, split.held_value(shape));
                }
            }
            split.set(shape, best.1);
        }
        // One shape alone has nothing to be revisited for.
        if shapes.len() == 1 {
            break;
        }
    }
    Ok(())
}

/// Residuals of the fitted rows of all training records together, then of each test record and of all of them.
fn errors(train: &Normal, test: &Normal, p: &DVector<f64>) -> Vec<Errors> {
    let row = |normal: &Normal, records: &str, record: Option<usize>| {
        let choice = |b: &crate::normal::Block| record.is_none_or(|r| b.record == r);
        let (rms, relative) = solution::residuals(normal, p, choice).into_iter().unzip();
        Errors {
            records: records.to_owned(),
            rms,
            relative,
            overall: solution::overall(normal, p, choice),
        }
    };
    let mut all = vec![row(train, "train (all)", None)];
    if !test.blocks.is_empty() {
        all.extend(
            test.records
                .iter()
                .enumerate()
                .map(|(i, name)| row(test, name, Some(i))),
        );
        all.push(row(test, "test (all)", None));
    }
    all
}

/// Mean share of the drives' force left on training records (or quarters of a single one) that were not fitted.
fn folds(normal: &Normal) -> Option<f64> {
    let folds: Vec<Vec<usize>> = match normal.records.len() {
        0 => return None,
        1 => {
            let n = normal.blocks.len();
            (0..FOLDS)
                .map(|f| (f * n / FOLDS..(f + 1) * n / FOLDS).collect())
                .collect()
        }
        n => (0..n)
            .map(|r| {
                (0..normal.blocks.len())
                    .filter(|&b| normal.blocks[b].record == r)
                    .collect()
            })
            .collect(),
    };
    let shares: Vec<f64> = folds
        .par_iter()
        .filter(|f| !f.is_empty() && f.len() < normal.blocks.len())
        .filter_map(|left_out| {
            let rest: Vec<usize> = (0..normal.blocks.len())
                .filter(|b| !left_out.contains(b))
                .collect();
            let solution = solution::solve(&normal.resampled(&rest)).ok()?;
            let p = as_columns(&solution.base, &solution.beta, normal.columns());
            solution::overall(&normal.resampled(left_out), &p, |_| true)
        })
        .collect();
    (!shares.is_empty()).then(|| shares.iter().sum::<f64>() / shares.len() as f64)
}

/// Spread of each β over records fitted by themselves, in their own deviations.
fn agreement(normal: &Normal, solution: &Solution) -> Vec<Option<f64>> {
    let each: Vec<_> = solution::per_record(normal, solution)
        .into_iter()
        .flatten()
        .collect();
    (0..solution.beta.len())
        .map(|i| {
            let values: Vec<(f64, f64)> = each
                .iter()
                .map(|a| (a.beta[i], a.deviations[i]))
                .filter(|(b, d)| b.is_finite() && *d > 0.0)
                .collect();
            if values.len() < 2 {
                return None;
            }
            let weight: f64 = values.iter().map(|(_, d)| 1.0 / (d * d)).sum();
            let mean = values.iter().map(|(b, d)| b / (d * d)).sum::<f64>() / weight;
            let square: f64 = values.iter().map(|(b, d)| ((b - mean) / d).powi(2)).sum();
            Some((square / (values.len() - 1) as f64).sqrt())
        })
        .collect()
}
