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

mod solve;

use super::super::layout::{Layout, Window};
use super::super::{KktError, KktValues};
use super::plan::{Plan, Sizes, Target};
use super::small::{SINGULAR, lu_factor, lu_solve};
use pid_lanes::kernel::{Simd, SimdFloat, all, axpy, axpy2, load, widest};
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
            small: zeros(2 * nx * (nx + nz)),
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
        let Sizes {
            nx, np, w, ne, nz, ..
        } = sizes;
        let (o, ns) = (plan.offsets, sizes.ns());
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
        let (wx, wz) = self.small.split_at_mut(2 * nx * nx);
        let (wx, fx) = wx.split_at_mut(nx * nx);
        let (wz, fz) = wz.split_at_mut(nx * nz);
        for k in (0..self.steps.len()).rev() {
            let step = &mut self.steps[k];
            let work = &mut self.work;
            work.fill(ZERO);
            scatter(
                simd,
                &plan.jacobian,
                &self.jacobian[k * nj..(k + 1) * nj],
                work,
            );
            scatter(
                simd,
                &plan.hessian,
                &self.hessian[k * nh..(k + 1) * nh],
                work,
            );
            for l in 0..LANES {
                if self.segments.get(l).is_none_or(|s| k >= s.len) {
                    // x' = x.
                    (0..ne).for_each(|i| work[o.r + i][l] = 1.0);
                    (0..ne).for_each(|i| work[o.rx + i * nx + i][l] = 1.0);
                    (0..nz).for_each(|i| work[o.b + i * nz + i][l] = 1.0);
                    (ne..nx).for_each(|i| work[o.t + sizes.core(i) * w + i][l] = 1.0);
                }
            }
            let segments = &self.segments;
            let singular = |lane: usize, pivot: f64| KktError::SingularStep {
                step: segments
                    .get(lane)
                    .map_or(0, |s| s.window.first_step + s.start + k),
                pivot,
            };

            // x' = E x + S z.
            step.e.fill(ZERO);
            step.s.fill(ZERO);
            for i in 0..ne {
                let d = work[o.r + i];
                let row = &work[o.rx + i * nx..o.rx + (i + 1) * nx];
                for l in 0..LANES {
                    let size = row.iter().fold(d[l].abs(), |a, x| a.max(x[l].abs()));
                    if d[l].is_nan() || d[l].abs() <= SINGULAR * size {
                        let pivot = if size > 0.0 { d[l].abs() / size } else { 0.0 };
                        return Err(singular(l, pivot));
                    }
                }
                step.r[i] = (all(simd, 1.0) / load(simd, &d)).into();
                for j in 0..nx {
                    step.e[i * nx + j] = mul(simd, &step.r[i], &work[o.rx + i * nx + j]);
                }
                for j in 0..nz {
                    step.s[i * nz + j] = mul(simd, &step.r[i], &work[o.rz + i * nz + j]);
                }
            }
            for i in ne..nx {
                step.s[i * nz + sizes.core(i)] = [1.0; LANES];
            }
            let (e, s) = (&step.e, &step.s);

            // z = T (x, p).
            step.d.copy_from_slice(&work[o.d..o.d + nz * ne]);
            step.lu.copy_from_slice(&work[o.b..o.b + nz * nz]);
            step.t.copy_from_slice(&work[o.t..o.t + nz * w]);
            for i in 0..nz {
                for l in 0..ne {
                    let d = step.d[i * ne + l];
                    if d != ZERO {
                        let d = load(simd, &d);
                        let row = &mut step.lu[i * nz..(i + 1) * nz];
                        axpy(simd, d, &s[l * nz..(l + 1) * nz], row);
                        let row = &mut step.t[i * w..i * w + nx];
                        axpy(simd, -d, &e[l * nx..(l + 1) * nx], row);
                    }
                }
            }
            lu_factor(simd, &mut step.lu, nz, &mut step.pivots)
                .map_err(|(lane, pivot)| singular(lane, pivot))?;
            lu_solve(simd, &step.lu, nz, &step.pivots, &mut step.t, w);
            let t = &step.t;

            // W: the cost-to-go and the step's own Hessian in x'.
            for i in 0..ne {
                for j in 0..ne {
                    let v = &mut self.v[i * w + j];
                    *v = add(simd, v, &work[o.fe + i * ne + j]);
                }
                axpy(
                    simd,
                    all(simd, 1.0),
                    &work[o.fx + i * w + nx..o.fx + (i + 1) * w],
                    &mut self.v[i * w + nx..(i + 1) * w],
                );
                step.we[i * w..(i + 1) * w].copy_from_slice(&self.v[i * w..(i + 1) * w]);
                step.fz[i * nz..(i + 1) * nz]
                    .copy_from_slice(&work[o.fz + i * nz..o.fz + (i + 1) * nz]);
                step.fx[i * nx..(i + 1) * nx]
                    .copy_from_slice(&work[o.fx + i * w..o.fx + i * w + nx]);
            }
            // W E + F_x and W S + F_z; with half of W the products below are symmetric sums.
            let half = all(simd, 0.5);
            for i in 0..nx {
                let row = (&self.v[i * w..], 1);
                for j in 0..nx {
                    let full = dot(simd, ne, row, (&e[j..], nx));
                    let cross = if i < ne { step.fx[i * nx + j] } else { ZERO };
                    let (full, cross) = (load(simd, &full), load(simd, &cross));
                    wx[i * nx + j] = (full + cross).into();
                    fx[i * nx + j] = half.mul_add(full, cross).into();
                }
                for j in 0..nz {
                    let full = dot(simd, nx, row, (&s[j..], nz));
                    let cross = if i < ne { step.fz[i * nz + j] } else { ZERO };
                    let (full, cross) = (load(simd, &full), load(simd, &cross));
                    wz[i * nz + j] = (full + cross).into();
                    fz[i * nz + j] = half.mul_add(full, cross).into();
                }
            }
            let (m, rest) = work[o.m..].split_at_mut(nz * nz);
            let (n, rest) = rest.split_at_mut(nz * w);
            let q = &mut rest[..nx * w];
            for l in 0..nx {
                for i in 0..nz {
                    let a = s[l * nz + i];
                    if a != ZERO {
                        let a = load(simd, &a);
                        for j in 0..nz {
                            let product = a * load(simd, &fz[l * nz + j]);
                            let to = &mut m[i * nz + j];
                            *to = (load(simd, to) + product).into();
                            let to = &mut m[j * nz + i];
                            *to = (load(simd, to) + product).into();
                        }
                        let row = &mut n[i * w..(i + 1) * w];
                        axpy(simd, a, &wx[l * nx..(l + 1) * nx], &mut row[..nx]);
                        axpy(simd, a, &self.v[l * w + nx..(l + 1) * w], &mut row[nx..]);
                    }
                }
                if l < ne {
                    for i in 0..nz {
                        let a = step.fz[l * nz + i];
                        if a != ZERO {
                            let row = &mut n[i * w..i * w + nx];
                            axpy(simd, load(simd, &a), &e[l * nx..(l + 1) * nx], row);
                        }
                    }
                    for i in 0..nx {
                        let a = e[l * nx + i];
                        if a != ZERO {
                            let a = load(simd, &a);
                            for j in 0..nx {
                                let product = a * load(simd, &fx[l * nx + j]);
                                let to = &mut q[i * w + j];
                                *to = (load(simd, to) + product).into();
                                let to = &mut q[j * w + i];
                                *to = (load(simd, to) + product).into();
                            }
                            let row = &mut q[i * w + nx..(i + 1) * w];
                            axpy(simd, a, &self.v[l * w + nx..(l + 1) * w], row);
                        }
                    }
                }
            }
            for (l, s) in self.segments.iter().enumerate().filter(|(_, s)| k < s.len) {
                let y = layout.step(&s.window, s.start + k);
                for i in 0..ns {
                    m[i * nz + i][l] += values.sigma[y + i];
                }
                for i in 0..nx {
                    q[i * w + i][l] += node_diagonal(s, s.start + k, i);
                }
            }
            step.m.copy_from_slice(m);

            // G = N + M T; with F = N + ½ M T the new quadratic is Q + Tᵀ F + Fᵀ T.
            for i in 0..nz {
                let row = &mut step.g[i * w..(i + 1) * w];
                row.fill(ZERO);
                for j in 0..nz {
                    let a = load(simd, &m[i * nz + j]);
                    axpy(simd, a, &t[j * w..(j + 1) * w], row);
                }
                for ((g, n), f) in row.iter_mut().zip(&n[i * w..]).zip(&mut f[i * w..]) {
                    let (product, n) = (load(simd, g), load(simd, n));
                    *f = half.mul_add(product, n).into();
                    *g = (product + n).into();
                }
            }
            for j in 0..nz {
                let (tj, fj) = (&t[j * w..(j + 1) * w], &f[j * w..(j + 1) * w]);
                let both = |at: usize| (load(simd, &tj[at]), load(simd, &fj[at]));
                for i in 0..nx {
                    let (a, b) = both(i);
                    axpy2(simd, (a, fj), (b, tj), &mut q[i * w..(i + 1) * w]);
                }
                for i in 0..np {
                    let at = nx + i;
                    let row = &mut self.kpp[i * np + i..(i + 1) * np];
                    let (a, b) = both(at);
                    axpy2(simd, (a, &fj[at..nx + np]), (b, &tj[at..nx + np]), row);
                }
            }
            self.v.copy_from_slice(q);

            // End state: C x' = C (E + S T_x) x + (C_p + C S T_p) p.
            for i in 0..nx {
                let (row, out) = (&self.c[i * w..(i + 1) * w], &mut next[i * w..(i + 1) * w]);
                step.end[i * nx..(i + 1) * nx].copy_from_slice(&row[..nx]);
                out[..nx].fill(ZERO);
                out[nx..].copy_from_slice(&row[nx..]);
                for l in 0..ne {
                    let a = load(simd, &row[l]);
                    axpy(simd, a, &e[l * nx..(l + 1) * nx], &mut out[..nx]);
                }
                for j in 0..nz {
                    let a = dot(simd, nx, (row, 1), (&s[j..], nz));
                    if a != ZERO {
                        axpy(simd, load(simd, &a), &t[j * w..(j + 1) * w], out);
                    }
                }
            }
            self.c.copy_from_slice(next);
        }
        Ok(())
    }
}

fn places(segments: &[Segment], k: usize, at: impl Fn(&Segment) -> usize) -> Places {
    from_fn(|l| segments.get(l).filter(|s| k < s.len).map(&at))
}
