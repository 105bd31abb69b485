//! A regression from records to checked values.

use std::time::Instant;

use nalgebra::DVector;
use pid_data::{Dataset, Role};
use pid_runtime::dynamics::{Hessian, ParamInfo};
use pid_runtime::term::{REST_ROTATION, REST_TRANSLATION};
use rayon::prelude::*;

use super::error::RegressError;
use super::options::Options;
use super::outcome::{PayloadFound, Regression, Row};
use crate::inertia::consistent::{self, Consistent};
use crate::inertia::poses::indefinite_share;
use crate::regress::columns::LinearModel;
use crate::regress::filter_choice::Choice;
use crate::regress::instruments::Rounds;
use crate::regress::judge::Errors;
use crate::regress::normal::Normal;
use crate::regress::record::Record;
use crate::regress::solution::{
    self, Belief, How, RegressionError, Solution, as_columns, weighted,
};
use crate::regress::unknowns::Unknowns;
use crate::regress::{filter_choice, instruments, judge, range, robust, shapes};

/// Transition velocities below which a joint rests.
const REST: f64 = 2.0;

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
    let mut task = Task::new(model, dataset, start, options)?;
    let choice = task.choice()?;
    let filtering = choice.as_ref().map_or(options.filtering, |c| c.filtering);
    let of = |role: Role| {
        Record::of(dataset, filtering, task.split.memories(), |e| {
            e.role == role
        })
    };
    let (train, test) = (of(Role::Train)?, of(Role::Test)?);
    if options.shapes {
        shapes::tune(&mut task.split, &train, &task.rest, &task.hold, &task.how)?;
    }
    let equations = task.equations(&train, &test)?;
    let normal = &equations.normal;
    let mut solution = solution::solve(normal, &task.how)?;
    let instruments = task.instrumental(&train, &mut solution)?;
    let infos: Vec<&ParamInfo> = task.unknowns.infos().iter().collect();
    let scale = scales(&infos);
    let p = as_columns(&solution.base, &solution.beta, normal.columns());
    let full = solution
        .base
        .nearest(&solution.beta, task.unknowns.near(), &scale);
    let parameters = task.split.complete(&task.unknowns.robot(&full));
    let bootstrap = match options.bootstrap {
        // The draws are of the normal equations, which instruments do not use.
        _ if instruments.is_some() => None,
        0 => None,
        draws => solution::bootstrap(normal, &solution, &task.how, draws, options.seed),
    };
    let rows = rows(normal, &solution, &infos, bootstrap.as_deref());
    let consistent = (options.consistent && instruments.is_none())
        .then(|| task.consistent(&equations, &solution, &p, &scale));
    let share = |p: &[f64]| indefinite_share(model, p, options.poses, options.seed);
    let indefinite = (
        share(&parameters),
        consistent.as_ref().map(|(_, p, _)| share(p)),
    );
    let payload = task.payload(
        &solution,
        &full,
        consistent.as_ref().map(|(found, ..)| found),
    );
    let judged = |(name, p): &(String, Vec<f64>)| {
        let errors = judge::given(model, p, &train, &test, &task.rest);
        (name.clone(), errors)
    };
    let ranges = range::of(model, &train);
    Ok(Regression {
        rows,
        linear: normal.columns(),
        parameters,
        absent: absent(&solution, &infos),
        held: task.held(),
        errors: judge::fitted(&equations.counted, &equations.judged, &p),
        given: options.judge.iter().map(judged).collect(),
        folds: folds(normal, &equations.counted, &task.unknowns, &task.how),
        payload,
        excess: range::excess(&ranges, &test),
        filter_choice: choice,
        ranges,
        consistent,
        indefinite,
        samples: (normal.samples(), normal.blocks.len()),
        remarks: train.iter().chain(&test).map(Record::in_words).collect(),
        seconds: started.elapsed().as_secs_f64(),
        instruments,
        solution,
    })
}

/// What is estimated, and how.
struct Task<'a> {
    dataset: &'a Dataset,
    options: &'a Options,
    split: LinearModel<'a>,
    unknowns: Unknowns,
    how: How,
    /// Positions of held parameters.
    hold: Vec<usize>,
    /// Velocity below which each joint rests, rad/s or m/s.
    rest: Vec<f64>,
}

/// Normal equations of the records.
struct Equations {
    /// Of the training records, samples weighed as the loss says.
    normal: Normal,
    /// Of the test records.
    judged: Normal,
    /// Of the training records without the weights of samples: residuals are counted by them.
    counted: Normal,
}

impl<'a> Task<'a> {
    /// Parameters that are not linear, and the values at which they are held.
    fn held(&self) -> Vec<(String, f64)> {
        let name = |j: usize| self.split.model().params()[j].name.to_string();
        let held = self.split.held().iter();
        held.map(|&j| (name(j), self.split.held_value(j))).collect()
    }

    fn new(
        model: &'a dyn Hessian,
        dataset: &'a Dataset,
        start: &[f64],
        options: &'a Options,
    ) -> Result<Self, RegressError> {
        let hold = positions(model, &options.hold)?;
        let split = LinearModel::with_memories(model, start, &hold, &options.memories);
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
        let rest = model.joints().iter().map(|j| match j.prismatic {
            true => transitions * REST_TRANSLATION,
            false => transitions * REST_ROTATION,
        });
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
        let task = Self {
            dataset,
            options,
            split,
            unknowns,
            how,
            hold,
            rest: rest.collect(),
        };
        task.check_instruments()?;
        Ok(task)
    }

    /// Instruments have no form for some of what can be asked for.
    fn check_instruments(&self) -> Result<(), RegressError> {
        let (options, how) = (self.options, &self.how);
        if options.instruments.is_none() {
            return Ok(());
        }
        for (asked, what) in [
            (!self.unknowns.plain(), "private parameters nor a payload"),
            (!options.loss.is_square(), "another loss than squares"),
            (!how.beliefs.is_empty(), "priors"),
            (!how.gains.is_empty(), "deviations of gains"),
            (!options.memories.is_empty(), "friction with a memory"),
        ] {
            if asked {
                return Err(RegressError::InstrumentsAlone { what });
            }
        }
        Ok(())
    }

    /// The cut-off by left-out training records, if that is asked for.
    fn choice(&self) -> Result<Option<Choice>, RegressError> {
        if !self.options.choose_filter {
            return Ok(None);
        }
        Ok(Some(filter_choice::choose(
            &self.split,
            &self.unknowns,
            self.dataset,
            &self.rest,
            self.options.filtering.decimate,
            &self.how,
        )?))
    }

    fn equations(&self, train: &[Record], test: &[Record]) -> Result<Equations, RegressError> {
        let (split, rest) = (&self.split, self.rest.as_slice());
        let weights = robust::weights(
            split,
            &self.unknowns,
            train,
            rest,
            &self.how,
            self.options.loss,
        )?;
        let fitted = Normal::weighted(split, train, Some(rest), &weights);
        let normal = self.placed(fitted, train, true);
        let counted = match weights.is_empty() {
            true => normal.clone(),
            false => self.placed(Normal::new(split, train, Some(rest)), train, true),
        };
        Ok(Equations {
            normal,
            judged: self.placed(Normal::new(split, test, None), test, false),
            counted,
        })
    }

    /// Normal equations in the unknowns of the regression.
    fn placed(&self, normal: Normal, records: &[Record], fitted: bool) -> Normal {
        if self.unknowns.plain() {
            return normal;
        }
        let records = records.iter().enumerate();
        let place =
            |(r, record): (usize, &Record)| self.unknowns.place(&record.name, fitted.then_some(r));
        normal.placed(self.unknowns.infos().len(), records.map(place).collect())
    }

    /// Rounds of instrumental variables, and how far they moved each combination.
    fn instrumental(
        &self,
        train: &[Record],
        solution: &mut Solution,
    ) -> Result<Option<(Rounds, Vec<f64>)>, RegressError> {
        let Some(controllers) = &self.options.instruments else {
            return Ok(None);
        };
        let infos: Vec<&ParamInfo> = self.unknowns.infos().iter().collect();
        let scale = scales(&infos);
        let before = solution.beta.clone();
        let base = solution.base.clone();
        let full = |beta: &DVector<f64>| {
            let p = base.nearest(beta, self.unknowns.near(), &scale);
            self.split.complete(p.as_slice())
        };
        let rounds = instruments::refine(
            &self.split,
            self.dataset,
            train,
            &self.rest,
            controllers,
            &full,
            solution,
        )?;
        let moved = (&solution.beta - before).as_slice().to_vec();
        Ok(Some((rounds, moved)))
    }

    /// Physically consistent values, all parameters with them, and their residuals.
    fn consistent(
        &self,
        equations: &Equations,
        solution: &Solution,
        p: &DVector<f64>,
        scale: &[f64],
    ) -> (Consistent, Vec<f64>, Vec<Errors>) {
        let infos: Vec<&ParamInfo> = self.unknowns.infos().iter().collect();
        let total = equations.normal.total(|_| true);
        let (mut a, mut b) = weighted(&total, &solution.weights);
        let c: f64 = total
            .iter()
            .zip(&solution.weights)
            .map(|(s, w)| w * s.c)
            .sum();
        self.how.believe(&mut a, &mut b);
        let least = p.dot(&(&a * p)) - 2.0 * p.dot(&b) + c;
        let near = self.unknowns.near();
        let found = consistent::fit(&a, &b, c, &infos, near, scale, least);
        let errors = judge::fitted(&equations.counted, &equations.judged, &found.p);
        let all = self.split.complete(&self.unknowns.robot(&found.p));
        (found, all, errors)
    }

    /// The payload, if one was asked for.
    fn payload(
        &self,
        solution: &Solution,
        full: &DVector<f64>,
        consistent: Option<&Consistent>,
    ) -> Option<PayloadFound> {
        let body = self.unknowns.payload()?;
        let deviations = solution.deviations();
        let asked = self.options.payload.as_ref();
        Some(PayloadFound {
            link: asked.map_or_else(String::new, |p| p.link.clone()),
            values: body
                .iter()
                .map(|&k| {
                    let row = solution.base.independent.iter().position(|&i| i == k);
                    let single = row.filter(|&i| solution.base.single(i));
                    (full[k], single.map(|i| deviations[i]))
                })
                .collect(),
            consistent: consistent.map(|found| body.iter().map(|&k| found.p[k]).collect()),
        })
    }
}

/// The base parameters.
fn rows(
    normal: &Normal,
    solution: &Solution,
    infos: &[&ParamInfo],
    bootstrap: Option<&[(f64, f64)]>,
) -> Vec<Row> {
    let names: Vec<&str> = infos.iter().map(|i| i.name.as_ref()).collect();
    let agreement = agreement(normal, solution);
    let deviations = solution.deviations();
    (0..solution.base.rank())
        .map(|i| Row {
            formula: solution.base.formula(i, &names),
            single: solution.base.single(i),
            unit: infos[solution.base.independent[i]].unit.to_string(),
            value: solution.beta[i],
            deviation: deviations[i],
            white: solution.white[(i, i)].max(0.0).sqrt(),
            interval: bootstrap.map(|b| b[i]),
            agreement: agreement[i],
        })
        .collect()
}

/// Parameters that enter no combination.
fn absent(solution: &Solution, infos: &[&ParamInfo]) -> Vec<String> {
    let base = &solution.base;
    let dependent = base.dependent.iter().enumerate();
    dependent
        .filter(|(c, _)| base.k.column(*c).iter().all(|&k| k == 0.0))
        .map(|(_, &d)| infos[d].name.to_string())
        .collect()
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
