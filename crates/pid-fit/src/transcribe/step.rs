//! One step of a scheme: its constraint rows and their exact first and second derivatives.
//!
//! ```text
//! c(x, y, p) = 0,      x = (q_k, v_k),      y = (stage accelerations, q_{k+1}, v_{k+1})
//! ```
//!
//! The rows are the linear combinations of the scheme, then its residuals times h / M_jj, so that
//! all of them are changes of state. The full discretization takes y as unknowns; shooting solves
//! for it.

use super::butcher::Butcher;
use super::expansion::{Contribution, Expansion};
use super::explicit_form::ExplicitForm;
use super::tableau::{Block, POWERS, Tableau, Term, pow, powers};
use pid_runtime::dynamics::{At, Hessian};

/// A model discretised by a scheme.
pub(super) struct Rule<'m> {
    pub(super) model: &'m dyn Hessian,
    /// The model, if it has its accelerations solved for. Steps evaluated four at a time then
    /// remember the solution.
    pub(super) solved: Option<&'m ExplicitForm<'m>>,
    pub(super) tableau: Tableau,
    pub(super) expansion: Expansion,
    inertia: Vec<f64>,
    linear_inputs: bool,
    pub(super) nq: usize,
}

/// Length and inputs of a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Interval<'a> {
    /// Length of the step, s.
    pub(super) h: f64,
    /// Inputs at the samples before and after it.
    pub(super) u0: &'a [f64],
    pub(super) u1: &'a [f64],
    /// Where the step starts in its sampling interval, and the share of it that it covers.
    pub(super) from: f64,
    pub(super) share: f64,
}

/// Scratch of one thread.
pub(super) struct Scratch {
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    u: Vec<f64>,
    r: Vec<f64>,
    jacobian: Vec<f64>,
    hessian: Vec<f64>,
    lambda: Vec<f64>,
    /// Sum over the steps of the entries between parameters; the caller empties it.
    pub(super) parameter_hessian: Vec<f64>,
    /// Coefficients for the step length they were made for.
    h: f64,
    jacobian_factors: Vec<f64>,
    hessian_factors: Vec<f64>,
}

impl<'m> Rule<'m> {
    /// `scale[j]` is the model's value of a parameter per unit of the program's variable, `inertia`
    /// the typical diagonal of M.
    pub(super) fn new(
        model: &'m dyn Hessian,
        tableau: Tableau,
        scale: &[f64],
        inertia: &[f64],
        linear_inputs: bool,
    ) -> Self {
        Self {
            model,
            solved: None,
            expansion: Expansion::new(model, &tableau, scale),
            tableau,
            inertia: inertia.to_vec(),
            linear_inputs,
            nq: model.dims().nq,
        }
    }

    /// Takes a model with its accelerations solved for. The solution of one evaluation of four
    /// steps serves the next at the same point.
    pub(super) fn remembering(mut self, form: &'m ExplicitForm<'m>) -> Self {
        self.solved = Some(form);
        self
    }

    pub(super) fn model(&self) -> &'m dyn Hessian {
        self.model
    }

    pub(super) fn expansion(&self) -> &Expansion {
        &self.expansion
    }

    /// The Runge-Kutta method behind the scheme.
    pub(super) fn butcher(&self) -> &Butcher {
        &self.tableau.butcher
    }

    /// Unknowns, and rows, of a step.
    pub(super) fn ny(&self) -> usize {
        self.tableau.unknowns(self.nq)
    }

    pub(super) fn scratch(&self) -> Scratch {
        let dims = self.model.dims();
        Scratch {
            q: vec![0.0; dims.nq],
            v: vec![0.0; dims.nq],
            a: vec![0.0; dims.nq],
            u: vec![0.0; dims.nu],
            r: vec![0.0; dims.nq],
            jacobian: vec![0.0; self.model.jacobian_pattern().nnz()],
            hessian: vec![0.0; self.model.hessian_pattern().nnz()],
            lambda: vec![0.0; dims.nq],
            parameter_hessian: vec![0.0; self.expansion.parameter_hessian.len()],
            h: 0.0,
            jacobian_factors: Vec::new(),
            hessian_factors: Vec::new(),
        }
    }

    fn combine(
        &self,
        terms: &[Term],
        x: &[f64],
        y: &[f64],
        powers: &[f64; POWERS],
        out: &mut [f64],
    ) {
        out.fill(0.0);
        let nq = self.nq;
        for term in terms {
            let block = match term.block {
                Block::Q0 => &x[..nq],
                Block::V0 => &x[nq..],
                other => &y[self.tableau.position(other, nq) - 2 * nq..][..nq],
            };
            let c = term.coefficient * pow(powers, term.power);
            for (o, b) in out.iter_mut().zip(block) {
                *o += c * b;
            }
        }
    }

    /// Inputs at the share `c` of a step.
    pub(super) fn inputs(&self, interval: &Interval<'_>, c: f64, out: &mut [f64]) {
        for (j, out) in out.iter_mut().enumerate() {
            *out = self.input(interval, c, j);
        }
    }

    /// Input `j` at the share `c` of a step.
    #[inline]
    pub(super) fn input(&self, interval: &Interval<'_>, c: f64, j: usize) -> f64 {
        let share = interval.from + c * interval.share;
        if self.linear_inputs && share > 0.0 {
            (1.0 - share) * interval.u0[j] + share * interval.u1[j]
        } else {
            interval.u0[j]
        }
    }

    /// Arguments of evaluation `e` of a step, into the scratch.
    fn arguments(
        &self,
        e: usize,
        (x, y): (&[f64], &[f64]),
        interval: &Interval<'_>,
        powers: &[f64; POWERS],
        s: &mut Scratch,
    ) {
        let evaluation = &self.tableau.evaluations[e];
        self.combine(&evaluation.q, x, y, powers, &mut s.q);
        self.combine(&evaluation.v, x, y, powers, &mut s.v);
        self.combine(&evaluation.a, x, y, powers, &mut s.a);
        self.inputs(interval, evaluation.u, &mut s.u);
    }

    pub(super) fn row_scale(&self, j: usize, h: f64) -> f64 {
        h / self.inertia[j]
    }

    /// c(x, y, p); `p` in the model's units.
    pub(super) fn constraints(
        &self,
        x: &[f64],
        y: &[f64],
        p: &[f64],
        interval: &Interval<'_>,
        s: &mut Scratch,
        c: &mut [f64],
    ) {
        let nq = self.nq;
        let powers = powers(interval.h);
        let (linear, dynamic) = c.split_at_mut(self.tableau.linear.len() * nq);
        for (terms, out) in self.tableau.linear.iter().zip(linear.chunks_exact_mut(nq)) {
            self.combine(terms, x, y, &powers, out);
        }
        dynamic.fill(0.0);
        for (e, evaluation) in self.tableau.evaluations.iter().enumerate() {
            let out = &mut dynamic[evaluation.group * nq..][..nq];
            self.arguments(e, (x, y), interval, &powers, s);
            let at = At {
                q: &s.q,
                v: &s.v,
                a: &s.a,
                u: &s.u,
                p,
            };
            self.model.residual(&at, &mut s.r);
            for j in 0..nq {
                out[j] += evaluation.weight * self.row_scale(j, interval.h) * s.r[j];
            }
        }
    }

    /// Fills the factors of all contributions for a step length.
    fn prepare(&self, h: f64, s: &mut Scratch) {
        if s.h == h && !s.jacobian_factors.is_empty() {
            return;
        }
        s.h = h;
        let powers = powers(h);
        let factor = |c: &Contribution| c.coefficient * pow(&powers, c.power);
        s.jacobian_factors.clear();
        s.hessian_factors.clear();
        let rows = self.model.jacobian_pattern().rows;
        for (map, evaluation) in self
            .expansion
            .evaluations
            .iter()
            .zip(&self.tableau.evaluations)
        {
            s.jacobian_factors.extend(map.jacobian.iter().map(|c| {
                let row = rows[c.source as usize] as usize;
                evaluation.weight * factor(c) * self.row_scale(row, h)
            }));
            s.hessian_factors.extend(map.hessian.iter().map(factor));
            s.hessian_factors
                .extend(map.parameter_hessian.iter().map(factor));
        }
    }

    /// ∂c/∂(x, y, p) at the entries of the expansion's `step_jacobian`.
    pub(super) fn jacobian(
        &self,
        x: &[f64],
        y: &[f64],
        p: &[f64],
        interval: &Interval<'_>,
        s: &mut Scratch,
        values: &mut [f64],
    ) {
        self.prepare(interval.h, s);
        let powers = powers(interval.h);
        values.fill(0.0);
        for &(entry, coefficient, power) in &self.expansion.linear {
            values[entry as usize] += coefficient * pow(&powers, power);
        }
        let mut first = 0;
        for (e, map) in self.expansion.evaluations.iter().enumerate() {
            self.arguments(e, (x, y), interval, &powers, s);
            let at = At {
                q: &s.q,
                v: &s.v,
                a: &s.a,
                u: &s.u,
                p,
            };
            self.model.residual_jacobian(&at, &mut s.r, &mut s.jacobian);
            let factors = &s.jacobian_factors[first..first + map.jacobian.len()];
            for (c, factor) in map.jacobian.iter().zip(factors) {
                values[c.entry as usize] += factor * s.jacobian[c.source as usize];
            }
            first += map.jacobian.len();
        }
    }

    /// Hess(λᵀc) at the entries of the expansion's `step_hessian`; entries between parameters are
    /// added to the scratch's.
    #[allow(
        clippy::too_many_arguments,
        reason = "a point, its interval, and where results go"
    )]
    pub(super) fn hessian(
        &self,
        x: &[f64],
        y: &[f64],
        p: &[f64],
        interval: &Interval<'_>,
        lambda: &[f64],
        s: &mut Scratch,
        values: &mut [f64],
    ) {
        self.prepare(interval.h, s);
        let nq = self.nq;
        let powers = powers(interval.h);
        values.fill(0.0);
        let dynamic = &lambda[self.tableau.linear.len() * nq..];
        let mut first = 0;
        for (e, map) in self.expansion.evaluations.iter().enumerate() {
            self.arguments(e, (x, y), interval, &powers, s);
            let evaluation = &self.tableau.evaluations[e];
            for j in 0..nq {
                let weight = evaluation.weight * self.row_scale(j, interval.h);
                s.lambda[j] = weight * dynamic[evaluation.group * nq + j];
            }
            let at = At {
                q: &s.q,
                v: &s.v,
                a: &s.a,
                u: &s.u,
                p,
            };
            self.model.residual_hessian(&at, &s.lambda, &mut s.hessian);
            let factors = &s.hessian_factors[first..first + map.hessian.len()];
            for (c, factor) in map.hessian.iter().zip(factors) {
                values[c.entry as usize] += factor * s.hessian[c.source as usize];
            }
            first += map.hessian.len();
            let factors = &s.hessian_factors[first..first + map.parameter_hessian.len()];
            for (c, factor) in map.parameter_hessian.iter().zip(factors) {
                s.parameter_hessian[c.entry as usize] += factor * s.hessian[c.source as usize];
            }
            first += map.parameter_hessian.len();
        }
    }
}
