//! The elimination of the pairs of one step, stage by stage.

use super::{Step, ZERO, add, dot, mul, scatter};
use crate::solver::kkt::structured::plan::{Plan, Sizes};
use crate::solver::kkt::structured::small::{SINGULAR, lu_factor, lu_solve};
use pid_lanes::kernel::{Simd, SimdFloat, all, axpy, axpy2, load};
use pid_lanes::{LANES, Lane};

/// Lane and pivot of a row that cannot be solved.
pub(super) type Singular = (usize, f64);

/// `W E + F_x`, and the same and `W S + F_z` with half of `W`: with these the products of a step are
/// symmetric sums.
pub(super) struct Products<'a> {
    wx: &'a mut [Lane],
    fx: &'a mut [Lane],
    fz: &'a mut [Lane],
}

impl<'a> Products<'a> {
    /// In a memory of nx (2 nx + nz) lanes.
    pub(super) fn new(sizes: Sizes, memory: &'a mut [Lane]) -> Self {
        let Sizes { nx, .. } = sizes;
        let (wx, rest) = memory.split_at_mut(nx * nx);
        let (fx, fz) = rest.split_at_mut(nx * nx);
        Self { wx, fx, fz }
    }

    /// `v`: [W W_p], nx × w.
    #[inline(always)]
    pub(super) fn fill<S: Simd>(&mut self, simd: S, sizes: Sizes, step: &Step, v: &[Lane]) {
        let Sizes { nx, w, ne, nz, .. } = sizes;
        let half = all(simd, 0.5);
        for i in 0..nx {
            let row = (&v[i * w..], 1);
            for j in 0..nx {
                let full = dot(simd, ne, row, (&step.e[j..], nx));
                let cross = if i < ne { step.fx[i * nx + j] } else { ZERO };
                let (full, cross) = (load(simd, &full), load(simd, &cross));
                self.wx[i * nx + j] = (full + cross).into();
                self.fx[i * nx + j] = half.mul_add(full, cross).into();
            }
            for j in 0..nz {
                let full = dot(simd, nx, row, (&step.s[j..], nz));
                let cross = if i < ne { step.fz[i * nz + j] } else { ZERO };
                let (full, cross) = (load(simd, &full), load(simd, &cross));
                self.fz[i * nz + j] = half.mul_add(full, cross).into();
            }
        }
    }
}

/// The quadratic of a step: `M` (nz × nz), `N` (nz × w) and `Q` (nx × w).
pub(super) struct Quadratic<'a> {
    pub(super) m: &'a mut [Lane],
    pub(super) n: &'a mut [Lane],
    pub(super) q: &'a mut [Lane],
}

impl<'a> Quadratic<'a> {
    /// In the workspace of the step, which holds its Hessian there.
    pub(super) fn new(plan: &Plan, work: &'a mut [Lane]) -> Self {
        let Sizes { nx, w, nz, .. } = plan.sizes;
        let (m, rest) = work[plan.offsets.m..].split_at_mut(nz * nz);
        let (n, rest) = rest.split_at_mut(nz * w);
        let q = &mut rest[..nx * w];
        Self { m, n, q }
    }

    /// Adds what `x' = E x + S z` makes of the cost-to-go `v` = [W W_p] and of F.
    #[inline(always)]
    pub(super) fn add<S: Simd>(
        &mut self,
        simd: S,
        sizes: Sizes,
        step: &Step,
        v: &[Lane],
        products: &Products<'_>,
    ) {
        let Sizes { nx, w, ne, nz, .. } = sizes;
        let Products { wx, fx, fz } = products;
        let Self { m, n, q } = self;
        let (e, s) = (&step.e, &step.s);
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
                    axpy(simd, a, &v[l * w + nx..(l + 1) * w], &mut row[nx..]);
                }
            }
            if l >= ne {
                continue;
            }
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
                    axpy(simd, a, &v[l * w + nx..(l + 1) * w], row);
                }
            }
        }
    }
}

/// Unpacks the values of one step into the workspace; lanes that are not `present` get `x' = x`
/// without cost.
#[inline(always)]
pub(super) fn unpack<S: Simd>(
    simd: S,
    plan: &Plan,
    (jacobian, hessian): (&[Lane], &[Lane]),
    present: [bool; LANES],
    work: &mut [Lane],
) {
    let (o, sizes) = (plan.offsets, plan.sizes);
    let Sizes { nx, w, ne, nz, .. } = sizes;
    work.fill(ZERO);
    scatter(simd, &plan.jacobian, jacobian, work);
    scatter(simd, &plan.hessian, hessian, work);
    for l in (0..LANES).filter(|&l| !present[l]) {
        (0..ne).for_each(|i| work[o.r + i][l] = 1.0);
        (0..ne).for_each(|i| work[o.rx + i * nx + i][l] = 1.0);
        (0..nz).for_each(|i| work[o.b + i * nz + i][l] = 1.0);
        (ne..nx).for_each(|i| work[o.t + sizes.core(i) * w + i][l] = 1.0);
    }
}

impl Step {
    /// `x' = E x + S z`.
    #[inline(always)]
    pub(super) fn substitute<S: Simd>(
        &mut self,
        simd: S,
        plan: &Plan,
        work: &[Lane],
    ) -> Result<(), Singular> {
        let (o, sizes) = (plan.offsets, plan.sizes);
        let Sizes { nx, ne, nz, .. } = sizes;
        self.e.fill(ZERO);
        self.s.fill(ZERO);
        for i in 0..ne {
            let d = work[o.r + i];
            let row = &work[o.rx + i * nx..o.rx + (i + 1) * nx];
            for l in 0..LANES {
                let size = row.iter().fold(d[l].abs(), |a, x| a.max(x[l].abs()));
                if d[l].is_nan() || d[l].abs() <= SINGULAR * size {
                    let pivot = if size > 0.0 { d[l].abs() / size } else { 0.0 };
                    return Err((l, pivot));
                }
            }
            self.r[i] = (all(simd, 1.0) / load(simd, &d)).into();
            for j in 0..nx {
                self.e[i * nx + j] = mul(simd, &self.r[i], &work[o.rx + i * nx + j]);
            }
            for j in 0..nz {
                self.s[i * nz + j] = mul(simd, &self.r[i], &work[o.rz + i * nz + j]);
            }
        }
        for i in ne..nx {
            self.s[i * nz + sizes.core(i)] = [1.0; LANES];
        }
        Ok(())
    }

    /// `z = T (x, p)`.
    #[inline(always)]
    pub(super) fn eliminate<S: Simd>(
        &mut self,
        simd: S,
        plan: &Plan,
        work: &[Lane],
    ) -> Result<(), Singular> {
        let o = plan.offsets;
        let Sizes { nx, w, ne, nz, .. } = plan.sizes;
        self.d.copy_from_slice(&work[o.d..o.d + nz * ne]);
        self.lu.copy_from_slice(&work[o.b..o.b + nz * nz]);
        self.t.copy_from_slice(&work[o.t..o.t + nz * w]);
        for i in 0..nz {
            for l in 0..ne {
                let d = self.d[i * ne + l];
                if d != ZERO {
                    let d = load(simd, &d);
                    let row = &mut self.lu[i * nz..(i + 1) * nz];
                    axpy(simd, d, &self.s[l * nz..(l + 1) * nz], row);
                    let row = &mut self.t[i * w..i * w + nx];
                    axpy(simd, -d, &self.e[l * nx..(l + 1) * nx], row);
                }
            }
        }
        lu_factor(simd, &mut self.lu, nz, &mut self.pivots)?;
        lu_solve(simd, &self.lu, nz, &self.pivots, &mut self.t, w);
        Ok(())
    }

    /// `W`: the cost-to-go `v` and the step's own Hessian in x'; keeps what a solve needs of it.
    #[inline(always)]
    pub(super) fn carry<S: Simd>(&mut self, simd: S, plan: &Plan, work: &[Lane], v: &mut [Lane]) {
        let o = plan.offsets;
        let Sizes { nx, w, ne, nz, .. } = plan.sizes;
        for i in 0..ne {
            for j in 0..ne {
                let v = &mut v[i * w + j];
                *v = add(simd, v, &work[o.fe + i * ne + j]);
            }
            axpy(
                simd,
                all(simd, 1.0),
                &work[o.fx + i * w + nx..o.fx + (i + 1) * w],
                &mut v[i * w + nx..(i + 1) * w],
            );
            self.we[i * w..(i + 1) * w].copy_from_slice(&v[i * w..(i + 1) * w]);
            self.fz[i * nz..(i + 1) * nz]
                .copy_from_slice(&work[o.fz + i * nz..o.fz + (i + 1) * nz]);
            self.fx[i * nx..(i + 1) * nx].copy_from_slice(&work[o.fx + i * w..o.fx + i * w + nx]);
        }
    }

    /// `G = N + M T`; with `F = N + ½ M T` the new quadratic is `Q + Tᵀ F + Fᵀ T`. Its part in the
    /// parameters goes to `kpp`; `f`: memory of nz × w.
    #[inline(always)]
    pub(super) fn reduce<S: Simd>(
        &mut self,
        simd: S,
        sizes: Sizes,
        quadratic: &mut Quadratic<'_>,
        f: &mut [Lane],
        kpp: &mut [Lane],
    ) {
        let Sizes { nx, np, w, nz, .. } = sizes;
        let Quadratic { m, n, q } = quadratic;
        let (t, half) = (&self.t, all(simd, 0.5));
        self.m.copy_from_slice(m);
        for i in 0..nz {
            let row = &mut self.g[i * w..(i + 1) * w];
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
                let row = &mut kpp[i * np + i..(i + 1) * np];
                let (a, b) = both(at);
                axpy2(simd, (a, &fj[at..nx + np]), (b, &tj[at..nx + np]), row);
            }
        }
    }

    /// End state: `C x' = C (E + S T_x) x + (C_p + C S T_p) p`; `c` in, `next` out, nx × w.
    #[inline(always)]
    pub(super) fn end_state<S: Simd>(
        &mut self,
        simd: S,
        sizes: Sizes,
        c: &[Lane],
        next: &mut [Lane],
    ) {
        let Sizes { nx, w, ne, nz, .. } = sizes;
        for i in 0..nx {
            let (row, out) = (&c[i * w..(i + 1) * w], &mut next[i * w..(i + 1) * w]);
            self.end[i * nx..(i + 1) * nx].copy_from_slice(&row[..nx]);
            out[..nx].fill(ZERO);
            out[nx..].copy_from_slice(&row[nx..]);
            for l in 0..ne {
                let a = load(simd, &row[l]);
                axpy(simd, a, &self.e[l * nx..(l + 1) * nx], &mut out[..nx]);
            }
            for j in 0..nz {
                let a = dot(simd, nx, (row, 1), (&self.s[j..], nz));
                if a != ZERO {
                    axpy(simd, load(simd, &a), &self.t[j * w..(j + 1) * w], out);
                }
            }
        }
    }
}
