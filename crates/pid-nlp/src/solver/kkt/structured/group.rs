//! Condensing of runs of steps onto their first states and the parameters, four runs (segments) at a time.
//!
//! Within a segment the pairs (y_k, λ_k) are eliminated from the last step to the first. Kinematic
//! rows are substituted ([`super::plan`]); of the rest, `B z + A x + P p = …` with B regular,
//! follow `z = T (x, p) + t` with `T = −B⁻¹ [A P]`. Every pair has inertia (ny, ny, 0) whatever the
//! Hessian is. What is left of the segment is a quadratic in (x_start, p) and the affine map to its
//! end state. Growth of rounding errors is bounded by that of the dynamics over one segment.
//!
//! With the next state `x' = E x + S z + e`, `W` the Hessian of the cost-to-go with respect to x'
//! (the step's own part included) and `F` that of the step between x' and the rest, one step of the
//! recursion is
//!
//! ```text
//! M = H_zz + Sᵀ F_z + F_zᵀ S + Sᵀ W S          N = [H_zx + Sᵀ F_x + F_zᵀ E + Sᵀ W E,  H_zp + Sᵀ W_p]
//! Q = [H_xx + Eᵀ F_x + F_xᵀ E + Eᵀ W E,  H_xp + Eᵀ W_p]
//! V = Q + Tᵀ N + Nᵀ T + Tᵀ M T
//! ```
//!
//! The same operations serve four segments in the lanes of one vector; shorter ones, and the empty
//! places of the last group, go on with steps `x' = x` without cost.

mod condense;
mod solve;

use super::super::layout::{Layout, Window};
use super::super::{KktError, KktValues};
use super::plan::{Plan, Sizes, Target};
use condense::{Products, Quadratic, Singular, unpack};
use pid_lanes::kernel::{Simd, SimdFloat, all, load, widest};
use pid_lanes::{LANES, Lane};
use std::array::from_fn;

const ZERO: Lane = [0.0; LANES];

/// A run of steps of one window.
#[derive(Debug, Clone, Copy)]
pub(super) struct Segment {
    pub(super) window: Window,
    /// First step, counted in the window.
    pub(super) start: usize,
    pub(super) len: usize,
}

impl Segment {
    /// Whether the window ends with this segment.
    fn last(&self) -> bool {
        self.start + self.len == self.window.steps
    }
}

/// Up to four segments.
pub(super) struct Group {
    pub(super) segments: Vec<Segment>,
    steps: Vec<Step>,
    /// Cost-to-go at the first states: [V_xx V_xp], nx × w.
    pub(super) v: Vec<Lane>,
    /// Contribution to the Hessian of the parameters, upper triangle, np × np.
    pub(super) kpp: Vec<Lane>,
    /// End states as maps of (x_start, p), nx × w.
    pub(super) c: Vec<Lane>,
    /// Per solve: linear terms at the first states, of the parameters, and offsets of the end states.
    pub(super) v_lin: Vec<Lane>,
    pub(super) p_lin: Vec<Lane>,
    pub(super) c_lin: Vec<Lane>,
    /// Values of the steps, in the order of the layout's patterns.
    hessian: Vec<Lane>,
    jacobian: Vec<Lane>,
    work: Vec<Lane>,
    /// [V C] of the step before, and small products.
    next: Vec<Lane>,
    small: Vec<Lane>,
}

/// Matrices that a solve needs of one step.
struct Step {
    /// `T`, nz × w.
    t: Vec<Lane>,
    /// `M T + N`, nz × w.
    g: Vec<Lane>,
    /// `M`, nz × nz.
    m: Vec<Lane>,
    /// LU factors of B with the inverse of its diagonal, and its row permutation.
    lu: Vec<Lane>,
    pivots: Vec<[u8; LANES]>,
    /// E and S, nx × nx and nx × nz.
    e: Vec<Lane>,
    s: Vec<Lane>,
    /// Inverse diagonal of the substituted rows, ne.
    r: Vec<Lane>,
    /// Core rows with respect to x'_e, nz × ne.
    d: Vec<Lane>,
    /// Rows e of [W W_p] and of F with respect to z and x.
    we: Vec<Lane>,
    fz: Vec<Lane>,
    fx: Vec<Lane>,
    /// Map from the state after the step to the end state, nx × nx.
    end: Vec<Lane>,
    /// Per solve: t, e, gradient with respect to z, gradient of the cost-to-go at x'.
    offset: Vec<Lane>,
    shift: Vec<Lane>,
    gradient: Vec<Lane>,
    ahead: Vec<Lane>,
}

fn zeros(n: usize) -> Vec<Lane> {
    vec![ZERO; n]
}

impl Step {
    fn new(s: Sizes) -> Self {
        let Sizes { nx, w, ne, nz, .. } = s;
        Self {
            t: zeros(nz * w),
            g: zeros(nz * w),
            m: zeros(nz * nz),
            lu: zeros(nz * nz),
            pivots: vec![[0; LANES]; nz],
            e: zeros(nx * nx),
            s: zeros(nx * nz),
            r: zeros(ne),
            d: zeros(nz * ne),
            we: zeros(ne * w),
            fz: zeros(ne * nz),
            fx: zeros(ne * nx),
            end: zeros(nx * nx),
            offset: zeros(nz),
            shift: zeros(ne),
            gradient: zeros(nz),
            ahead: zeros(nx),
        }
    }
}

/// Places of four steps in vectors of the problem; `None` for lanes without a step.
type Places = [Option<usize>; LANES];

/// Component `i` behind each place, 0 where there is none.
#[inline(always)]
fn pick(values: &[f64], places: &Places, i: usize) -> Lane {
    from_fn(|l| places[l].map_or(0.0, |at| values[at + i]))
}

/// Adds component `i` behind each place.
#[inline(always)]
fn put(values: &mut [f64], places: &Places, i: usize, lane: Lane) {
    for (at, x) in places.iter().zip(lane) {
        if let Some(at) = at {
            values[at + i] += x;
        }
    }
}

/// Sets component `i` behind each place.
#[inline(always)]
fn set(values: &mut [f64], places: &Places, i: usize, lane: Lane) {
    for (at, x) in places.iter().zip(lane) {
        if let Some(at) = at {
            values[at + i] = x;
        }
    }
}

/// Packs runs of `n` values behind four places into lanes.
#[inline(always)]
fn pack(values: &[f64], places: &Places, n: usize, out: &mut [Lane]) {
    if let [Some(a), Some(b), Some(c), Some(d)] = *places {
        let (a, b) = (&values[a..a + n], &values[b..b + n]);
        let (c, d) = (&values[c..c + n], &values[d..d + n]);
        for (i, out) in out[..n].iter_mut().enumerate() {
            *out = [a[i], b[i], c[i], d[i]];
        }
        return;
    }
    for (i, out) in out[..n].iter_mut().enumerate() {
        *out = pick(values, places, i);
    }
}

/// Adds the values of four steps to the workspace.
#[inline(always)]
fn scatter<S: Simd>(simd: S, targets: &[Target], values: &[Lane], work: &mut [Lane]) {
    for t in targets {
        let value = load(simd, &values[t.value as usize]);
        let to = &mut work[t.at as usize];
        *to = value.mul_add(all(simd, t.sign), load(simd, to)).into();
    }
}

/// `Σ a_i b_i` over rows of `a` and columns of `b` that begin at the given places and go on with
/// the given strides.
#[inline(always)]
fn dot<S: Simd>(simd: S, n: usize, (a, da): (&[Lane], usize), (b, db): (&[Lane], usize)) -> Lane {
    let mut sum = all(simd, 0.0);
    for k in 0..n {
        sum = load(simd, &a[k * da]).mul_add(load(simd, &b[k * db]), sum);
    }
    sum.into()
}

#[inline(always)]
fn add<S: Simd>(simd: S, a: &Lane, b: &Lane) -> Lane {
    (load(simd, a) + load(simd, b)).into()
}

#[inline(always)]
fn mul<S: Simd>(simd: S, a: &Lane, b: &Lane) -> Lane {
    (load(simd, a) * load(simd, b)).into()
}

impl Group {
    pub(super) fn new(plan: &Plan, layout: &Layout, segments: &[Segment]) -> Self {
        let Sizes { nx, np, w, nz, .. } = plan.sizes;
        let len = segments.iter().map(|s| s.len).max().unwrap_or(0);
        Self {
            segments: segments.to_vec(),
            steps: (0..len).map(|_| Step::new(plan.sizes)).collect(),
            v: zeros(nx * w),
            kpp: zeros(np * np),
            c: zeros(nx * w),
            v_lin: zeros(nx),
            p_lin: zeros(np),
            c_lin: zeros(nx),
            hessian: zeros(len * layout.step_hessian.len()),
            jacobian: zeros(len * layout.step_jacobian.len()),
            work: zeros(plan.offsets.len.max(2 * nz + 2 * nx)),
            next: zeros(nx * w + nz * w),
            small: zeros(nx * (2 * nx + nz)),
        }
    }

    /// Where something of step `k` of each segment begins.
    fn places(&self, k: usize, at: impl Fn(&Segment) -> usize) -> Places {
        places(&self.segments, k, at)
    }

    /// Takes over the steps' values.
    pub(super) fn load(&mut self, layout: &Layout, values: &KktValues<'_>) {
        let (nj, nh) = (layout.step_jacobian.len(), layout.step_hessian.len());
        for k in 0..self.steps.len() {
            let step = |s: &Segment| s.window.first_step + s.start + k;
            let at = self.places(k, |s| step(s) * nj);
            pack(values.jacobian, &at, nj, &mut self.jacobian[k * nj..]);
            let at = self.places(k, |s| step(s) * nh);
            pack(values.hessian, &at, nh, &mut self.hessian[k * nh..]);
        }
    }

    /// Eliminates the segments' pairs. The steps' values are those of the last [`Group::load`];
    /// `values` gives the rest.
    pub(super) fn condense(
        &mut self,
        plan: &Plan,
        layout: &Layout,
        values: &KktValues<'_>,
    ) -> Result<(), KktError> {
        widest!(simd => self.condense_with(simd, plan, layout, values))
    }

    #[inline(always)]
    fn condense_with<S: Simd>(
        &mut self,
        simd: S,
        plan: &Plan,
        layout: &Layout,
        values: &KktValues<'_>,
    ) -> Result<(), KktError> {
        let sizes = plan.sizes;
        let Sizes { nx, w, nz, .. } = sizes;
        let ns = sizes.ns();
        let (nj, nh) = (layout.step_jacobian.len(), layout.step_hessian.len());
        self.kpp.fill(ZERO);
        self.v.fill(ZERO);
        self.c.fill(ZERO);
        for i in 0..nx {
            self.c[i * w + i] = [1.0; LANES];
        }
        let node_values = layout.node_values();
        let node_diagonal = |s: &Segment, k: usize, i: usize| {
            values.hessian[node_values + (s.window.first_node + k) * nx + i]
                + values.sigma[layout.state(&s.window, k) + i]
        };
        for (l, s) in self.segments.iter().enumerate().filter(|(_, s)| s.last()) {
            for i in 0..nx {
                self.v[i * w + i][l] = node_diagonal(s, s.window.steps, i);
            }
        }
        let (next, f) = self.next.split_at_mut(nx * w);
        let mut products = Products::new(sizes, &mut self.small);
        let segments = &self.segments;
        for k in (0..self.steps.len()).rev() {
            let (step, work) = (&mut self.steps[k], &mut self.work);
            let own = (
                &self.jacobian[k * nj..(k + 1) * nj],
                &self.hessian[k * nh..(k + 1) * nh],
            );
            let present = from_fn(|l| segments.get(l).is_some_and(|s| k < s.len));
            unpack(simd, plan, own, present, work);
            let singular = |(lane, pivot): Singular| KktError::SingularStep {
                step: segments
                    .get(lane)
                    .map_or(0, |s| s.window.first_step + s.start + k),
                pivot,
            };
            step.substitute(simd, plan, work).map_err(singular)?;
            step.eliminate(simd, plan, work).map_err(singular)?;
            step.carry(simd, plan, work, &mut self.v);
            products.fill(simd, sizes, step, &self.v);
            let mut quadratic = Quadratic::new(plan, work);
            quadratic.add(simd, sizes, step, &self.v, &products);
            for (l, s) in segments.iter().enumerate().filter(|(_, s)| k < s.len) {
                let y = layout.step(&s.window, s.start + k);
                for i in 0..ns {
                    quadratic.m[i * nz + i][l] += values.sigma[y + i];
                }
                for i in 0..nx {
                    quadratic.q[i * w + i][l] += node_diagonal(s, s.start + k, i);
                }
            }
            step.reduce(simd, sizes, &mut quadratic, f, &mut self.kpp);
            self.v.copy_from_slice(quadratic.q);
            step.end_state(simd, sizes, &self.c, next);
            self.c.copy_from_slice(next);
        }
        Ok(())
    }
}

fn places(segments: &[Segment], k: usize, at: impl Fn(&Segment) -> usize) -> Places {
    from_fn(|l| segments.get(l).filter(|s| k < s.len).map(&at))
}
