//! The KKT system of a full discretization by segmented condensing.
//!
//! 1. Every segment of some ten steps is condensed onto its first state and the parameters, in
//!    parallel.
//! 2. The coarse system over the segment starts x_s and the multipliers ν_s of the links
//!    `x_{s+1} = end(x_s, p)` goes to sparse LDLᵀ; its Schur complement S in the free parameters is
//!    dense.
//! 3. Inertia. Eliminated pairs are right by construction. The coarse part must have one negative
//!    eigenvalue a link, else the initial states are regularised (the condensing is not repeated).
//!    S becomes positive definite: its negative eigenvalues change sign, those near zero are
//!    lifted.
//!
//! The last step replaces repeated trial factorizations by one symmetric eigenvalue problem of the
//! size of p and moves only directions of wrong curvature (reflection: Y. Dauphin et al. 2014,
//! "saddle-free Newton"; here on the reduced Hessian).

mod coarse;
mod conjugate;
mod group;
mod plan;
mod reduced;
mod refine;
mod small;

use super::layout::Layout;
use super::ldl::SparseLdl;
use super::{Condensing, Kkt, KktError, KktValues, Regularisation};
use faer::Mat;
use group::{Group, Segment};
use pid_lanes::{LANES, Lane};
use plan::{Plan, Sizes};
use rayon::prelude::*;
use reduced::Reduced;

/// Continuity rows get −1e-9 I for a stable factorization, which refinement removes. Where the
/// curvature of the next state is large, this is not small: refinement removes only tenths of it,
/// and a defect that is costly to close is closed in part. Far from the solution that saves
/// iterations. Near the solution of a long record we divide it by that curvature, so that Newton's
/// method stays quadratic (docs/experiments.md, Solver).
const STATIC: f64 = 1e-9;
/// The solution is near below this optimality error, and a record is long from so many steps on. On
/// shorter records the smaller regularisation gains nothing, and loses where motions grow (an arm
/// with indefinite inertias at 400 samples, shooting from 5 nodes).
const NEAR: f64 = 0.1;
const LONG: usize = 30_000;
/// Relative residual at which refinement ends.
const REFINED: f64 = 1e-11;
/// On long records near the optimum, conjugate residuals improve a refined solution whose relative
/// residual exceeds this.
const CRUDE: f64 = 1e-9;
/// Segments are cut where a state grows by more than 1e4 over one; they then have a growth of at
/// most 1e2, and their full length again once it would grow by less than 1e3. The condensed cost
/// has the square of the growth, and so have its rounding errors. Where an iterate has an
/// indefinite mass matrix, states grow by 30 a step and more. With a limit of 1e9 such a model does
/// not converge (docs/experiments.md, Solver).
const GROWTH: f64 = 1e4;
const AIM: f64 = 1e2;
const LITTLE: f64 = 1e3;
/// Below this many steps the segments are condensed by the calling thread.
const PARALLEL_STEPS: usize = 1500;

/// Segmented condensing; see the module's documentation.
pub struct StructuredKkt {
    layout: Layout,
    plan: Plan,
    sizes: Sizes,
    /// Position of each parameter among the free ones.
    columns: Vec<Option<u32>>,
    groups: Vec<Group>,
    /// Coarse position of each segment's start state (`None` if held) and of the link after it
    /// (`None` at window ends).
    start_at: Vec<Option<usize>>,
    link_at: Vec<Option<usize>>,
    links: usize,
    ldl: SparseLdl,
    /// Static regularisation of the coarse rows, zero except for links, and whether it shrinks with
    /// stiff links.
    shifts: Vec<f64>,
    whole: bool,
    /// K_xx⁻¹ K_xp and K_xp, row by row, coarse_n × wp; and the work space of refinement.
    z: Vec<f64>,
    kxp: Vec<f64>,
    correction: Vec<f64>,
    /// K_px K_xx⁻¹ K_xp, np × wp.
    product: Vec<f64>,
    /// `np`, rounded up for vector units.
    wp: usize,
    /// Reduced Hessian in the free parameters, made convex.
    reduced: Reduced,
    /// Relative residual at which refinement ends.
    refined: f64,
    delta_x: f64,
    last_delta: f64,
    fixed: Vec<bool>,
    /// Steps of a segment: now, as asked for, and for the next factorization.
    steps: usize,
    asked: usize,
    next: usize,
    /// Growth of a state over a segment above which segments become shorter.
    limit: f64,
    /// Hessian of the states' diagonal and of the parameters; the steps' values are with their groups.
    diagonal: Vec<f64>,
    sigma: Vec<f64>,
    residual_x: Vec<f64>,
    residual_c: Vec<f64>,
    step_x: Vec<f64>,
    step_c: Vec<f64>,
    /// Per solve: parameters' right-hand side and step, coarse right-hand side, states and
    /// multipliers of four segments, and one step's part of a product.
    rp: Vec<f64>,
    dp: Vec<f64>,
    rhs: Vec<f64>,
    states: Vec<Lane>,
    local: Vec<Lane>,
    coarse: Vec<f64>,
    coarse_correction: Vec<f64>,
}

impl StructuredKkt {
    /// Plans the condensing. `fixed_parameters` has one entry per parameter; `segment_steps` is the
    /// length aimed at (10 to 20 serves; shorter for plants that are very unstable over one
    /// segment).
    pub fn new(layout: Layout, fixed_parameters: &[bool], segment_steps: usize) -> Self {
        let mut columns = Vec::with_capacity(layout.np);
        let mut np = 0u32;
        for &fixed in fixed_parameters {
            columns.push((!fixed).then_some(np));
            np += u32::from(!fixed);
        }
        let np = np as usize;
        let plan = Plan::new(&layout, &columns, np);
        let sizes = plan.sizes;
        let wp = np.next_multiple_of(4);
        let mut segments = Vec::new();
        let (mut start_at, mut link_at) = (Vec::new(), Vec::new());
        let (mut coarse_n, mut links) = (0, 0);
        for &window in &layout.windows {
            let count = window.steps.div_ceil(segment_steps.max(1)).max(1);
            for s in 0..count {
                let (from, to) = (s * window.steps / count, (s + 1) * window.steps / count);
                segments.push(Segment {
                    window,
                    start: from,
                    len: to - from,
                });
                let held = s == 0 && window.held;
                start_at.push((!held).then_some(coarse_n));
                coarse_n += if held { 0 } else { layout.nx };
                let last = s + 1 == count;
                link_at.push((!last).then_some(coarse_n));
                coarse_n += if last { 0 } else { layout.nx };
                links += if last { 0 } else { layout.nx };
            }
        }
        let groups = segments.chunks(LANES);
        let groups = groups.map(|s| Group::new(&plan, &layout, s)).collect();
        let (n, m) = (layout.n(), layout.m());
        let mut kkt = Self {
            plan,
            sizes,
            columns,
            groups,
            start_at,
            link_at,
            links,
            ldl: SparseLdl::new(0, &[]),
            shifts: vec![0.0; coarse_n],
            whole: false,
            z: vec![0.0; coarse_n * wp],
            kxp: vec![0.0; coarse_n * wp],
            correction: vec![0.0; coarse_n * wp],
            product: vec![0.0; np * wp],
            wp,
            reduced: Reduced::new(np),
            refined: REFINED,
            delta_x: 0.0,
            last_delta: 0.0,
            fixed: fixed_parameters.to_vec(),
            steps: segment_steps.max(1),
            asked: segment_steps.max(1),
            next: segment_steps.max(1),
            limit: GROWTH,
            diagonal: vec![0.0; layout.nodes() * layout.nx + layout.parameter_hessian.len()],
            sigma: vec![0.0; n],
            residual_x: vec![0.0; n],
            residual_c: vec![0.0; m],
            step_x: vec![0.0; n],
            step_c: vec![0.0; m],
            rp: vec![0.0; np],
            dp: vec![0.0; np],
            rhs: vec![0.0; coarse_n],
            states: vec![[0.0; LANES]; 2 * layout.nx],
            local: Vec::new(),
            coarse: vec![0.0; coarse_n],
            coarse_correction: vec![0.0; coarse_n],
            layout,
        };
        let mut triplets = Vec::new();
        kkt.coarse_entries(|row, col, _| triplets.push((row as u32, col as u32)));
        kkt.ldl = SparseLdl::new(coarse_n, &triplets);
        kkt
    }

    /// Sets the growth of states over a segment from which segments become shorter (default 1e4).
    pub fn growing_to(mut self, factor: f64) -> Self {
        self.limit = factor;
        self
    }

    /// Sets the relative residual to which solutions are refined (default 1e-11).
    pub fn refined_to(mut self, residual: f64) -> Self {
        self.refined = residual;
        self
    }

    /// Plans anew for segments of another length.
    fn cut(&mut self, steps: usize) {
        let mut fresh = Self::new(self.layout.clone(), &self.fixed, steps);
        fresh.reduced.smallest = self.reduced.smallest;
        *self = Self {
            refined: self.refined,
            whole: self.whole,
            last_delta: self.last_delta,
            asked: self.asked,
            limit: self.limit,
            ..fresh
        };
    }

    /// The largest growth of a state over a segment, and per step; infinite if it is no number.
    fn growth(&self) -> (f64, f64) {
        let Sizes { nx, w, .. } = self.sizes;
        let (mut largest, mut rate) = (0.0_f64, 1.0_f64);
        for group in &self.groups {
            for (l, segment) in group.segments.iter().enumerate() {
                let entries = (0..nx).flat_map(|i| &group.c[i * w..i * w + nx]);
                let growth = entries.fold(0.0_f64, |a, c| {
                    let c = c[l].abs();
                    a.max(if c.is_nan() { f64::INFINITY } else { c })
                });
                largest = largest.max(growth);
                rate = rate.max(growth.powf(1.0 / segment.len as f64));
            }
        }
        (largest, rate)
    }

    /// Condenses and factorises the coarse matrix, with shorter segments where states grow too much over one.
    fn eliminate(&mut self, values: &KktValues<'_>) -> Result<(f64, usize), KktError> {
        if self.next != self.steps {
            self.cut(self.next);
        }
        loop {
            let nodes = self.layout.node_values();
            self.diagonal.copy_from_slice(&values.hessian[nodes..]);
            self.sigma.copy_from_slice(values.sigma);
            self.condense(values)?;
            let (growth, rate) = self.growth();
            let within = (AIM.ln() / rate.ln()).max(1.0) as usize;
            let shorter = within.clamp(1, (self.steps / 2).max(1));
            if growth > self.limit && self.steps > 1 {
                self.cut(shorter);
                continue;
            }
            match self.factorise_coarse() {
                Err(_) if self.steps > 1 => self.cut(shorter),
                outcome => {
                    // Takes effect the next time, since this factorization is still in use.
                    if rate.powf(self.asked as f64) < LITTLE {
                        self.next = self.asked;
                    }
                    return outcome;
                }
            }
        }
    }

    fn condense(&mut self, values: &KktValues<'_>) -> Result<(), KktError> {
        let (plan, layout) = (&self.plan, &self.layout);
        let one = |group: &mut Group| {
            group.load(layout, values);
            group.condense(plan, layout, values)
        };
        if layout.steps() < PARALLEL_STEPS {
            self.groups.iter_mut().try_for_each(one)
        } else {
            self.groups.par_iter_mut().try_for_each(one)
        }
    }

    /// One pass without refinement: `step_x`, `step_c` from `residual_x`, `residual_c` as right-hand side.
    fn solve_once(&mut self) {
        let nx = self.sizes.nx;
        let (sizes, layout) = (self.sizes, &self.layout);
        let parallel = layout.steps() >= PARALLEL_STEPS;
        let (rx, rc) = (&self.residual_x, &self.residual_c);
        if parallel {
            self.groups
                .par_iter_mut()
                .for_each(|g| g.reduce(sizes, layout, rx, rc));
        } else {
            self.groups
                .iter_mut()
                .for_each(|g| g.reduce(sizes, layout, rx, rc));
        }
        let p_at = layout.p();
        let (rp, rhs) = (&mut self.rp, &mut self.rhs);
        for (j, column) in self.columns.iter().enumerate() {
            if let Some(i) = column {
                rp[*i as usize] = rx[p_at + j];
            }
        }
        for group in &self.groups {
            for (r, p) in rp.iter_mut().zip(&group.p_lin) {
                *r -= p.iter().sum::<f64>();
            }
        }
        for s in 0..self.start_at.len() {
            let (group, l) = (&self.groups[s / LANES], s % LANES);
            for i in 0..nx {
                if let Some(x) = self.start_at[s] {
                    rhs[x + i] = -group.v_lin[i][l];
                }
                if let Some(link) = self.link_at[s] {
                    rhs[link + i] = -group.c_lin[i][l];
                }
            }
        }
        Self::coarse_solve(
            &mut self.ldl,
            &self.shifts,
            rhs,
            &mut self.coarse,
            &mut self.coarse_correction,
            1,
        );
        let wp = self.wp;
        for (c, k) in self.coarse.iter().zip(self.kxp.chunks_exact(wp.max(1))) {
            for (r, k) in rp.iter_mut().zip(k) {
                *r -= k * c;
            }
        }
        let (layout, dp) = (&self.layout, &mut self.dp);
        self.reduced.solve(&self.rp, dp);
        for (c, z) in self.coarse.iter_mut().zip(self.z.chunks_exact(wp.max(1))) {
            *c -= z.iter().zip(dp.iter()).map(|(z, d)| z * d).sum::<f64>();
        }
        self.step_x.fill(0.0);
        for (j, column) in self.columns.iter().enumerate() {
            if let Some(i) = column {
                self.step_x[p_at + j] = dp[*i as usize];
            }
        }
        let (x, nu) = self.states.split_at_mut(nx);
        for (g, group) in self.groups.iter_mut().enumerate() {
            x.fill([0.0; LANES]);
            nu.fill([0.0; LANES]);
            for l in 0..group.segments.len() {
                let (start, link) = (self.start_at[g * LANES + l], self.link_at[g * LANES + l]);
                for i in 0..nx {
                    x[i][l] = start.map_or(0.0, |c| self.coarse[c + i]);
                    nu[i][l] = link.map_or(0.0, |c| self.coarse[c + i]);
                }
            }
            let to = (self.step_x.as_mut_slice(), self.step_c.as_mut_slice());
            group.expand(sizes, layout, (x, dp, nu), to);
        }
        // The end of a segment is the start of the next one, as the coarse system has it.
        let segments = self.groups.iter().flat_map(|g| &g.segments);
        for (segment, start) in segments.zip(&self.start_at) {
            let at = layout.state(&segment.window, segment.start);
            for i in 0..nx {
                self.step_x[at + i] = start.map_or(0.0, |c| self.coarse[c + i]);
            }
        }
    }
}

impl Condensing for StructuredKkt {
    fn reduced_hessian(&self) -> (&Mat<f64>, Vec<usize>) {
        let free = (0..self.columns.len())
            .filter(|&j| self.columns[j].is_some())
            .collect();
        (&self.reduced.hessian, free)
    }
}

impl Kkt for StructuredKkt {
    fn expect_error(&mut self, error: f64) {
        self.whole = error <= NEAR && self.layout.steps() >= LONG;
        self.reduced.expect_error(error);
    }

    fn limit(&mut self, radius: f64) -> Option<f64> {
        self.reduced.limit(radius)
    }

    fn remember(&mut self, dx: &[f64]) {
        let p = self.layout.p();
        for (j, column) in self.columns.iter().enumerate() {
            if let Some(i) = column {
                self.dp[*i as usize] = dx[p + j];
            }
        }
        self.reduced.remember(&self.dp);
    }

    fn factorise(&mut self, values: KktValues<'_>) -> Result<Regularisation, KktError> {
        self.reduced.unlimited();
        if !values
            .hessian
            .iter()
            .chain(values.jacobian)
            .all(|v| v.is_finite())
        {
            return Err(KktError::NotFinite);
        }
        let (delta_x, factorizations) = self.eliminate(&values)?;
        self.delta_x = delta_x;
        self.reduce_to_parameters();
        let shift = self.reduced.convexify()?;
        Ok(Regularisation {
            delta_x,
            shift,
            delta_c: 0.0,
            factorizations,
        })
    }

    fn solve(&mut self, rx: &[f64], rc: &[f64], dx: &mut [f64], dlambda: &mut [f64]) -> f64 {
        let relative = self.refine(rx, rc, dx, dlambda);
        if self.whole && relative > CRUDE {
            return self.conjugate(rx, rc, dx, dlambda);
        }
        relative
    }
}

#[cfg(test)]
mod tests;
