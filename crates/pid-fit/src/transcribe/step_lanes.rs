//! The steps of [`Rule`] four at a time, for programs that repeat one step over a record.

use super::expansion::Contribution;
use super::explicit_lanes::{LaneWork, SolvedLanes};
use super::step::{Interval, Rule};
use super::tableau::{Block, POWERS, Term, pow, powers};
use pid_lanes::kernel::{Simd, SimdFloat, load, unpack, widest};
use pid_runtime::lanes::{LANES, Lane, LanesAt};

/// Four steps: states at their starts, unknowns, intervals. Steps beyond `count` repeat the last one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Steps<'a> {
    pub(super) x: [&'a [f64]; LANES],
    pub(super) y: [&'a [f64]; LANES],
    pub(super) interval: [Interval<'a>; LANES],
    pub(super) count: usize,
}

/// Scratch of one thread.
pub(super) struct LaneScratch {
    q: Vec<Lane>,
    v: Vec<Lane>,
    a: Vec<Lane>,
    u: Vec<Lane>,
    r: Vec<Lane>,
    lambda: Vec<Lane>,
    jacobian: Vec<Lane>,
    hessian: Vec<Lane>,
    /// Values of four steps.
    values: Vec<Lane>,
    /// Position of the four steps among those of this scratch, and the memory of their evaluations.
    pub(super) slot: usize,
    remembered: Vec<SolvedLanes>,
    work: LaneWork,
    /// Sum over the steps of the entries between parameters.
    parameter_hessian: Vec<Lane>,
    /// Coefficients for the step lengths they were made for.
    h: Lane,
    powers: [[f64; POWERS]; LANES],
    jacobian_factors: Vec<Lane>,
    hessian_factors: Vec<Lane>,
}

impl LaneScratch {
    /// Empties the sum of the entries between parameters.
    pub(super) fn clear_parameter_hessian(&mut self) {
        self.parameter_hessian.fill([0.0; LANES]);
    }

    /// Adds that sum.
    pub(super) fn add_parameter_hessian(&self, out: &mut [f64]) {
        for (out, value) in out.iter_mut().zip(&self.parameter_hessian) {
            *out += value.iter().sum::<f64>();
        }
    }
}

/// `out[entry] += factor · values[source]`.
#[inline(always)]
fn scatter<S: Simd>(
    simd: S,
    contributions: &[Contribution],
    factors: &[Lane],
    values: &[Lane],
    out: &mut [Lane],
) {
    for (c, factor) in contributions.iter().zip(factors) {
        let out = &mut out[c.entry as usize];
        let value = load(simd, &values[c.source as usize]);
        *out = value.mul_add(load(simd, factor), load(simd, out)).into();
    }
}

fn zeros(n: usize) -> Vec<Lane> {
    vec![[0.0; LANES]; n]
}

impl Rule<'_> {
    pub(super) fn lane_scratch(&self) -> LaneScratch {
        let dims = self.model.dims();
        let expansion = &self.expansion;
        let entries = expansion.step_jacobian.len();
        let size = entries.max(expansion.step_hessian.len()).max(self.ny());
        LaneScratch {
            q: zeros(dims.nq),
            v: zeros(dims.nq),
            a: zeros(dims.nq),
            u: zeros(dims.nu),
            r: zeros(dims.nq),
            lambda: zeros(dims.nq),
            jacobian: zeros(self.model.jacobian_pattern().nnz()),
            hessian: zeros(self.model.hessian_pattern().nnz()),
            values: zeros(size),
            slot: 0,
            remembered: Vec::new(),
            work: LaneWork::default(),
            parameter_hessian: zeros(expansion.parameter_hessian.len()),
            h: [f64::NAN; LANES],
            powers: [[0.0; POWERS]; LANES],
            jacobian_factors: Vec::new(),
            hessian_factors: Vec::new(),
        }
    }

    /// Where evaluation `e` of the scratch's steps is remembered.
    fn remembered_lanes(&self, e: usize, s: &mut LaneScratch) -> usize {
        if self.solved.is_none() {
            return 0;
        }
        let place = s.slot * self.tableau.evaluations.len() + e;
        if s.remembered.len() <= place {
            s.remembered.resize(place + 1, SolvedLanes::default());
        }
        place
    }

    fn combine_lanes(
        &self,
        terms: &[Term],
        steps: &Steps<'_>,
        powers: &[[f64; POWERS]; LANES],
        out: &mut [Lane],
    ) {
        out.fill([0.0; LANES]);
        let nq = self.nq;
        for term in terms {
            for l in 0..LANES {
                let block = match term.block {
                    Block::Q0 => &steps.x[l][..nq],
                    Block::V0 => &steps.x[l][nq..2 * nq],
                    other => {
                        let at = self.tableau.position(other, nq) - 2 * nq;
                        &steps.y[l][at..at + nq]
                    }
                };
                let c = term.coefficient * pow(&powers[l], term.power);
                for (o, b) in out.iter_mut().zip(block) {
                    o[l] += c * b;
                }
            }
        }
    }

    /// Arguments of evaluation `e` of the steps, into the scratch.
    fn arguments_lanes(&self, e: usize, steps: &Steps<'_>, s: &mut LaneScratch, derivatives: bool) {
        let evaluation = &self.tableau.evaluations[e];
        self.combine_lanes(&evaluation.q, steps, &s.powers, &mut s.q);
        self.combine_lanes(&evaluation.v, steps, &s.powers, &mut s.v);
        // With accelerations solved for, derivatives are those of the solution and do not depend on a.
        if !derivatives || self.solved.is_none() {
            self.combine_lanes(&evaluation.a, steps, &s.powers, &mut s.a);
        }
        for (l, interval) in steps.interval.iter().enumerate() {
            for (j, u) in s.u.iter_mut().enumerate() {
                u[l] = self.input(interval, evaluation.u, j);
            }
        }
    }

    /// Fills the powers of the step lengths and the factors of all contributions.
    fn prepare_lanes(&self, steps: &Steps<'_>, s: &mut LaneScratch) {
        let h = steps.interval.map(|i| i.h);
        if s.h == h {
            return;
        }
        s.h = h;
        s.powers = h.map(powers);
        let powers = s.powers;
        let factor = |c: &Contribution| powers.map(|p| c.coefficient * pow(&p, c.power));
        s.jacobian_factors.clear();
        s.hessian_factors.clear();
        let rows = self.model.jacobian_pattern().rows;
        let evaluations = self.expansion.evaluations.iter();
        for (map, evaluation) in evaluations.zip(&self.tableau.evaluations) {
            s.jacobian_factors.extend(map.jacobian.iter().map(|c| {
                let (row, of) = (rows[c.source as usize] as usize, factor(c));
                std::array::from_fn(|l| evaluation.weight * of[l] * self.row_scale(row, h[l]))
            }));
            s.hessian_factors.extend(map.hessian.iter().map(factor));
            s.hessian_factors
                .extend(map.parameter_hessian.iter().map(factor));
        }
    }

    /// c(x, y, p) of the steps, one after another; `p` in the model's units.
    pub(super) fn constraints_lanes(
        &self,
        steps: &Steps<'_>,
        p: &[f64],
        s: &mut LaneScratch,
        c: &mut [f64],
    ) {
        let (nq, ny) = (self.nq, self.ny());
        self.prepare_lanes(steps, s);
        let mut values = std::mem::take(&mut s.values);
        let (linear, dynamic) = values[..ny].split_at_mut(self.tableau.linear.len() * nq);
        for (terms, out) in self.tableau.linear.iter().zip(linear.chunks_exact_mut(nq)) {
            self.combine_lanes(terms, steps, &s.powers, out);
        }
        dynamic.fill([0.0; LANES]);
        for (e, evaluation) in self.tableau.evaluations.iter().enumerate() {
            self.arguments_lanes(e, steps, s, false);
            let place = self.remembered_lanes(e, s);
            let at = LanesAt {
                q: &s.q,
                v: &s.v,
                a: &s.a,
                u: &s.u,
                p,
            };
            match self.solved {
                Some(form) => {
                    let known = &mut s.remembered[place];
                    form.residual_of_lanes(&at, known, &mut s.work, &mut s.r);
                }
                None => self.model.residual_lanes(&at, &mut s.r),
            }
            let out = &mut dynamic[evaluation.group * nq..][..nq];
            for (j, (out, r)) in out.iter_mut().zip(&s.r).enumerate() {
                for l in 0..LANES {
                    out[l] += evaluation.weight * self.row_scale(j, s.h[l]) * r[l];
                }
            }
        }
        widest!(simd => unpack(simd, &values[..ny], steps.count, c));
        s.values = values;
    }

    /// ∂c/∂(x, y, p) of the steps, one after another, at the entries of the expansion's `step_jacobian`.
    pub(super) fn jacobian_lanes(
        &self,
        steps: &Steps<'_>,
        p: &[f64],
        s: &mut LaneScratch,
        out: &mut [f64],
    ) {
        self.prepare_lanes(steps, s);
        let mut values = std::mem::take(&mut s.values);
        let entries = &mut values[..self.expansion.step_jacobian.len()];
        entries.fill([0.0; LANES]);
        for &(entry, coefficient, power) in &self.expansion.linear {
            for l in 0..LANES {
                entries[entry as usize][l] += coefficient * pow(&s.powers[l], power);
            }
        }
        let mut first = 0;
        for (e, map) in self.expansion.evaluations.iter().enumerate() {
            self.arguments_lanes(e, steps, s, true);
            let place = self.remembered_lanes(e, s);
            let at = LanesAt {
                q: &s.q,
                v: &s.v,
                a: &s.a,
                u: &s.u,
                p,
            };
            match self.solved {
                Some(form) => {
                    let known = &mut s.remembered[place];
                    form.jacobian_of_lanes(&at, known, &mut s.work, &mut s.jacobian);
                }
                None => self
                    .model
                    .residual_jacobian_lanes(&at, &mut s.r, &mut s.jacobian),
            }
            let factors = &s.jacobian_factors[first..first + map.jacobian.len()];
            widest!(simd => scatter(simd, &map.jacobian, factors, &s.jacobian, entries));
            first += map.jacobian.len();
        }
        widest!(simd => unpack(simd, entries, steps.count, out));
        s.values = values;
    }

    /// Hess(λᵀc) of the steps, one after another, at the entries of the expansion's `step_hessian`;
    /// entries between parameters are added to the scratch's. `lambda` has the rows of the steps
    /// one after another.
    pub(super) fn hessian_lanes(
        &self,
        steps: &Steps<'_>,
        p: &[f64],
        lambda: &[f64],
        s: &mut LaneScratch,
        out: &mut [f64],
    ) {
        self.prepare_lanes(steps, s);
        let (nq, ny) = (self.nq, self.ny());
        let mut values = std::mem::take(&mut s.values);
        // Outputs that are not the state have entries of their own behind those of the steps.
        let size = out.len() / steps.count;
        values.resize(values.len().max(size), [0.0; LANES]);
        let entries = &mut values[..size];
        entries.fill([0.0; LANES]);
        let dynamic = self.tableau.linear.len() * nq;
        let mut first = 0;
        for (e, map) in self.expansion.evaluations.iter().enumerate() {
            self.arguments_lanes(e, steps, s, true);
            let evaluation = &self.tableau.evaluations[e];
            s.lambda.fill([0.0; LANES]);
            for (l, lambda) in lambda.chunks_exact(ny).enumerate() {
                let group = &lambda[dynamic + evaluation.group * nq..][..nq];
                for (j, (to, lambda)) in s.lambda.iter_mut().zip(group).enumerate() {
                    to[l] = evaluation.weight * self.row_scale(j, s.h[l]) * lambda;
                }
            }
            let place = self.remembered_lanes(e, s);
            let at = LanesAt {
                q: &s.q,
                v: &s.v,
                a: &s.a,
                u: &s.u,
                p,
            };
            let hessian: &[Lane] = match self.solved {
                Some(form) => {
                    let known = &mut s.remembered[place];
                    form.hessian_of_lanes(&at, &s.lambda, known, &mut s.work)
                }
                None => {
                    self.model
                        .residual_hessian_lanes(&at, &s.lambda, &mut s.hessian);
                    &s.hessian
                }
            };
            let (own, between) = (map.hessian.len(), map.parameter_hessian.len());
            let factors = &s.hessian_factors[first..first + own + between];
            let sum = &mut s.parameter_hessian;
            widest!(simd => {
                scatter(simd, &map.hessian, &factors[..own], hessian, entries);
                scatter(simd, &map.parameter_hessian, &factors[own..], hessian, sum);
            });
            first += own + between;
        }
        widest!(simd => unpack(simd, entries, steps.count, out));
        s.values = values;
    }
}
