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
use super::samples::Samples;
use super::settings::Settings;
use super::uncertainty::{self, Solved, Spread};
use crate::transcribe::Loss;
use faer::Mat;
use pid_data::{Dataset, Role};
use pid_nlp::solver::kkt::sparse::SparseKkt;
use pid_nlp::solver::{self, Iteration, ip};
use pid_nlp::{Nlp, SparsePattern, check_point};
use pid_runtime::dynamics::Hessian;
use std::ops::ControlFlow;
use std::time::Instant;

/// Passes of the weighted least squares.
const PASSES: usize = 3;

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

/// What one start came to.
struct Settled {
    run: Run,
    /// Weights of its last pass.
    weights: Vec<f64>,
    /// Whether the caller ended it.
    stopped: bool,
}

impl Fit<'_> {
    /// Passes from one start, each with the weights that the residuals before it give.
    fn settle(
        &mut self,
        kkt: &mut SparseKkt,
        (index, start): (usize, Vec<f64>),
        settings: &solver::Settings,
        tell: &mut dyn FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Option<Settled> {
        let started = Instant::now();
        self.weights = relative_weights(self.samples, self.model, &start);
        let mut x: Vec<f64> = start.iter().zip(self.scale).map(|(p, s)| p / s).collect();
        let (mut iterations, mut stopped) = (0, false);
        let mut last = None;
        for _ in 0..PASSES {
            let mut news = |line: &Iteration, _: &[f64]| {
                let flow = tell(line);
                stopped |= flow.is_break();
                flow
            };
            let solution = ip::solve(self, kkt, &x, settings, &mut news);
            iterations += solution.log.len().saturating_sub(1);
            x.copy_from_slice(&solution.x);
            let p: Vec<f64> = x.iter().zip(self.scale).map(|(x, s)| x * s).collect();
            let used = self.weights.clone();
            let check = check_point(self, &x, &[]);
            let single = self.model.dims().nq == 1;
            self.weights = relative_weights(self.samples, self.model, &p);
            last = Some((solution, check, p, used));
            if single || stopped {
                break;
            }
        }
        let (solution, check, parameters, weights) = last?;
        let run = Run {
            index,
            start,
            parameters,
            objective: solution.objective,
            status: solution.status,
            iterations,
            seconds: started.elapsed().as_secs_f64(),
            check,
            log: solution.log,
        };
        Some(Settled {
            run,
            weights,
            stopped,
        })
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
        let mut tell = |line: &Iteration| {
            callback(&Progress {
                start: index,
                starts: count,
                phase: "least squares on the residual",
                iteration: line,
            })
        };
        let settled = fit.settle(&mut kkt, (index, p0), &settings.solver, &mut tell);
        let Some(settled) = settled else {
            continue;
        };
        runs.push(settled.run);
        if best_of(&runs) == index {
            weights_of_best = settled.weights;
        }
        if settled.stopped {
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
    let force_error = match runs.get(best) {
        Some(run) => force_errors(model, dataset, settings, &samples, &run.parameters)?,
        None => Vec::new(),
    };
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

/// Residual and drive force of each joint, in the training records and in the test records.
fn force_errors(
    model: &dyn Hessian,
    dataset: &Dataset,
    settings: &Settings,
    train: &Samples,
    p: &[f64],
) -> Result<Vec<ForceError>, IdentError> {
    let mut all = train.force_errors(model, p, Role::Train);
    if dataset.with_role(Role::Test).next().is_some() {
        let test = Samples::of(dataset, Role::Test, settings)?;
        all.extend(test.force_errors(model, p, Role::Test));
    }
    Ok(all)
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
        edges: Vec::new(),
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
