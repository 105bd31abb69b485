//! Condensing of a run of steps onto its first state and the parameters.
//!
//! Within a segment the pairs (y_k, λ_k) are eliminated from the last step to the first. Kinematic rows are substituted
//! ([`super::plan`]); of the rest, `B z + A x + P p = …` with B regular, follow `z = T (x, p) + t` with `T = −B⁻¹ [A P]`.
//! Every pair has inertia (ny, ny, 0) whatever the Hessian is. What is left of the segment is a quadratic in (x_start, p) and
//! the affine map to its end state. Growth of rounding errors is bounded by that of the dynamics over one segment.
//!
//! With the next state `x' = E x + S z + e`, `W` the Hessian of the cost-to-go with respect to x' (the step's own part included) and
//! `F` that of the step between x' and the rest, one step of the recursion is
//!
//! ```text
//! M = H_zz + Sᵀ F_z + F_zᵀ S + Sᵀ W S          N = [H_zx + Sᵀ F_x + F_zᵀ E + Sᵀ W E,  H_zp + Sᵀ W_p]
//! Q = [H_xx + Eᵀ F_x + F_xᵀ E + Eᵀ W E,  H_xp + Eᵀ W_p]
//! V = Q + Tᵀ N + Nᵀ T + Tᵀ M T
//! ```

use super::super::layout::{Layout, Window};
use super::super::{KktError, KktValues};
use super::plan::{Plan, Sizes, scatter};

/// Ratio of a pivot to its row below which a step Jacobian counts as singular.
const SINGULAR: f64 = 1e-13;

/// A run of steps of one window.
pub(super) struct Segment {
    pub(super) window: Window,
    /// First step, counted in the window.
    pub(super) start: usize,
    pub(super) len: usize,
    /// Whether the window ends with this segment.
    pub(super) last: bool,
    steps: Vec<Step>,
    /// Cost-to-go at the first state: [V_xx V_xp], nx × w.
    pub(super) v: Vec<f64>,
    /// Contribution to the Hessian of the parameters, upper triangle, np × np.
    pub(super) kpp: Vec<f64>,
    /// End state as a map of (x_start, p), nx × w.
    pub(super) c: Vec<f64>,
    /// Per solve: linear term at the first state, of the parameters, and offset of the end state.
    pub(super) v_lin: Vec<f64>,
    pub(super) p_lin: Vec<f64>,
    pub(super) c_lin: Vec<f64>,
    work: Vec<f64>,
    /// [V C] of the step before, and small products.
    next: Vec<f64>,
    small: Vec<f64>,
}

/// What a solve needs of one step.
struct Step {
    /// `T`, nz × w.
    t: Vec<f64>,
    /// `M T + N`, nz × w.
    g: Vec<f64>,
    /// `M`, nz × nz.
    m: Vec<f64>,
    /// LU factors of B and its row permutation.
    lu: Vec<f64>,
    pivots: Vec<u8>,
    /// E and S, nx × nx and nx × nz.
    e: Vec<f64>,
    s: Vec<f64>,
    /// Inverse diagonal of the substituted rows, ne.
    r: Vec<f64>,
    /// Core rows with respect to x'_e, nz × ne.
    d: Vec<f64>,
    /// Rows e of [W W_p] and of F with respect to z and x.
    we: Vec<f64>,
    fz: Vec<f64>,
    fx: Vec<f64>,
    /// Map from the state after the step to the end state, nx × nx.
    end: Vec<f64>,
    /// Per solve: t, e, gradient with respect to z, gradient of the cost-to-go at x'.
    offset: Vec<f64>,
    shift: Vec<f64>,
    gradient: Vec<f64>,
    ahead: Vec<f64>,
}

impl Step {
    fn new(s: Sizes) -> Self {
        let Sizes { nx, w, ne, nz, .. } = s;
        Self {
            t: vec![0.0; nz * w],
            g: vec![0.0; nz * w],
            m: vec![0.0; nz * nz],
            lu: vec![0.0; nz * nz],
            pivots: vec![0; nz],
            e: vec![0.0; nx * nx],
            s: vec![0.0; nx * nz],
            r: vec![0.0; ne],
            d: vec![0.0; nz * ne],
            we: vec![0.0; ne * w],
            fz: vec![0.0; ne * nz],
            fx: vec![0.0; ne * nx],
            end: vec![0.0; nx * nx],
            offset: vec![0.0; nz],
            shift: vec![0.0; ne],
            gradient: vec![0.0; nz],
            ahead: vec![0.0; nx],
        }
    }
}

/// `y += a x`.
#[inline(always)]
fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += a * x;
    }
}

fn lu_factor(a: &mut [f64], n: usize, pivots: &mut [u8]) -> Result<(), f64> {
    let mut worst = f64::INFINITY;
    for k in 0..n {
        let (mut best, mut row) = (a[k * n + k].abs(), k);
        for i in k + 1..n {
            if a[i * n + k].abs() > best {
                (best, row) = (a[i * n + k].abs(), i);
            }
        }
        let scale = a[k * n + k..].iter().fold(0.0_f64, |s, v| s.max(v.abs()));
        let relative = if scale > 0.0 { best / scale } else { 0.0 };
        worst = worst.min(relative);
        if relative.is_nan() || relative <= SINGULAR {
            return Err(relative);
        }
        pivots[k] = row as u8;
        if row != k {
            for j in 0..n {
                a.swap(k * n + j, row * n + j);
            }
        }
        let inverse = 1.0 / a[k * n + k];
        for i in k + 1..n {
            let l = a[i * n + k] * inverse;
            a[i * n + k] = l;
            if l != 0.0 {
                for j in k + 1..n {
                    a[i * n + j] -= l * a[k * n + j];
                }
            }
        }
    }
    Ok(())
}

/// Solves `B X = R` in place for the rows of R, each of length w.
fn lu_solve_rows(lu: &[f64], n: usize, pivots: &[u8], r: &mut [f64], w: usize) {
    for k in 0..n {
        let p = pivots[k] as usize;
        if p != k {
            let (a, b) = r.split_at_mut(p * w);
            a[k * w..(k + 1) * w].swap_with_slice(&mut b[..w]);
        }
    }
    for k in 0..n {
        for i in k + 1..n {
            let l = lu[i * n + k];
            if l != 0.0 {
                let (a, b) = r.split_at_mut(i * w);
                axpy(-l, &a[k * w..(k + 1) * w], &mut b[..w]);
            }
        }
    }
    for k in (0..n).rev() {
        for j in k + 1..n {
            let u = lu[k * n + j];
            if u != 0.0 {
                let (a, b) = r.split_at_mut(j * w);
                axpy(-u, &b[..w], &mut a[k * w..(k + 1) * w]);
            }
        }
        let inverse = 1.0 / lu[k * n + k];
        for v in &mut r[k * w..(k + 1) * w] {
            *v *= inverse;
        }
    }
}

/// Solves `Bᵀ x = r` in place.
fn lu_solve_transpose(lu: &[f64], n: usize, pivots: &[u8], r: &mut [f64]) {
    for k in 0..n {
        for i in 0..k {
            r[k] -= lu[i * n + k] * r[i];
        }
        r[k] /= lu[k * n + k];
    }
    for k in (0..n).rev() {
        for i in k + 1..n {
            r[k] -= lu[i * n + k] * r[i];
        }
    }
    for k in (0..n).rev() {
        let p = pivots[k] as usize;
        if p != k {
            r.swap(k, p);
        }
    }
}

/// `y += a x + b z`.
#[inline(always)]
fn axpy2(a: f64, x: &[f64], b: f64, z: &[f64], y: &mut [f64]) {
    for ((y, x), z) in y.iter_mut().zip(x).zip(z) {
        *y += a * x + b * z;
    }
}

impl Segment {
    pub(super) fn new(plan: &Plan, window: Window, start: usize, len: usize) -> Self {
        let Sizes { nx, np, w, nz, .. } = plan.sizes;
        Self {
            window,
            start,
            len,
            last: start + len == window.steps,
            steps: (0..len).map(|_| Step::new(plan.sizes)).collect(),
            v: vec![0.0; nx * w],
            kpp: vec![0.0; np * np],
            c: vec![0.0; nx * w],
            v_lin: vec![0.0; nx],
            p_lin: vec![0.0; np],
            c_lin: vec![0.0; nx],
            work: vec![0.0; plan.offsets.len],
            next: vec![0.0; nx * w + nz * w],
            small: vec![0.0; 2 * nx * (nx + nz)],
        }
    }

    /// Eliminates the segment's pairs.
    pub(super) fn condense(
        &mut self,
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
        self.kpp.fill(0.0);
        self.v.fill(0.0);
        self.c.fill(0.0);
        for i in 0..nx {
            self.c[i * w + i] = 1.0;
        }
        let node_values = layout.node_values();
        let node_diagonal = |k: usize, i: usize| {
            values.hessian[node_values + (self.window.first_node + k) * nx + i]
                + values.sigma[layout.state(&self.window, k) + i]
        };
        if self.last {
            for i in 0..nx {
                self.v[i * w + i] = node_diagonal(self.window.steps, i);
            }
        }
        let (next, f) = self.next.split_at_mut(nx * w);
        let (wx, wz) = self.small.split_at_mut(2 * nx * nx);
        let (wx, fx) = wx.split_at_mut(nx * nx);
        let (wz, fz) = wz.split_at_mut(nx * nz);
        for k in (0..self.len).rev() {
            let global = self.window.first_step + self.start + k;
            let step = &mut self.steps[k];
            let work = &mut self.work;
            work.fill(0.0);
            scatter(
                &plan.jacobian,
                &values.jacobian[global * nj..(global + 1) * nj],
                work,
            );
            scatter(
                &plan.hessian,
                &values.hessian[global * nh..(global + 1) * nh],
                work,
            );
            let singular = |pivot: f64| KktError::SingularStep {
                step: global,
                pivot,
            };

            // x' = E x + S z.
            step.e.fill(0.0);
            step.s.fill(0.0);
            for i in 0..ne {
                let d = work[o.r + i];
                let row = &work[o.rx + i * nx..o.rx + (i + 1) * nx];
                let size = row.iter().fold(d.abs(), |a, x| a.max(x.abs()));
                if d.is_nan() || d.abs() <= SINGULAR * size {
                    return Err(singular(if size > 0.0 { d.abs() / size } else { 0.0 }));
                }
                let inverse = 1.0 / d;
                step.r[i] = inverse;
                for j in 0..nx {
                    step.e[i * nx + j] = inverse * work[o.rx + i * nx + j];
                }
                for j in 0..nz {
                    step.s[i * nz + j] = inverse * work[o.rz + i * nz + j];
                }
            }
            for i in ne..nx {
                step.s[i * nz + sizes.core(i)] = 1.0;
            }
            let (e, s) = (&step.e, &step.s);

            // z = T (x, p).
            step.d.copy_from_slice(&work[o.d..o.d + nz * ne]);
            step.lu.copy_from_slice(&work[o.b..o.b + nz * nz]);
            step.t.copy_from_slice(&work[o.t..o.t + nz * w]);
            for i in 0..nz {
                for l in 0..ne {
                    let d = step.d[i * ne + l];
                    if d != 0.0 {
                        axpy(
                            d,
                            &s[l * nz..(l + 1) * nz],
                            &mut step.lu[i * nz..(i + 1) * nz],
                        );
                        axpy(-d, &e[l * nx..(l + 1) * nx], &mut step.t[i * w..i * w + nx]);
                    }
                }
            }
            lu_factor(&mut step.lu, nz, &mut step.pivots).map_err(singular)?;
            lu_solve_rows(&step.lu, nz, &step.pivots, &mut step.t, w);
            let t = &step.t;

            // W: the cost-to-go and the step's own Hessian in x'.
            for i in 0..ne {
                for j in 0..ne {
                    self.v[i * w + j] += work[o.fe + i * ne + j];
                }
                axpy(
                    1.0,
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
            for i in 0..nx {
                for j in 0..nx {
                    let full: f64 = (0..ne).map(|l| self.v[i * w + l] * e[l * nx + j]).sum();
                    let cross = if i < ne { step.fx[i * nx + j] } else { 0.0 };
                    wx[i * nx + j] = full + cross;
                    fx[i * nx + j] = 0.5 * full + cross;
                }
                for j in 0..nz {
                    let full: f64 = (0..nx).map(|l| self.v[i * w + l] * s[l * nz + j]).sum();
                    let cross = if i < ne { step.fz[i * nz + j] } else { 0.0 };
                    wz[i * nz + j] = full + cross;
                    fz[i * nz + j] = 0.5 * full + cross;
                }
            }
            let (m, rest) = work[o.m..].split_at_mut(nz * nz);
            let (n, rest) = rest.split_at_mut(nz * w);
            let q = &mut rest[..nx * w];
            for l in 0..nx {
                for i in 0..nz {
                    let a = s[l * nz + i];
                    if a != 0.0 {
                        for j in 0..nz {
                            m[i * nz + j] += a * fz[l * nz + j];
                            m[j * nz + i] += a * fz[l * nz + j];
                        }
                        axpy(a, &wx[l * nx..(l + 1) * nx], &mut n[i * w..i * w + nx]);
                        axpy(
                            a,
                            &self.v[l * w + nx..(l + 1) * w],
                            &mut n[i * w + nx..(i + 1) * w],
                        );
                    }
                }
                if l < ne {
                    for i in 0..nz {
                        let a = step.fz[l * nz + i];
                        if a != 0.0 {
                            axpy(a, &e[l * nx..(l + 1) * nx], &mut n[i * w..i * w + nx]);
                        }
                    }
                    for i in 0..nx {
                        let a = e[l * nx + i];
                        if a != 0.0 {
                            for j in 0..nx {
                                q[i * w + j] += a * fx[l * nx + j];
                                q[j * w + i] += a * fx[l * nx + j];
                            }
                            axpy(
                                a,
                                &self.v[l * w + nx..(l + 1) * w],
                                &mut q[i * w + nx..(i + 1) * w],
                            );
                        }
                    }
                }
            }
            let y = layout.step(&self.window, self.start + k);
            for i in 0..ns {
                m[i * nz + i] += values.sigma[y + i];
            }
            for i in 0..nx {
                q[i * w + i] += node_diagonal(self.start + k, i);
            }
            step.m.copy_from_slice(m);

            // G = N + M T; with F = N + ½ M T the new quadratic is Q + Tᵀ F + Fᵀ T.
            for i in 0..nz {
                let row = &mut step.g[i * w..(i + 1) * w];
                row.fill(0.0);
                for j in 0..nz {
                    let a = m[i * nz + j];
                    if a != 0.0 {
                        axpy(a, &t[j * w..(j + 1) * w], row);
                    }
                }
                for ((g, n), f) in row.iter_mut().zip(&n[i * w..]).zip(&mut f[i * w..]) {
                    *f = n + 0.5 * *g;
                    *g += n;
                }
            }
            for j in 0..nz {
                let (tj, fj) = (&t[j * w..(j + 1) * w], &f[j * w..(j + 1) * w]);
                for i in 0..nx {
                    axpy2(tj[i], fj, fj[i], tj, &mut q[i * w..(i + 1) * w]);
                }
                for i in 0..np {
                    let at = nx + i;
                    let row = &mut self.kpp[i * np + i..(i + 1) * np];
                    axpy2(tj[at], &fj[at..nx + np], fj[at], &tj[at..nx + np], row);
                }
            }
            self.v.copy_from_slice(q);

            // End state: C x' = C (E + S T_x) x + (C_p + C S T_p) p.
            for i in 0..nx {
                let (row, out) = (&self.c[i * w..(i + 1) * w], &mut next[i * w..(i + 1) * w]);
                step.end[i * nx..(i + 1) * nx].copy_from_slice(&row[..nx]);
                out[..nx].fill(0.0);
                out[nx..].copy_from_slice(&row[nx..]);
                for l in 0..ne {
                    axpy(row[l], &e[l * nx..(l + 1) * nx], &mut out[..nx]);
                }
                for j in 0..nz {
                    let a: f64 = (0..nx).map(|l| row[l] * s[l * nz + j]).sum();
                    if a != 0.0 {
                        axpy(a, &t[j * w..(j + 1) * w], out);
                    }
                }
            }
            self.c.copy_from_slice(next);
        }
        Ok(())
    }

    /// Reduces a right-hand side: leaves `v_lin`, `p_lin`, `c_lin`.
    pub(super) fn reduce(&mut self, sizes: Sizes, layout: &Layout, rx: &[f64], rc: &[f64]) {
        let Sizes {
            nx,
            ny,
            np,
            w,
            ne,
            nz,
        } = sizes;
        let ns = sizes.ns();
        self.p_lin.fill(0.0);
        self.c_lin.fill(0.0);
        self.v_lin.fill(0.0);
        if self.last {
            let at = layout.state(&self.window, self.window.steps);
            for i in 0..nx {
                self.v_lin[i] = -rx[at + i];
            }
        }
        for k in (0..self.len).rev() {
            let step = &mut self.steps[k];
            let row = self.window.row + (self.start + k) * ny;
            for i in 0..ne {
                step.shift[i] = step.r[i] * rc[row + i];
            }
            let shift = &step.shift;
            for i in 0..nz {
                let moved: f64 = (0..ne).map(|l| step.d[i * ne + l] * shift[l]).sum();
                step.offset[i] = rc[row + ne + i] - moved;
            }
            lu_solve_rows(&step.lu, nz, &step.pivots, &mut step.offset, 1);
            // Gradient of the cost-to-go at x' = e.
            step.ahead.copy_from_slice(&self.v_lin);
            for l in 0..ne {
                axpy(shift[l], &step.we[l * w..l * w + nx], &mut self.v_lin);
                axpy(
                    shift[l],
                    &step.we[l * w + nx..l * w + nx + np],
                    &mut self.p_lin,
                );
            }
            let y = layout.step(&self.window, self.start + k);
            for i in 0..nz {
                let own = if i < ns { -rx[y + i] } else { 0.0 };
                let through: f64 = (0..nx).map(|l| step.s[l * nz + i] * self.v_lin[l]).sum();
                let cross: f64 = (0..ne).map(|l| step.fz[l * nz + i] * shift[l]).sum();
                step.gradient[i] = own + through + cross;
            }
            for i in 0..nx {
                for l in 0..nx {
                    let mut next = if l < ne { shift[l] } else { 0.0 };
                    for j in 0..nz {
                        next += step.s[l * nz + j] * step.offset[j];
                    }
                    self.c_lin[i] += step.end[i * nx + l] * next;
                }
            }
            let x = layout.state(&self.window, self.start + k);
            let mut lin = std::mem::take(&mut self.v_lin);
            // lin becomes the gradient at x; ahead keeps that at x' without e.
            let at_next = &mut self.small[..nx];
            at_next.copy_from_slice(&lin);
            for i in 0..nx {
                let mut sum = -rx[x + i];
                for l in 0..ne {
                    sum += step.e[l * nx + i] * at_next[l] + step.fx[l * nx + i] * shift[l];
                }
                lin[i] = sum;
            }
            for j in 0..nz {
                let (a, b) = (step.gradient[j], step.offset[j]);
                let (tj, gj) = (&step.t[j * w..(j + 1) * w], &step.g[j * w..(j + 1) * w]);
                for i in 0..nx {
                    lin[i] += tj[i] * a + gj[i] * b;
                }
                axpy2(a, &tj[nx..nx + np], b, &gj[nx..nx + np], &mut self.p_lin);
            }
            self.v_lin = lin;
        }
    }

    /// Recovers the unknowns and multipliers of the segment's steps from `x` (first state, overwritten), `p` and the multiplier
    /// `nu` of the end state (zero for the last segment). `dx` and `dlambda` receive the entries of this segment, laid
    /// out as in the problem but starting at the segment's first step.
    pub(super) fn expand(
        &self,
        sizes: Sizes,
        x: &mut [f64],
        p: &[f64],
        nu: &[f64],
        dx: &mut [f64],
        dlambda: &mut [f64],
    ) {
        let Sizes {
            nx, ny, w, ne, nz, ..
        } = sizes;
        let ns = sizes.ns();
        for (k, step) in self.steps.iter().enumerate() {
            let (stages, state) = dx[k * ny..(k + 1) * ny].split_at_mut(ns);
            let (linear, core) = dlambda[k * ny..(k + 1) * ny].split_at_mut(ne);
            // The core unknowns are the stages and the last components of the next state.
            for i in 0..nz {
                let (ti, gi) = (&step.t[i * w..], &step.g[i * w..]);
                let (mut zi, mut li) = (step.offset[i], step.gradient[i]);
                for j in 0..nx {
                    zi += ti[j] * x[j];
                    li += gi[j] * x[j];
                }
                for ((t, g), p) in ti[nx..].iter().zip(&gi[nx..]).zip(p) {
                    zi += t * p;
                    li += g * p;
                }
                for j in 0..nz {
                    li += step.m[i * nz + j] * step.offset[j];
                }
                if i < ns {
                    stages[i] = zi;
                } else {
                    state[ne + i - ns] = zi;
                }
                core[i] = -li;
            }
            for i in 0..ne {
                let mut sum = step.shift[i];
                for j in 0..nx {
                    sum += step.e[i * nx + j] * x[j];
                }
                for j in 0..nz {
                    let z = if j < ns {
                        stages[j]
                    } else {
                        state[ne + j - ns]
                    };
                    sum += step.s[i * nz + j] * z;
                }
                state[i] = sum;
            }
            for l in 0..nx {
                let along: f64 = (0..nx).map(|i| step.end[i * nx + l] * nu[i]).sum();
                for i in 0..nz {
                    core[i] -= step.s[l * nz + i] * along;
                }
                if l < ne {
                    linear[l] = -along;
                }
            }
            lu_solve_transpose(&step.lu, nz, &step.pivots, core);
            // Stationarity with respect to x'_e.
            for l in 0..ne {
                let mut sum = step.ahead[l];
                let we = &step.we[l * w..];
                for j in 0..nx {
                    sum += we[j] * state[j] + step.fx[l * nx + j] * x[j];
                }
                for (w, p) in we[nx..].iter().zip(p) {
                    sum += w * p;
                }
                for j in 0..nz {
                    let z = if j < ns {
                        stages[j]
                    } else {
                        state[ne + j - ns]
                    };
                    sum += step.fz[l * nz + j] * z + step.d[j * ne + l] * core[j];
                }
                linear[l] = step.r[l] * (linear[l] - sum);
            }
            x.copy_from_slice(state);
        }
    }
}
