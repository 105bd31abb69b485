//! Filtered and decimated samples, at which equation errors are evaluated.

use super::error::IdentError;
use super::outcome::ForceError;
use super::settings::Settings;
use pid_data::signal::{acting_inputs, low_pass_channels, state_from_data};
use pid_data::{Dataset, Experiment, Role};
use pid_runtime::dynamics::{At, Hessian};

/// The decimation filter cuts off at this share of the rate after decimation.
const PARALLEL: f64 = 0.4;

/// Filtered samples of all experiments of a role.
pub(super) struct Samples {
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    u: Vec<f64>,
    stretches: Vec<Stretch>,
    /// Samples kept.
    pub(super) count: usize,
    /// What was filtered and left out, one sentence each.
    pub(super) remarks: Vec<String>,
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
    pub(super) fn of(
        dataset: &Dataset,
        role: Role,
        settings: &Settings,
    ) -> Result<Self, IdentError> {
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

    pub(super) fn at<'a>(&'a self, k: usize, nq: usize, p: &'a [f64]) -> At<'a> {
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
    pub(super) fn condensed(
        &self,
        columns: usize,
        mut row: impl FnMut(usize, &mut [f64]),
    ) -> Vec<f64> {
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
    pub(super) fn spread(&self, kept: &[f64], columns: usize) -> Vec<f64> {
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
    pub(super) fn residuals(&self, model: &dyn Hessian, p: &[f64]) -> Vec<f64> {
        let nq = model.dims().nq;
        self.condensed(nq, |k, r| model.residual(&self.at(k, nq, p), r))
    }

    /// Residual and drive force of each joint.
    pub(super) fn force_errors(
        &self,
        model: &dyn Hessian,
        p: &[f64],
        role: Role,
    ) -> Vec<ForceError> {
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
