//! Condensing of a run of steps onto its first state and the parameters.
//!
//! Within a segment the pairs (y_k, λ_k) are eliminated from the last step to the first through the regular step Jacobian
//! `B_k = ∂c_k/∂y_k`: with `T = −B⁻¹ [A P]` the unknowns are `y = T (x, p) + t`. Every pair has inertia (ny, ny, 0) whatever
//! the Hessian is. What is left of the segment is a quadratic in (x_start, p) and the affine map to its end state. Growth
//! of rounding errors is bounded by that of the dynamics over one segment.

use super::super::layout::{Layout, Window};
use super::super::{KktError, KktValues};

/// Ratio of a pivot to its row below which a step Jacobian counts as singular.
const SINGULAR: f64 = 1e-13;

/// Sizes shared by all segments, the width of a row of (x, p) coefficients rounded up for vector units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sizes {
    pub(super) nx: usize,
    pub(super) ny: usize,
    /// Free parameters.
    pub(super) np: usize,
    /// Row length: `nx + np`, rounded up to a multiple of 4.
    pub(super) w: usize,
}

/// A run of steps of one window.
pub(super) struct Segment {
    pub(super) window: Window,
    /// First step, counted in the window.
    pub(super) start: usize,
    pub(super) len: usize,
    /// Whether the window ends with this segment.
    pub(super) last: bool,
    /// `T` of each step, ny × w.
    t: Vec<f64>,
    /// `M T + N` of each step: gradient of the cost-to-go with respect to y, ny × w.
    g: Vec<f64>,
    /// LU factors of B of each step, ny × ny, with row permutations.
    lu: Vec<f64>,
    pivots: Vec<u8>,
    /// Hessian with respect to y of the cost-to-go, ny × ny.
    m: Vec<f64>,
    /// Map from the state after each step to the end state, nx × nx.
    end_map: Vec<f64>,
    /// Cost-to-go at the first state: [V_xx V_xp], nx × w.
    pub(super) v: Vec<f64>,
    /// Contribution to the Hessian of the parameters, upper triangle, np × np.
    pub(super) kpp: Vec<f64>,
    /// End state as a map of (x_start, p), nx × w.
    pub(super) c: Vec<f64>,
    /// Per solve: offset t and gradient of the cost-to-go of each step, ny each.
    offset: Vec<f64>,
    gradient: Vec<f64>,
    /// Per solve: linear term at the first state, of the parameters, and offset of the end state.
    pub(super) v_lin: Vec<f64>,
    pub(super) p_lin: Vec<f64>,
    pub(super) c_lin: Vec<f64>,
    scratch: Vec<f64>,
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

impl Segment {
    pub(super) fn new(s: Sizes, window: Window, start: usize, len: usize) -> Self {
        let Sizes { nx, ny, np, w } = s;
        Self {
            window,
            start,
            len,
            last: start + len == window.steps,
            t: vec![0.0; len * ny * w],
            g: vec![0.0; len * ny * w],
            lu: vec![0.0; len * ny * ny],
            pivots: vec![0; len * ny],
            m: vec![0.0; len * ny * ny],
            end_map: vec![0.0; len * nx * nx],
            v: vec![0.0; nx * w],
            kpp: vec![0.0; np * np],
            c: vec![0.0; nx * w],
            offset: vec![0.0; len * ny],
            gradient: vec![0.0; len * ny],
            v_lin: vec![0.0; nx],
            p_lin: vec![0.0; np],
            c_lin: vec![0.0; nx],
            scratch: vec![0.0; (2 * ny + 2 * nx) * w],
        }
    }

    /// Eliminates the segment's pairs. `columns[j]` is the position of parameter j among the free ones.
    pub(super) fn condense(
        &mut self,
        s: Sizes,
        layout: &Layout,
        columns: &[Option<u32>],
        values: &KktValues<'_>,
    ) -> Result<(), KktError> {
        let Sizes { nx, ny, np, w } = s;
        let ns = ny - nx;
        let (nj, nh) = (layout.step_jacobian.len(), layout.step_hessian.len());
        let (f, rest) = self.scratch.split_at_mut(ny * w);
        let (n, rest) = rest.split_at_mut(ny * w);
        let (v_new, c_new) = rest.split_at_mut(nx * w);
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
        for step in (0..self.len).rev() {
            let k = self.start + step;
            let global = self.window.first_step + k;
            let t = &mut self.t[step * ny * w..(step + 1) * ny * w];
            let g = &mut self.g[step * ny * w..(step + 1) * ny * w];
            let lu = &mut self.lu[step * ny * ny..(step + 1) * ny * ny];
            let m = &mut self.m[step * ny * ny..(step + 1) * ny * ny];
            let pivots = &mut self.pivots[step * ny..(step + 1) * ny];
            t.fill(0.0);
            lu.fill(0.0);
            m.fill(0.0);
            n.fill(0.0);
            v_new.fill(0.0);
            // Position in a row of (x, p) coefficients.
            let place = |local: usize| -> Option<usize> {
                if local < nx {
                    Some(local)
                } else {
                    columns[local - nx - ny].map(|c| nx + c as usize)
                }
            };
            let jacobian = &values.jacobian[global * nj..(global + 1) * nj];
            for (&(row, col), &value) in layout.step_jacobian.iter().zip(jacobian) {
                let (row, col) = (row as usize, col as usize);
                if (nx..nx + ny).contains(&col) {
                    lu[row * ny + col - nx] += value;
                } else if let Some(at) = place(col) {
                    t[row * w + at] -= value;
                }
            }
            lu_factor(lu, ny, pivots).map_err(|pivot| KktError::SingularStep {
                step: global,
                pivot,
            })?;
            lu_solve_rows(lu, ny, pivots, t, w);

            let hessian = &values.hessian[global * nh..(global + 1) * nh];
            for (&(row, col), &value) in layout.step_hessian.iter().zip(hessian) {
                let (row, col) = (row as usize, col as usize);
                let is_y = |i: usize| (nx..nx + ny).contains(&i);
                match (is_y(row), is_y(col)) {
                    (true, true) => {
                        m[(row - nx) * ny + col - nx] += value;
                        if row != col {
                            m[(col - nx) * ny + row - nx] += value;
                        }
                    }
                    (true, false) => n[(row - nx) * w + col] += value,
                    (false, true) => {
                        if let Some(at) = place(row) {
                            n[(col - nx) * w + at] += value;
                        }
                    }
                    (false, false) => {
                        if let Some(at) = place(row) {
                            v_new[col * w + at] += value;
                            if row < nx && row != col {
                                v_new[row * w + col] += value;
                            }
                        }
                    }
                }
            }
            let y = layout.step(&self.window, k);
            for i in 0..ns {
                m[i * ny + i] += values.sigma[y + i];
            }
            for i in 0..nx {
                for j in 0..nx {
                    m[(ns + i) * ny + ns + j] += self.v[i * w + j];
                }
                axpy(
                    1.0,
                    &self.v[i * w + nx..(i + 1) * w],
                    &mut n[(ns + i) * w + nx..(ns + i + 1) * w],
                );
                v_new[i * w + i] += node_diagonal(k, i);
            }
            // g = N + M T, f = N + ½ M T, so that the new quadratic is TᵀF + FᵀT.
            for i in 0..ny {
                let row = &mut g[i * w..(i + 1) * w];
                row.fill(0.0);
                for j in 0..ny {
                    let a = m[i * ny + j];
                    if a != 0.0 {
                        axpy(a, &t[j * w..(j + 1) * w], row);
                    }
                }
                for ((g, n), f) in row.iter_mut().zip(&n[i * w..]).zip(&mut f[i * w..]) {
                    *f = n + 0.5 * *g;
                    *g += n;
                }
            }
            for j in 0..ny {
                let (tj, fj) = (&t[j * w..(j + 1) * w], &f[j * w..(j + 1) * w]);
                for i in 0..nx {
                    let row = &mut v_new[i * w..(i + 1) * w];
                    axpy2(tj[i], fj, fj[i], tj, row);
                }
                for i in 0..np {
                    let at = nx + i;
                    let row = &mut self.kpp[i * np + i..(i + 1) * np];
                    axpy2(tj[at], &fj[at..nx + np], fj[at], &tj[at..nx + np], row);
                }
            }
            let map = &mut self.end_map[step * nx * nx..(step + 1) * nx * nx];
            for i in 0..nx {
                map[i * nx..(i + 1) * nx].copy_from_slice(&self.c[i * w..i * w + nx]);
                let row = &mut c_new[i * w..(i + 1) * w];
                row[..nx].fill(0.0);
                row[nx..].copy_from_slice(&self.c[i * w + nx..(i + 1) * w]);
                for j in 0..nx {
                    let a = map[i * nx + j];
                    if a != 0.0 {
                        axpy(a, &t[(ns + j) * w..(ns + j + 1) * w], row);
                    }
                }
            }
            self.v.copy_from_slice(v_new);
            self.c.copy_from_slice(c_new);
        }
        Ok(())
    }

    /// Reduces a right-hand side: leaves `v_lin`, `p_lin`, `c_lin`.
    pub(super) fn reduce(&mut self, s: Sizes, layout: &Layout, rx: &[f64], rc: &[f64]) {
        let Sizes { nx, ny, np, w } = s;
        let ns = ny - nx;
        self.p_lin.fill(0.0);
        self.c_lin.fill(0.0);
        self.v_lin.fill(0.0);
        if self.last {
            let at = layout.state(&self.window, self.window.steps);
            for i in 0..nx {
                self.v_lin[i] = -rx[at + i];
            }
        }
        for step in (0..self.len).rev() {
            let k = self.start + step;
            let t = &self.t[step * ny * w..(step + 1) * ny * w];
            let g = &self.g[step * ny * w..(step + 1) * ny * w];
            let offset = &mut self.offset[step * ny..(step + 1) * ny];
            let gradient = &mut self.gradient[step * ny..(step + 1) * ny];
            let row = self.window.row + k * ny;
            offset.copy_from_slice(&rc[row..row + ny]);
            let lu = &self.lu[step * ny * ny..(step + 1) * ny * ny];
            lu_solve_rows(lu, ny, &self.pivots[step * ny..(step + 1) * ny], offset, 1);
            let y = layout.step(&self.window, k);
            for i in 0..ns {
                gradient[i] = -rx[y + i];
            }
            gradient[ns..].copy_from_slice(&self.v_lin);
            let map = &self.end_map[step * nx * nx..(step + 1) * nx * nx];
            for i in 0..nx {
                for j in 0..nx {
                    self.c_lin[i] += map[i * nx + j] * offset[ns + j];
                }
            }
            let x = layout.state(&self.window, k);
            for i in 0..nx {
                self.v_lin[i] = -rx[x + i];
            }
            for j in 0..ny {
                let (a, b) = (gradient[j], offset[j]);
                let (tj, gj) = (&t[j * w..(j + 1) * w], &g[j * w..(j + 1) * w]);
                for i in 0..nx {
                    self.v_lin[i] += tj[i] * a + gj[i] * b;
                }
                axpy2(a, &tj[nx..nx + np], b, &gj[nx..nx + np], &mut self.p_lin);
            }
        }
    }

    /// Recovers the unknowns and multipliers of the segment's steps from `x` (first state, overwritten), `p` and the multiplier
    /// `nu` of the end state (zero for the last segment). `dx` and `dlambda` receive the entries of this segment, laid
    /// out as in the problem but starting at the segment's first step.
    pub(super) fn expand(
        &self,
        s: Sizes,
        x: &mut [f64],
        p: &[f64],
        nu: &[f64],
        dx: &mut [f64],
        dlambda: &mut [f64],
    ) {
        let Sizes { nx, ny, np, w } = s;
        let ns = ny - nx;
        for step in 0..self.len {
            let t = &self.t[step * ny * w..(step + 1) * ny * w];
            let g = &self.g[step * ny * w..(step + 1) * ny * w];
            let m = &self.m[step * ny * ny..(step + 1) * ny * ny];
            let map = &self.end_map[step * nx * nx..(step + 1) * nx * nx];
            let offset = &self.offset[step * ny..(step + 1) * ny];
            let gradient = &self.gradient[step * ny..(step + 1) * ny];
            let y = &mut dx[step * ny..(step + 1) * ny];
            let lambda = &mut dlambda[step * ny..(step + 1) * ny];
            for i in 0..ny {
                let (ti, gi) = (&t[i * w..(i + 1) * w], &g[i * w..(i + 1) * w]);
                let (mut yi, mut li) = (offset[i], gradient[i]);
                for j in 0..nx {
                    yi += ti[j] * x[j];
                    li += gi[j] * x[j];
                }
                for j in 0..np {
                    yi += ti[nx + j] * p[j];
                    li += gi[nx + j] * p[j];
                }
                for j in 0..ny {
                    li += m[i * ny + j] * offset[j];
                }
                y[i] = yi;
                lambda[i] = -li;
            }
            for i in 0..nx {
                for j in 0..nx {
                    lambda[ns + j] -= map[i * nx + j] * nu[i];
                }
            }
            let lu = &self.lu[step * ny * ny..(step + 1) * ny * ny];
            lu_solve_transpose(lu, ny, &self.pivots[step * ny..(step + 1) * ny], lambda);
            x.copy_from_slice(&y[ns..]);
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
