//! Estimation by inverse dynamics: records in, base parameters with deviations, checks on records
//! never fitted, and what they cover out.
//!
//! ```text
//! records -> zero-phase filters -> linear regression, parallel decimation -> normal equations per block of time
//! normal equations -> weighted least squares, base parameters, deviations, folds, bootstrap, consistent values
//! ```
//!
//! After the filters, everything works on the normal equations, a few small matrices per block, and
//! never passes over the records again.

pub mod base;
pub mod columns;
pub mod filter_choice;
pub mod instruments;
pub mod judge;
pub mod normal;
pub mod range;
pub mod record;
pub mod robust;
pub mod shapes;
pub mod solution;
pub mod unknowns;

use std::time::Instant;

use crate::transcribe::Loss;
use nalgebra::DVector;
use pid_data::signal::SignalError;
use pid_data::{Dataset, Role};
use pid_runtime::dynamics::{Hessian, ParamInfo};
use rayon::prelude::*;

use crate::inertia::consistent::{self, Consistent};
use crate::inertia::poses::indefinite_share;
use crate::regress::columns::LinearModel;
use crate::regress::filter_choice::Choice;
use crate::regress::instruments::{InstrumentError, Rounds};
use crate::regress::judge::Errors;
use crate::regress::normal::Normal;
use crate::regress::range::Excess;
use crate::regress::record::{Filtering, Record};
use crate::regress::solution::{
    Belief, How, JointWeights, RegressionError, Solution, as_columns, weighted,
};
use crate::regress::unknowns::{Payload, Unknowns, UnknownsError};
use crate::wrap::controllers::Controllers;
use pid_runtime::memory::Memory;
use pid_runtime::term::{REST_ROTATION, REST_TRANSLATION};

/// Transition velocities below which a joint rests.
const REST: f64 = 2.0;

/// What can be chosen.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Filters.
    pub filtering: Filtering,
    /// Whether the cut-off is chosen by left-out training records; that of `filtering` then does not count.
    pub choose_filter: bool,
    /// Names of parameters held at their start.
    pub hold: Vec<String>,
    /// Linear parameters of which every training record has its own value; `*` stands for any
    /// characters. Other records take the mean.
    pub private: Vec<String>,
    /// A body fixed to a link in some records.
    pub payload: Option<Payload>,
    /// Standard deviation of the gain of each joint's drive, as a share of it; empty where they are
    /// known. It enters the deviations of the combinations, not the intervals of the bootstrap.
    pub gains: Vec<f64>,
    /// How the joints are weighed.
    pub weights: JointWeights,
    /// Loss of residuals in units of their own deviation (1.4826 of their median).
    pub loss: Loss,
    /// Prior knowledge: parameter of the model (or `payload_m` …), mean, standard deviation.
    pub priors: Vec<(String, f64, f64)>,
    /// A joint rests below this multiple of the transition velocity v₀; its rows are then left out
    /// of the fit, but not of the judgement. 0 keeps all rows. `None` is 2, or 0 with friction that
    /// has a memory: rows at rest tell it from Coulomb friction.
    pub rest: Option<f64>,
    /// States of friction with a memory, which the model takes as its last inputs
    /// ([`pid_runtime::extend::Extended::memories`]).
    pub memories: Vec<Memory>,
    /// The controllers of the records, for instrumental variables in place of least squares.
    pub instruments: Option<Controllers>,
    /// Further values of all parameters to judge in the same way, with their names.
    pub judge: Vec<(String, Vec<f64>)>,
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
            private: Vec::new(),
            payload: None,
            gains: Vec::new(),
            weights: JointWeights::Variance,
            loss: Loss::Square,
            priors: Vec::new(),
            rest: None,
            memories: Vec::new(),
            instruments: None,
            judge: Vec::new(),
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
        "the model has no parameter `{name}` to hold\n  help: `simtrue models` lists the models, the report their parameters"
    )]
    UnknownParameter {
        /// Its name.
        name: String,
    },
    /// Prior knowledge of a parameter that the regression does not estimate.
    #[error("a prior of `{name}`, which the regression does not estimate: {reason}")]
    Prior {
        /// Its name.
        name: String,
        /// Why.
        reason: &'static str,
    },
    /// Deviations of gains that are not one per joint.
    #[error(
        "{found} deviations of gains for {joints} joints\n  help: one per joint, a share of its gain (0.1: known to 10 %), 0 where it is known"
    )]
    Gains {
        /// How many were given.
        found: usize,
        /// Joints.
        joints: usize,
    },
    /// A deviation that is none.
    #[error(
        "the gain of joint {joint} has the deviation {value}\n  help: a share of the gain, 0 or above (0.1: known to 10 %)"
    )]
    Gain {
        /// Joint from 1.
        joint: usize,
        /// What was given.
        value: f64,
    },
    /// Unknowns that do not fit.
    #[error(transparent)]
    Unknowns(#[from] UnknownsError),
    /// Instruments with what they have no form for.
    #[error(
        "instrumental variables take neither {what}\n  help: leave it out, or use least squares"
    )]
    InstrumentsAlone {
        /// What was asked for besides.
        what: &'static str,
    },
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
    /// Spread over the records, each fitted by itself: `√(Σ ((β_r − β̄)/σ_r)²/(R − 1))`, β̄ the
    /// weighted mean; about 1 where they agree within their own deviations. `None` with fewer than
    /// two records that determine it.
    pub agreement: Option<f64>,
}

impl Row {
    /// Whether the data determine the value: its deviation is less than half of it.
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
    /// The same of values given to be judged.
    pub given: Vec<(String, Vec<Errors>)>,
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
    /// The payload, if one was asked for: its ten parameters and the mass's standard deviation.
    pub payload: Option<PayloadFound>,
    /// Outcome of the rounds of instrumental variables, and how far they moved each combination
    /// from least squares.
    pub instruments: Option<(Rounds, Vec<f64>)>,
    /// The solution.
    pub solution: Solution,
}

/// A payload as it was found.
#[derive(Debug, Clone, PartialEq)]
pub struct PayloadFound {
    /// Link it is fixed to.
    pub link: String,
    /// Mass, first moment and inertia about the origin of the link's frame (the order of
    /// [`crate::inertia::pseudo_inertia::SUFFIXES`]), with standard deviations where they are
    /// determined one by one.
    pub values: Vec<(f64, Option<f64>)>,
    /// The same of the physically consistent fit.
    pub consistent: Option<Vec<f64>>,
}

/// Runs a regression on the training records and judges it on the test records.
///
/// `start`: all parameters; those that are not linear are held there, and open directions settle
/// near it.
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
    let mut split = LinearModel::with_memories(model, start, &hold, &options.memories);
    if split.linear().is_empty() {
        return Err(RegressionError::NothingLinear {
            model: model.name().to_owned(),
        }
        .into());
    }
    let transitions = options.rest.unwrap_or(match options.memories.is_empty() {
        true => REST,
        false => 0.0,
    });
    let rest: Vec<f64> = model
        .joints()
        .iter()
        .map(|j| {
            transitions
                * if j.prismatic {
                    REST_TRANSLATION
                } else {
                    REST_ROTATION
                }
        })
        .collect();
    let records: Vec<String> = dataset
        .with_role(Role::Train)
        .map(|e| e.name.clone())
        .collect();
    let unknowns = Unknowns::new(
        &split,
        start,
        &options.private,
        options.payload.as_ref(),
        &records,
    )?;
    let how = How {
        weights: options.weights,
        beliefs: beliefs(&unknowns, &options.priors)?,
        gains: gains(&options.gains, model.dims().nq)?,
    };
    if options.instruments.is_some() {
        for (asked, what) in [
            (!unknowns.plain(), "private parameters nor a payload"),
            (!options.loss.is_square(), "another loss than squares"),
            (!how.beliefs.is_empty(), "priors"),
            (!how.gains.is_empty(), "deviations of gains"),
            (!options.memories.is_empty(), "friction with a memory"),
        ] {
            if asked {
                return Err(RegressError::InstrumentsAlone { what });
            }
        }
    }
    let choice = match options.choose_filter {
        true => Some(filter_choice::choose(
            &split,
            &unknowns,
            dataset,
            &rest,
            options.filtering.decimate,
            &how,
        )?),
        false => None,
    };
    let filtering = choice.as_ref().map_or(options.filtering, |c| c.filtering);
    let train = Record::of(dataset, filtering, split.memories(), |e| {
        e.role == Role::Train
    })?;
    let test = Record::of(dataset, filtering, split.memories(), |e| {
        e.role == Role::Test
    })?;
    if options.shapes {
        shapes::tune(&mut split, &train, &rest, &hold, &how)?;
    }
    let weights = robust::weights(&split, &unknowns, &train, &rest, &how, options.loss)?;
    let place = |normal: Normal, records: &[Record], fitted: bool| match unknowns.plain() {
        true => normal,
        false => normal.placed(
            unknowns.infos().len(),
            records
                .iter()
                .enumerate()
                .map(|(r, record)| unknowns.place(&record.name, fitted.then_some(r)))
                .collect(),
        ),
    };
    let normal = place(
        Normal::weighted(&split, &train, Some(&rest), &weights),
        &train,
        true,
    );
    let judged = place(Normal::new(&split, &test, None), &test, false);
    // Residuals are counted without the weights of samples.
    let counted = match weights.is_empty() {
        true => normal.clone(),
        false => place(Normal::new(&split, &train, Some(&rest)), &train, true),
    };
    let mut solution = solution::solve(&normal, &how)?;
    let infos: Vec<&ParamInfo> = unknowns.infos().iter().collect();
    let names: Vec<&str> = infos.iter().map(|i| i.name.as_ref()).collect();
    let scale = scales(&infos);
    let near = unknowns.near().clone();
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
    let parameters = split.complete(&unknowns.robot(&full));

    let bootstrap = match options.bootstrap {
        // The draws are of the normal equations, which instruments do not use.
        _ if instruments.is_some() => None,
        0 => None,
        draws => solution::bootstrap(&normal, &solution, &how, draws, options.seed),
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
        let (mut a, mut b) = weighted(&normal.total(|_| true), &solution.weights);
        let c: f64 = normal
            .total(|_| true)
            .iter()
            .zip(&solution.weights)
            .map(|(s, w)| w * s.c)
            .sum();
        how.believe(&mut a, &mut b);
        let least = p.dot(&(&a * &p)) - 2.0 * p.dot(&b) + c;
        let found = consistent::fit(&a, &b, c, &infos, &near, &scale, least);
        let errors = judge::fitted(&counted, &judged, &found.p);
        (split.complete(&unknowns.robot(&found.p)), found, errors)
    });
    let share = |p: &[f64]| indefinite_share(model, p, options.poses, options.seed);
    let indefinite = (
        share(&parameters),
        consistent.as_ref().map(|(p, ..)| share(p)),
    );
    let payload = unknowns.payload().map(|body| PayloadFound {
        link: options
            .payload
            .as_ref()
            .map_or_else(String::new, |p| p.link.clone()),
        values: body
            .iter()
            .map(|&k| {
                let row = solution.base.independent.iter().position(|&i| i == k);
                let single = row.filter(|&i| solution.base.single(i));
                (full[k], single.map(|i| deviations[i]))
            })
            .collect(),
        consistent: consistent
            .as_ref()
            .map(|(_, found, _)| body.iter().map(|&k| found.p[k]).collect()),
    });
    let given = options
        .judge
        .iter()
        .map(|(name, p)| (name.clone(), judge::given(model, p, &train, &test, &rest)))
        .collect();
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
        errors: judge::fitted(&counted, &judged, &p),
        given,
        folds: folds(&normal, &counted, &unknowns, &how),
        payload,
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

/// Deviations of gains, checked.
fn gains(deviations: &[f64], joints: usize) -> Result<Vec<f64>, RegressError> {
    let found = deviations.len();
    if found != 0 && found != joints {
        return Err(RegressError::Gains { found, joints });
    }
    match deviations
        .iter()
        .position(|d| !(d.is_finite() && *d >= 0.0))
    {
        Some(j) => Err(RegressError::Gain {
            joint: j + 1,
            value: deviations[j],
        }),
        None => Ok(deviations.to_vec()),
    }
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

/// Typical sizes: for a link by its mass and a tenth of a metre, otherwise the nominal value, 1
/// where that is zero.
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

/// Beliefs about unknowns from priors of parameters.
fn beliefs(
    unknowns: &Unknowns,
    priors: &[(String, f64, f64)],
) -> Result<Vec<Belief>, RegressError> {
    let mut beliefs = Vec::new();
    for (name, mean, deviation) in priors {
        let fault = |reason| RegressError::Prior {
            name: name.clone(),
            reason,
        };
        if !(deviation.is_finite() && *deviation > 0.0 && mean.is_finite()) {
            return Err(fault("its deviation must be above zero"));
        }
        let columns = unknowns.of_parameter(name);
        if columns.is_empty() {
            return Err(fault(
                "it does not exist, is held, or the residual is not linear in it",
            ));
        }
        beliefs.extend(columns.into_iter().map(|column| Belief {
            column,
            mean: *mean,
            deviation: *deviation,
        }));
    }
    Ok(beliefs)
}

/// Mean share of the drives' force left on training records (or quarters of a single one) that were
/// not fitted.
fn folds(normal: &Normal, counted: &Normal, unknowns: &Unknowns, how: &How) -> Option<f64> {
    let shares: Vec<f64> = filter_choice::folds(normal)
        .into_par_iter()
        .enumerate()
        .filter(|(_, f)| !f.is_empty() && f.len() < normal.blocks.len())
        .filter_map(|(record, left_out)| {
            let rest: Vec<usize> = (0..normal.blocks.len())
                .filter(|b| !left_out.contains(b))
                .collect();
            let total = normal.resampled(&rest).total(|_| true);
            let p = solution::estimate(&total, how).ok()?.columns();
            let p = unknowns.left_out(p, record);
            solution::overall(&counted.resampled(&left_out), &p, |_| true)
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
