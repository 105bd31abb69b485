//! Equation error: least squares on the residual with states estimated from the records.
//!
//! ```text
//! minimise  1/N Σ_k Σ_j ω_j (F r_j)(k)²,   r = r(q̂, v̂, â, û, p)      p in its bounds
//! ```
//!
//! States and inputs pass the same zero-phase filter; the residual, and with it every column of its
//! regressor, passes the decimation filter F and is then decimated (parallel decimation of the
//! IDIM-LS procedure: M. Gautier, IEEE ICRA 1997). The weights ω are one over the variance of each
//! joint's residual, settled in a few passes (weighted least squares).

use super::error::IdentError;
use super::outcome::{Callback, ForceError, Identification, Progress, Run, best_of};
use super::parameters::{bounds, scales};
use super::settings::Settings;
use super::uncertainty::{self, Solved, Spread};
use crate::transcribe::Loss;
use faer::Mat;
use pid_data::signal::{acting_inputs, low_pass_channels, state_from_data};
use pid_data::{Dataset, Experiment, Role};
use pid_nlp::solver::ip;
use pid_nlp::solver::kkt::sparse::SparseKkt;
use pid_nlp::{Nlp, SparsePattern, check_point};
use pid_runtime::dynamics::{At, Hessian};
use std::time::Instant;

/// Passes of the weighted least squares.
const PASSES: usize = 3;

/// The decimation filter cuts off at this share of the rate after decimation.
const PARALLEL: f64 = 0.4;

/// Filtered samples of all experiments of a role.
struct Samples {
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    u: Vec<f64>,
    stretches: Vec<Stretch>,
    /// Samples kept.
    count: usize,
    remarks: Vec<String>,
}

/// The samples of one experiment.
struct Stretch {
    t: Vec<f64>,
    /// Row of its first sample.
    first: usize,
    /// Samples left out at either end, since the filters lack neighbours there.
    edge: usize,
    /// Every n-th sample is kept.
    factor: usize,
    /// Cut-off of the decimation filter, Hz.
    cutoff: f64,
}

impl Stretch {
    /// Samples kept, counted from the start of the stretch.
    fn kept(&self) -> impl Iterator<Item = usize> + '_ {
        (self.edge..self.t.len() - self.edge).step_by(self.factor)
    }

    /// Applies the decimation filter to row-by-row channels; does nothing where nothing is
    /// decimated.
    fn filter(&self, x: Vec<f64>, columns: usize) -> Vec<f64> {
        if self.factor == 1 || columns == 0 {
            return x;
        }
        // The cut-off lies below half the rate by construction. If no filter can be made, the data
        // stay as they are.
        low_pass_channels(&self.t, &x, columns, self.cutoff).unwrap_or(x)
    }
}

impl Samples {
    fn of(dataset: &Dataset, role: Role, settings: &Settings) -> Result<Self, IdentError> {
        let mut all = Self {
            q: Vec::new(),
            v: Vec::new(),
            a: Vec::new(),
            u: Vec::new(),
            stretches: Vec::new(),
            count: 0,
            remarks: Vec::new(),
        };
        for experiment in dataset.with_role(role) {
            all.add(dataset, experiment, settings)?;
        }
        Ok(all)
    }

    fn add(
        &mut self,
        dataset: &Dataset,
        experiment: &Experiment,
        settings: &Settings,
    ) -> Result<(), IdentError> {
        let (n, nq) = (experiment.len(), experiment.nq);
        let state = state_from_data(experiment, settings.cutoff)?;
        let acting = acting_inputs(experiment, dataset.input_hold);
        let u = low_pass_channels(&experiment.t, &acting, nq, state.cutoff).map_err(|error| {
            IdentError::Filter {
                experiment: experiment.name.clone(),
                error,
            }
        })?;
        let step = experiment.sample_time();
        let factor = settings
            .decimate
            .unwrap_or_else(|| (1.0 / (4.0 * state.cutoff * step)).floor() as usize)
            .clamp(1, (n / 10).max(1));
        let cutoff = PARALLEL / (factor as f64 * step);
        let slowest = if factor > 1 {
            cutoff.min(state.cutoff)
        } else {
            state.cutoff
        };
        let stretch = Stretch {
            t: experiment.t.clone(),
            first: self.q.len() / nq.max(1),
            edge: ((3.0 / (slowest * step)).ceil() as usize).min(n / 10),
            factor,
            cutoff,
        };
        self.count += stretch.kept().count();
        self.q.extend_from_slice(&state.q);
        self.v.extend_from_slice(&state.v);
        self.a.extend_from_slice(&state.a);
        self.u.extend_from_slice(&u);
        self.remarks.push(if factor > 1 {
            format!(
                "{}: states filtered without phase shift at {:.1} Hz; the residual at {cutoff:.1} Hz, then every {} sample kept",
                experiment.name,
                state.cutoff,
                ordinal(factor)
            )
        } else {
            format!(
                "{}: states filtered without phase shift at {:.1} Hz",
                experiment.name, state.cutoff
            )
        });
        self.stretches.push(stretch);
        Ok(())
    }

    fn at<'a>(&'a self, k: usize, nq: usize, p: &'a [f64]) -> At<'a> {
        let row = k * nq..(k + 1) * nq;
        At {
            q: &self.q[row.clone()],
            v: &self.v[row.clone()],
            a: &self.a[row.clone()],
            u: &self.u[row],
            p,
        }
    }

    /// Evaluates `columns` values at every sample, filters and decimates them; row by row.
    fn condensed(&self, columns: usize, mut row: impl FnMut(usize, &mut [f64])) -> Vec<f64> {
        let mut out = Vec::with_capacity(self.count * columns);
        for stretch in &self.stretches {
            let mut x = vec![0.0; stretch.t.len() * columns];
            for (k, x) in x.chunks_exact_mut(columns).enumerate() {
                row(stretch.first + k, x);
            }
            let x = stretch.filter(x, columns);
            for k in stretch.kept() {
                out.extend_from_slice(&x[k * columns..(k + 1) * columns]);
            }
        }
        out
    }

    /// The adjoint of [`Self::condensed`] for zero-phase filters: values at every sample from those kept.
    fn spread(&self, kept: &[f64], columns: usize) -> Vec<f64> {
        let mut out = Vec::with_capacity(self.q.len());
        let mut rows = kept.chunks_exact(columns);
        for stretch in &self.stretches {
            let mut x = vec![0.0; stretch.t.len() * columns];
            for (k, row) in stretch.kept().zip(&mut rows) {
                x[k * columns..(k + 1) * columns].copy_from_slice(row);
            }
            out.extend(stretch.filter(x, columns));
        }
        out
    }

    /// Residuals, filtered and decimated.
    fn residuals(&self, model: &dyn Hessian, p: &[f64]) -> Vec<f64> {
        let nq = model.dims().nq;
        self.condensed(nq, |k, r| model.residual(&self.at(k, nq, p), r))
    }

    /// Residual and drive force of each joint.
    fn force_errors(&self, model: &dyn Hessian, p: &[f64], role: Role) -> Vec<ForceError> {
        let nq = model.dims().nq;
        let idle = vec![0.0; nq];
        let mut passive = vec![0.0; nq];
        let drive = self.condensed(nq, |k, f| {
            let at = self.at(k, nq, p);
            model.applied_force(&at, f);
            model.applied_force(&At { u: &idle, ..at }, &mut passive);
            f.iter_mut().zip(&passive).for_each(|(f, p)| *f -= p);
        });
        let residual = self.residuals(model, p);
        let rms = |x: &[f64], j: usize| {
            let square: f64 = x.iter().skip(j).step_by(nq).map(|x| x * x).sum();
            (square / self.count.max(1) as f64).sqrt()
        };
        (0..nq)
            .map(|j| {
                let (rms, drive) = (rms(&residual, j), rms(&drive, j));
                ForceError {
                    joint: model.joints()[j].name.to_string(),
                    role,
                    rms,
                    relative: (drive > 0.0).then(|| rms / drive),
                }
            })
            .collect()
    }
}

fn ordinal(n: usize) -> String {
    match (n % 10, n % 100) {
        (1, 1) if n == 1 => "single".to_owned(),
        (1, h) if h != 11 => format!("{n}st"),
        (2, h) if h != 12 => format!("{n}nd"),
        (3, h) if h != 13 => format!("{n}rd"),
        _ => format!("{n}th"),
    }
}

/// The dense program.
struct Fit<'a> {
    model: &'a dyn Hessian,
    samples: &'a Samples,
    weights: Vec<f64>,
    lower: &'a [f64],
    upper: &'a [f64],
    scale: &'a [f64],
    p: Vec<f64>,
    /// Residuals and their derivatives, filtered and decimated.
    rows: Vec<f64>,
    jacobian: Vec<f64>,
    hessian: Vec<f64>,
    empty: SparsePattern,
    pattern: SparsePattern,
}

impl<'a> Fit<'a> {
    fn new(
        model: &'a dyn Hessian,
        samples: &'a Samples,
        lower: &'a [f64],
        upper: &'a [f64],
        scale: &'a [f64],
    ) -> Self {
        let dims = model.dims();
        let mut pattern = SparsePattern::default();
        (0..dims.np).for_each(|i| (0..=i).for_each(|j| pattern.push(i, j)));
        Self {
            weights: vec![1.0; dims.nq],
            p: vec![0.0; dims.np],
            rows: Vec::new(),
            jacobian: vec![0.0; model.jacobian_pattern().nnz()],
            hessian: vec![0.0; model.hessian_pattern().nnz()],
            empty: SparsePattern::default(),
            model,
            samples,
            lower,
            upper,
            scale,
            pattern,
        }
    }

    fn load(&mut self, x: &[f64]) {
        for ((p, x), s) in self.p.iter_mut().zip(x).zip(self.scale) {
            *p = x * s;
        }
    }

    fn norm(&self) -> f64 {
        1.0 / self.samples.count.max(1) as f64
    }

    /// Residuals (nq a row) and ∂r/∂x (nq · np a row), filtered and decimated.
    fn linearise(&mut self) {
        let dims = self.model.dims();
        let (nq, np) = (dims.nq, dims.np);
        let (model, samples, p, scale) = (self.model, self.samples, &self.p, self.scale);
        let jacobian = &mut self.jacobian;
        let pattern = model.jacobian_pattern();
        let both = samples.condensed(nq * (1 + np), |k, row| {
            let (r, dense) = row.split_at_mut(nq);
            model.residual_jacobian(&samples.at(k, nq, p), r, jacobian);
            for ((&i, &col), value) in pattern.rows.iter().zip(pattern.cols).zip(&*jacobian) {
                if let Some(j) = (col as usize).checked_sub(dims.p()) {
                    dense[i as usize * np + j] = value * scale[j];
                }
            }
        });
        self.rows = both;
    }
}

impl Nlp for Fit<'_> {
    fn n(&self) -> usize {
        self.model.dims().np
    }
    fn m(&self) -> usize {
        0
    }
    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        for j in 0..self.n() {
            lower[j] = self.lower[j] / self.scale[j];
            upper[j] = self.upper[j] / self.scale[j];
        }
    }
    fn objective(&mut self, x: &[f64]) -> f64 {
        self.load(x);
        let nq = self.weights.len();
        let residuals = self.samples.residuals(self.model, &self.p);
        let sum: f64 = residuals
            .chunks_exact(nq)
            .map(|r| {
                r.iter()
                    .zip(&self.weights)
                    .map(|(r, w)| w * r * r)
                    .sum::<f64>()
            })
            .sum();
        sum * self.norm()
    }
    fn gradient(&mut self, x: &[f64], gradient: &mut [f64]) {
        self.load(x);
        self.linearise();
        gradient.fill(0.0);
        let (nq, np, norm) = (self.weights.len(), self.p.len(), self.norm());
        for row in self.rows.chunks_exact(nq * (1 + np)) {
            let (r, dense) = row.split_at(nq);
            for (j, r) in r.iter().enumerate() {
                let factor = 2.0 * norm * self.weights[j] * r;
                for (g, d) in gradient.iter_mut().zip(&dense[j * np..(j + 1) * np]) {
                    *g += factor * d;
                }
            }
        }
    }
    fn constraints(&mut self, _: &[f64], _: &mut [f64]) {}
    fn jacobian_pattern(&self) -> &SparsePattern {
        &self.empty
    }
    fn jacobian(&mut self, _: &[f64], _: &mut [f64]) {}
    fn hessian_pattern(&self) -> &SparsePattern {
        &self.pattern
    }
    fn hessian(&mut self, x: &[f64], sigma: f64, _: &[f64], values: &mut [f64]) {
        self.load(x);
        self.linearise();
        values.fill(0.0);
        let dims = self.model.dims();
        let (nq, np, norm) = (dims.nq, dims.np, self.norm());
        let slot = |i: usize, j: usize| i.max(j) * (i.max(j) + 1) / 2 + i.min(j);
        let mut lambda = Vec::with_capacity(self.samples.count * nq);
        for row in self.rows.chunks_exact(nq * (1 + np)) {
            let (r, dense) = row.split_at(nq);
            for j in 0..nq {
                let factor = 2.0 * sigma * norm * self.weights[j];
                lambda.push(factor * r[j]);
                let d = &dense[j * np..(j + 1) * np];
                for i in (0..np).filter(|&i| d[i] != 0.0) {
                    for (v, d_j) in values[slot(i, 0)..=slot(i, i)].iter_mut().zip(d) {
                        *v += factor * d[i] * d_j;
                    }
                }
            }
        }
        // Second derivatives of r, weighted by the residual that the adjoint filter sends back.
        let lambda = self.samples.spread(&lambda, nq);
        let pattern = self.model.hessian_pattern();
        let places: Vec<Option<(usize, f64)>> = pattern
            .rows
            .iter()
            .zip(pattern.cols)
            .map(|(&row, &col)| {
                let i = (row as usize).checked_sub(dims.p())?;
                let j = (col as usize).checked_sub(dims.p())?;
                Some((slot(i, j), self.scale[i] * self.scale[j]))
            })
            .collect();
        if places.iter().all(Option::is_none) {
            return;
        }
        for (k, lambda) in lambda.chunks_exact(nq).enumerate() {
            let at = self.samples.at(k, nq, &self.p);
            self.model.residual_hessian(&at, lambda, &mut self.hessian);
            for (place, value) in places.iter().zip(&self.hessian) {
                if let Some((slot, scale)) = place {
                    values[*slot] += value * scale;
                }
            }
        }
    }
}

/// Identifies by equation error.
pub(super) fn identify(
    model: &dyn Hessian,
    dataset: &Dataset,
    settings: &Settings,
    start: &[f64],
    callback: &mut Callback<'_>,
) -> Result<Identification, IdentError> {
    let (lower, upper, fixed) = bounds(model, start, &settings.hold);
    let scale = scales(model);
    let samples = Samples::of(dataset, Role::Train, settings)?;
    let mut fit = Fit::new(model, &samples, &lower, &upper, &scale);
    let mut kkt = SparseKkt::new(&fit);
    let all = super::starts::draw(
        settings.sampling,
        start,
        &lower,
        &upper,
        settings.starts,
        settings.seed,
    );
    let count = all.len();
    let mut runs: Vec<Run> = Vec::new();
    let mut weights_of_best = fit.weights.clone();
    let mut notes = samples.remarks.clone();
    for (index, p0) in all.into_iter().enumerate() {
        let started = Instant::now();
        fit.weights = relative_weights(&samples, model, &p0);
        let mut x: Vec<f64> = p0.iter().zip(&scale).map(|(p, s)| p / s).collect();
        let (mut iterations, mut stopped) = (0, false);
        let mut last = None;
        for _ in 0..PASSES {
            let mut news = |line: &_, _: &[f64]| {
                let phase = "least squares on the residual";
                let flow = callback(&Progress {
                    start: index,
                    starts: count,
                    phase,
                    iteration: line,
                });
                stopped |= flow.is_break();
                flow
            };
            let solution = ip::solve(&mut fit, &mut kkt, &x, &settings.solver, &mut news);
            iterations += solution.log.len().saturating_sub(1);
            x.copy_from_slice(&solution.x);
            let p: Vec<f64> = x.iter().zip(&scale).map(|(x, s)| x * s).collect();
            let used = fit.weights.clone();
            let check = check_point(&mut fit, &x, &[]);
            let single = model.dims().nq == 1;
            fit.weights = relative_weights(&samples, model, &p);
            last = Some((solution, check, p, used));
            if single || stopped {
                break;
            }
        }
        let Some((solution, check, parameters, used)) = last else {
            continue;
        };
        runs.push(Run {
            index,
            start: p0,
            parameters,
            objective: solution.objective,
            status: solution.status,
            iterations,
            seconds: started.elapsed().as_secs_f64(),
            check,
            log: solution.log,
        });
        if best_of(&runs) == index {
            weights_of_best = used;
        }
        if stopped {
            notes.push(format!("interrupted after start {} of {count}", index + 1));
            break;
        }
    }
    let best = best_of(&runs);
    fit.weights = weights_of_best;
    let spread = runs.get(best).map_or_else(
        || Spread::none(scale.len()),
        |run| deviations(&mut fit, run, &fixed),
    );
    let mut force_error = Vec::new();
    if let Some(run) = runs.get(best) {
        force_error.extend(samples.force_errors(model, &run.parameters, Role::Train));
        if dataset.with_role(Role::Test).next().is_some() {
            let test = Samples::of(dataset, Role::Test, settings)?;
            force_error.extend(test.force_errors(model, &run.parameters, Role::Test));
        }
    }
    Ok(Identification {
        optima: Vec::new(),
        motion: Vec::new(),
        runs,
        best,
        deviations: spread.deviations,
        undetermined: spread.undetermined,
        open: spread.open,
        covariance: spread.covariance,
        sandwich: spread.sandwich,
        noise: vec![None; 2 * model.dims().nq],
        correlation_factor: spread.correlation_factor,
        dispersion: spread.dispersion,
        fixed,
        lower,
        upper,
        size: (scale.len(), 0),
        windows: (dataset.with_role(Role::Train).count(), samples.count),
        force_error,
        notes,
    })
}

/// One over the variance of each joint's residual.
fn relative_weights(samples: &Samples, model: &dyn Hessian, p: &[f64]) -> Vec<f64> {
    let nq = model.dims().nq;
    let r = samples.residuals(model, p);
    (0..nq)
        .map(|j| {
            let square: f64 = r.iter().skip(j).step_by(nq).map(|r| r * r).sum();
            let variance = square / samples.count.max(1) as f64;
            if variance > 0.0 && variance.is_finite() {
                1.0 / variance
            } else {
                1.0
            }
        })
        .collect()
}

fn deviations(fit: &mut Fit<'_>, run: &Run, fixed: &[bool]) -> Spread {
    let np = run.parameters.len();
    let free: Vec<usize> = (0..np)
        .filter(|&j| {
            !fixed[j] && !uncertainty::at_bound(run.parameters[j], fit.lower[j], fit.upper[j])
        })
        .collect();
    let x: Vec<f64> = run
        .parameters
        .iter()
        .zip(fit.scale)
        .map(|(p, s)| p / s)
        .collect();
    let mut values = vec![0.0; fit.pattern.nnz()];
    fit.hessian(&x, 1.0, &[], &mut values);
    let slot = |i: usize, j: usize| i.max(j) * (i.max(j) + 1) / 2 + i.min(j);
    let hessian = Mat::from_fn(free.len(), free.len(), |i, j| {
        values[slot(free[i], free[j])]
    });
    let nq = fit.weights.len();
    let mut residuals = fit.samples.residuals(fit.model, &run.parameters);
    let norm = fit.norm();
    for (k, r) in residuals.iter_mut().enumerate() {
        *r *= (fit.weights[k % nq] * norm).sqrt();
    }
    uncertainty::from_hessian(&Solved {
        hessian: &hessian,
        free: &free,
        scale: fit.scale,
        lower: fit.lower,
        upper: fit.upper,
        loss: Loss::Square,
        priors: &[],
        share: 1.0,
        residuals: &residuals,
        channels: nq,
        unknowns: free.len(),
        scores: None,
    })
}
