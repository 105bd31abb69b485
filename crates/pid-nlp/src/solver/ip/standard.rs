//! From a problem with ranges on its rows to one with equations: slacks, scaling, relaxed bounds.
//!
//! ```text
//! c_lower ≤ c(x) ≤ c_upper   ⇒   d_i (c_i(x) − c_i) = 0            where the bounds are equal
//!                                d_i c_i(x) − s_i = 0,  s_i bounded   elsewhere
//! ```
//!
//! The slacks are eliminated again before the linear system: `Σ_s ds − dλ = r_s` leaves the row
//! `J dx − Σ_s⁻¹ dλ`, so that the system keeps the size and the structure of the problem.

use super::bounds::{Bounds, interior};
use super::iterate::Iterate;
use super::program::Program;
use crate::nlp::{Nlp, SparsePattern};
use crate::solver::kkt::{Kkt, KktError, KktValues, Regularisation};
use crate::solver::settings::Settings;

/// Relaxation of a row without any bound: its multiplier stays at zero.
const UNBOUNDED: f64 = 1e20;

/// A user's problem with slacks, scaled.
pub(super) struct Standard<'a> {
    inner: &'a mut dyn Nlp,
    n: usize,
    m: usize,
    /// Rows that have a slack.
    pub(super) slack_rows: Vec<usize>,
    /// Right-hand side of each equation in its own units, 0 for rows with a slack.
    target: Vec<f64>,
    pub(super) row_scale: Vec<f64>,
    pub(super) f_scale: f64,
    /// Bounds of (x, s) as the solver sees them.
    bounds: Bounds,
    /// The user's bounds on x.
    pub(super) original: Bounds,
    /// Pattern with the slacks' columns, where there are slacks.
    jacobian_pattern: Option<SparsePattern>,
    lambda: Vec<f64>,
    /// Entry ranges are scaled row by row: row of each Jacobian entry.
    scaled: bool,
}

impl<'a> Standard<'a> {
    /// Takes the problem and a start; returns the start of the standard form as well.
    pub(super) fn new(
        inner: &'a mut dyn Nlp,
        x0: &[f64],
        push: f64,
        settings: &Settings,
    ) -> (Self, Vec<f64>) {
        let (n, m) = (inner.n(), inner.m());
        let (mut lower, mut upper) = (vec![0.0; n], vec![0.0; n]);
        inner.bounds(&mut lower, &mut upper);
        let original = Bounds::new(lower.clone(), upper.clone());
        let (mut c_lower, mut c_upper) = (vec![0.0; m], vec![0.0; m]);
        inner.constraint_bounds(&mut c_lower, &mut c_upper);
        let slack_rows: Vec<usize> = (0..m).filter(|&i| c_lower[i] != c_upper[i]).collect();

        let mut relaxed = original.clone();
        relaxed.relax(settings.bound_relaxation);
        let mut x: Vec<f64> = (0..n)
            .map(|j| interior(x0[j], relaxed.lower[j], relaxed.upper[j], push))
            .collect();

        let mut gradient = vec![0.0; n];
        // A program's own barrier does not enter the scaling.
        inner.barrier_changed(0.0);
        inner.gradient(&x, &mut gradient);
        let steepest = (0..n)
            .filter(|&j| !original.fixed[j])
            .fold(0.0_f64, |a, j| a.max(gradient[j].abs()))
            * settings.objective_scale;
        let mut f_scale = settings.objective_scale;
        if steepest > settings.max_gradient && steepest.is_finite() {
            f_scale *= (settings.max_gradient / steepest).max(1e-8);
        }
        let mut row_scale = vec![1.0_f64; m];
        if settings.scale_constraints && m > 0 {
            let mut values = vec![0.0; inner.jacobian_pattern().nnz()];
            inner.jacobian(&x, &mut values);
            let mut largest = vec![0.0_f64; m];
            let pattern = inner.jacobian_pattern();
            for ((&i, &j), v) in pattern.rows.iter().zip(&pattern.cols).zip(&values) {
                if !original.fixed[j as usize] && v.is_finite() {
                    largest[i as usize] = largest[i as usize].max(v.abs());
                }
            }
            for (scale, largest) in row_scale.iter_mut().zip(largest) {
                if largest > settings.max_gradient {
                    *scale = (settings.max_gradient / largest).max(1e-8);
                }
            }
        }
        let scaled = row_scale.iter().any(|s| *s != 1.0);

        for &i in &slack_rows {
            lower.push(c_lower[i] * row_scale[i]);
            upper.push(c_upper[i] * row_scale[i]);
        }
        let mut bounds = Bounds::new(lower, upper);
        bounds.relax(settings.bound_relaxation);
        if !slack_rows.is_empty() {
            let mut c = vec![0.0; m];
            inner.constraints(&x, &mut c);
            for (k, &i) in slack_rows.iter().enumerate() {
                let (l, u) = (bounds.lower[n + k], bounds.upper[n + k]);
                x.push(interior(c[i] * row_scale[i], l, u, push));
            }
        }
        let jacobian_pattern = (!slack_rows.is_empty()).then(|| {
            let mut pattern = inner.jacobian_pattern().clone();
            for (k, &i) in slack_rows.iter().enumerate() {
                pattern.push(i, n + k);
            }
            pattern
        });
        let mut target = c_lower;
        slack_rows.iter().for_each(|&i| target[i] = 0.0);
        let standard = Self {
            n,
            m,
            slack_rows,
            target,
            row_scale,
            f_scale,
            bounds,
            original,
            jacobian_pattern,
            lambda: vec![0.0; m],
            scaled,
            inner,
        };
        (standard, x)
    }
}

impl Nlp for Standard<'_> {
    fn n(&self) -> usize {
        self.n + self.slack_rows.len()
    }

    fn m(&self) -> usize {
        self.m
    }

    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        lower.copy_from_slice(&self.bounds.lower);
        upper.copy_from_slice(&self.bounds.upper);
    }

    fn objective(&mut self, x: &[f64]) -> f64 {
        self.f_scale * self.inner.objective(&x[..self.n])
    }

    fn gradient(&mut self, x: &[f64], gradient: &mut [f64]) {
        let (user, slacks) = gradient.split_at_mut(self.n);
        self.inner.gradient(&x[..self.n], user);
        user.iter_mut().for_each(|g| *g *= self.f_scale);
        slacks.fill(0.0);
    }

    fn constraints(&mut self, x: &[f64], c: &mut [f64]) {
        self.inner.constraints(&x[..self.n], c);
        for ((c, t), s) in c.iter_mut().zip(&self.target).zip(&self.row_scale) {
            *c = s * (*c - t);
        }
        for (&i, slack) in self.slack_rows.iter().zip(&x[self.n..]) {
            c[i] -= slack;
        }
    }

    fn jacobian_pattern(&self) -> &SparsePattern {
        match &self.jacobian_pattern {
            Some(pattern) => pattern,
            None => self.inner.jacobian_pattern(),
        }
    }

    fn jacobian(&mut self, x: &[f64], values: &mut [f64]) {
        let (user, slacks) = values.split_at_mut(values.len() - self.slack_rows.len());
        self.inner.jacobian(&x[..self.n], user);
        if self.scaled {
            let rows = &self.inner.jacobian_pattern().rows;
            for (v, &i) in user.iter_mut().zip(rows) {
                *v *= self.row_scale[i as usize];
            }
        }
        slacks.fill(-1.0);
    }

    fn hessian_pattern(&self) -> &SparsePattern {
        self.inner.hessian_pattern()
    }

    fn hessian(&mut self, x: &[f64], sigma: f64, lambda: &[f64], values: &mut [f64]) {
        let sigma = sigma * self.f_scale;
        let x = &x[..self.n];
        if self.scaled {
            for ((l, lambda), s) in self.lambda.iter_mut().zip(lambda).zip(&self.row_scale) {
                *l = lambda * s;
            }
            self.inner.hessian(x, sigma, &self.lambda, values);
        } else {
            self.inner.hessian(x, sigma, lambda, values);
        }
    }

    fn barrier_changed(&mut self, mu: f64) -> bool {
        self.inner.barrier_changed(mu / self.f_scale)
    }

    fn longest_step(&self, x: &[f64], d: &[f64], share: f64) -> f64 {
        self.inner.longest_step(&x[..self.n], &d[..self.n], share)
    }
}

impl Program for Standard<'_> {
    fn scale(&self) -> f64 {
        self.f_scale
    }

    fn violation(&self, c: &[f64]) -> f64 {
        let own = c.iter().zip(&self.row_scale).map(|(c, s)| c.abs() / s);
        own.fold(0.0, f64::max)
    }

    fn visible(&self) -> usize {
        self.n
    }

    fn reset_slacks(&mut self, trial: &mut Iterate, current: &[f64], tau: f64) -> bool {
        let mut changed = false;
        for (k, &i) in self.slack_rows.iter().enumerate() {
            let at = self.n + k;
            let value = trial.c[i] + trial.x[at];
            let (lower, upper) = (self.bounds.lower[at], self.bounds.upper[at]);
            let least = lower + (1.0 - tau) * (current[at] - lower);
            let most = upper - (1.0 - tau) * (upper - current[at]);
            // Infinite bounds give infinite limits.
            let slack = value.max(least).min(most);
            if slack.is_finite() && slack != trial.x[at] {
                trial.x[at] = slack;
                trial.c[i] = value - slack;
                changed = true;
            }
        }
        if changed {
            trial.theta = trial.c.iter().map(|c| c.abs()).sum();
        }
        changed
    }
}

/// The linear system of a [`Standard`] problem by that of the user's.
pub(super) struct StandardKkt<'a> {
    inner: &'a mut dyn Kkt,
    n: usize,
    slack_rows: Vec<usize>,
    /// Σ of the slacks, kept away from zero.
    sigma: Vec<f64>,
    /// Relaxation asked for from outside, and with the slacks' part.
    outer: Vec<f64>,
    relaxation: Vec<f64>,
    rc: Vec<f64>,
}

impl<'a> StandardKkt<'a> {
    pub(super) fn new(inner: &'a mut dyn Kkt, n: usize, m: usize, slack_rows: &[usize]) -> Self {
        inner.relax(&[]);
        Self {
            inner,
            n,
            slack_rows: slack_rows.to_vec(),
            sigma: vec![0.0; slack_rows.len()],
            outer: Vec::new(),
            relaxation: vec![0.0; m],
            rc: vec![0.0; m],
        }
    }
}

impl Kkt for StandardKkt<'_> {
    fn expect_error(&mut self, error: f64) {
        self.inner.expect_error(error);
    }

    fn limit(&mut self, radius: f64) -> Option<f64> {
        self.inner.limit(radius)
    }

    fn factorise(&mut self, values: KktValues<'_>) -> Result<Regularisation, KktError> {
        if self.slack_rows.is_empty() {
            self.inner.relax(&self.outer);
            return self.inner.factorise(values);
        }
        if self.outer.is_empty() {
            self.relaxation.fill(0.0);
        } else {
            self.relaxation.copy_from_slice(&self.outer);
        }
        for (k, &i) in self.slack_rows.iter().enumerate() {
            self.sigma[k] = values.sigma[self.n + k].max(1.0 / UNBOUNDED);
            self.relaxation[i] += 1.0 / self.sigma[k];
        }
        self.inner.relax(&self.relaxation);
        self.inner.factorise(KktValues {
            hessian: values.hessian,
            jacobian: &values.jacobian[..values.jacobian.len() - self.slack_rows.len()],
            sigma: &values.sigma[..self.n],
        })
    }

    fn relaxable(&self) -> bool {
        self.inner.relaxable()
    }

    fn relax(&mut self, diagonal: &[f64]) {
        self.outer.clear();
        self.outer.extend_from_slice(diagonal);
    }

    fn solve(&mut self, rx: &[f64], rc: &[f64], dx: &mut [f64], dlambda: &mut [f64]) -> f64 {
        if self.slack_rows.is_empty() {
            return self.inner.solve(rx, rc, dx, dlambda);
        }
        self.rc.copy_from_slice(rc);
        for (k, &i) in self.slack_rows.iter().enumerate() {
            self.rc[i] += rx[self.n + k] / self.sigma[k];
        }
        let (user, slacks) = dx.split_at_mut(self.n);
        let residual = self.inner.solve(&rx[..self.n], &self.rc, user, dlambda);
        for (k, &i) in self.slack_rows.iter().enumerate() {
            slacks[k] = (rx[self.n + k] + dlambda[i]) / self.sigma[k];
        }
        residual
    }
}
