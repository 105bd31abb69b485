//! Solves with the condensed segments: right-hand sides in, steps out; products with the matrix.

use pid_lanes::kernel::{Simd, SimdFloat, all, axpy, axpy2, load, widest};
use pid_lanes::{LANES, Lane};

use super::{Group, ZERO, dot, mul, pack, pick, places, put, set};
use crate::solver::kkt::layout::Layout;
use crate::solver::kkt::structured::plan::Sizes;
use crate::solver::kkt::structured::small::{lu_solve, lu_solve_transpose};

impl Group {
    /// Reduces a right-hand side: leaves `v_lin`, `p_lin`, `c_lin`.
    pub(in super::super) fn reduce(
        &mut self,
        sizes: Sizes,
        layout: &Layout,
        rx: &[f64],
        rc: &[f64],
    ) {
        widest!(simd => self.reduce_with(simd, sizes, layout, rx, rc));
    }

    #[inline(always)]
    fn reduce_with<S: Simd>(
        &mut self,
        simd: S,
        sizes: Sizes,
        layout: &Layout,
        rx: &[f64],
        rc: &[f64],
    ) {
        let Sizes {
            nx,
            ny,
            np,
            w,
            ne,
            nz,
        } = sizes;
        let ns = sizes.ns();
        self.p_lin.fill(ZERO);
        self.c_lin.fill(ZERO);
        self.v_lin.fill(ZERO);
        for (l, s) in self.segments.iter().enumerate().filter(|(_, s)| s.last()) {
            let at = layout.state(&s.window, s.window.steps);
            for i in 0..nx {
                self.v_lin[i][l] = -rx[at + i];
            }
        }
        for k in (0..self.steps.len()).rev() {
            let row = self.places(k, |s| s.window.row + (s.start + k) * ny);
            let y = self.places(k, |s| layout.step(&s.window, s.start + k));
            let x = self.places(k, |s| layout.state(&s.window, s.start + k));
            let step = &mut self.steps[k];
            for i in 0..ne {
                step.shift[i] = mul(simd, &step.r[i], &pick(rc, &row, i));
            }
            let shift = &step.shift;
            for i in 0..nz {
                let moved = dot(simd, ne, (&step.d[i * ne..], 1), (shift, 1));
                let own = pick(rc, &row, ne + i);
                step.offset[i] = (load(simd, &own) - load(simd, &moved)).into();
            }
            lu_solve(simd, &step.lu, nz, &step.pivots, &mut step.offset, 1);
            // Gradient of the cost-to-go at x' = e.
            step.ahead.copy_from_slice(&self.v_lin);
            for l in 0..ne {
                let a = load(simd, &shift[l]);
                axpy(simd, a, &step.we[l * w..l * w + nx], &mut self.v_lin);
                let row = &step.we[l * w + nx..l * w + nx + np];
                axpy(simd, a, row, &mut self.p_lin);
            }
            for i in 0..nz {
                let own = if i < ns { pick(rx, &y, i) } else { ZERO };
                let through = dot(simd, nx, (&step.s[i..], nz), (&self.v_lin, 1));
                let sum = load(simd, &through) - load(simd, &own);
                let cross = if ne > 0 {
                    dot(simd, ne, (&step.fz[i..], nz), (shift, 1))
                } else {
                    ZERO
                };
                step.gradient[i] = (sum + load(simd, &cross)).into();
            }
            for l in 0..nx {
                let through = dot(simd, nz, (&step.s[l * nz..], 1), (&step.offset, 1));
                let own = if l < ne { shift[l] } else { ZERO };
                let next = load(simd, &through) + load(simd, &own);
                for i in 0..nx {
                    let to = &mut self.c_lin[i];
                    let map = load(simd, &step.end[i * nx + l]);
                    *to = map.mul_add(next, load(simd, to)).into();
                }
            }
            // From the gradient at x' to that at x.
            let at_next = &mut self.small[..nx];
            at_next.copy_from_slice(&self.v_lin);
            for i in 0..nx {
                let mut sum = -load(simd, &pick(rx, &x, i));
                for l in 0..ne {
                    let e = load(simd, &step.e[l * nx + i]);
                    sum = e.mul_add(load(simd, &at_next[l]), sum);
                    let f = load(simd, &step.fx[l * nx + i]);
                    sum = f.mul_add(load(simd, &shift[l]), sum);
                }
                self.v_lin[i] = sum.into();
            }
            for j in 0..nz {
                let (a, b) = (load(simd, &step.gradient[j]), load(simd, &step.offset[j]));
                let (tj, gj) = (&step.t[j * w..(j + 1) * w], &step.g[j * w..(j + 1) * w]);
                axpy2(simd, (a, &tj[..nx]), (b, &gj[..nx]), &mut self.v_lin);
                let (tj, gj) = (&tj[nx..nx + np], &gj[nx..nx + np]);
                axpy2(simd, (a, tj), (b, gj), &mut self.p_lin);
            }
        }
    }

    /// Recovers the unknowns and multipliers of the segments' steps from `x` (first states,
    /// overwritten), `p` and the multipliers `nu` of the end states (zero for last segments).
    pub(in super::super) fn expand(
        &mut self,
        sizes: Sizes,
        layout: &Layout,
        (x, p, nu): (&mut [Lane], &[f64], &[Lane]),
        (dx, dlambda): (&mut [f64], &mut [f64]),
    ) {
        widest!(simd => self.expand_with(simd, sizes, layout, (x, p, nu), (dx, dlambda)));
    }

    #[inline(always)]
    fn expand_with<S: Simd>(
        &mut self,
        simd: S,
        sizes: Sizes,
        layout: &Layout,
        (x, p, nu): (&mut [Lane], &[f64], &[Lane]),
        (dx, dlambda): (&mut [f64], &mut [f64]),
    ) {
        let Sizes {
            nx, ny, w, ne, nz, ..
        } = sizes;
        let ns = sizes.ns();
        let (z, rest) = self.work.split_at_mut(nz);
        let (state, rest) = rest.split_at_mut(nx);
        let (linear, rest) = rest.split_at_mut(ne);
        let core = &mut rest[..nz];
        for (k, step) in self.steps.iter().enumerate() {
            // The core unknowns are the stages and the last components of the next state.
            for i in 0..nz {
                let (ti, gi) = (&step.t[i * w..], &step.g[i * w..]);
                let mut zi = load(simd, &step.offset[i]);
                let mut li = load(simd, &step.gradient[i]);
                for ((t, g), x) in ti.iter().zip(gi).zip(&*x) {
                    let x = load(simd, x);
                    zi = x.mul_add(load(simd, t), zi);
                    li = x.mul_add(load(simd, g), li);
                }
                for ((t, g), p) in ti[nx..].iter().zip(&gi[nx..]).zip(p) {
                    let p = all(simd, *p);
                    zi = p.mul_add(load(simd, t), zi);
                    li = p.mul_add(load(simd, g), li);
                }
                let own = dot(simd, nz, (&step.m[i * nz..], 1), (&step.offset, 1));
                z[i] = zi.into();
                core[i] = (-(li + load(simd, &own))).into();
            }
            for i in 0..ne {
                let mut sum = load(simd, &step.shift[i]);
                for j in 0..nx {
                    sum = load(simd, &step.e[i * nx + j]).mul_add(load(simd, &x[j]), sum);
                }
                for j in 0..nz {
                    sum = load(simd, &step.s[i * nz + j]).mul_add(load(simd, &z[j]), sum);
                }
                state[i] = sum.into();
            }
            state[ne..].copy_from_slice(&z[ns..]);
            for l in 0..nx {
                let along = load(simd, &dot(simd, nx, (&step.end[l..], nx), (nu, 1)));
                for i in 0..nz {
                    let s = load(simd, &step.s[l * nz + i]);
                    core[i] = (load(simd, &core[i]) - s * along).into();
                }
                if l < ne {
                    linear[l] = (-along).into();
                }
            }
            lu_solve_transpose(simd, &step.lu, nz, &step.pivots, core);
            // Stationarity with respect to x'_e.
            for l in 0..ne {
                let mut sum = load(simd, &step.ahead[l]);
                let we = &step.we[l * w..];
                for j in 0..nx {
                    sum = load(simd, &we[j]).mul_add(load(simd, &state[j]), sum);
                    sum = load(simd, &step.fx[l * nx + j]).mul_add(load(simd, &x[j]), sum);
                }
                for (w, p) in we[nx..].iter().zip(p) {
                    sum = load(simd, w).mul_add(all(simd, *p), sum);
                }
                for j in 0..nz {
                    sum = load(simd, &step.fz[l * nz + j]).mul_add(load(simd, &z[j]), sum);
                    sum = load(simd, &step.d[j * ne + l]).mul_add(load(simd, &core[j]), sum);
                }
                let rest = load(simd, &linear[l]) - sum;
                linear[l] = (load(simd, &step.r[l]) * rest).into();
            }
            let y = places(&self.segments, k, |s| layout.step(&s.window, s.start + k));
            let row = places(&self.segments, k, |s| s.window.row + (s.start + k) * ny);
            for (i, z) in z[..ns].iter().chain(&*state).enumerate() {
                set(dx, &y, i, *z);
            }
            for (i, lambda) in linear.iter().chain(&*core).enumerate() {
                set(dlambda, &row, i, *lambda);
            }
            x.copy_from_slice(state);
        }
    }

    /// `rx += H dx + Jᵀ dλ`, `rc += J dx` for the steps' values, the parts of the parameters' rows in `rp`.
    pub(in super::super) fn add_product(
        &self,
        layout: &Layout,
        (dx, dlambda): (&[f64], &[f64]),
        (rx, rc): (&mut [f64], &mut [f64]),
        (local, rp): (&mut Vec<Lane>, &mut [f64]),
    ) {
        widest!(simd => self.product_with(simd, layout, (dx, dlambda), (rx, rc), (local, rp)));
    }

    #[inline(always)]
    fn product_with<S: Simd>(
        &self,
        simd: S,
        layout: &Layout,
        (dx, dlambda): (&[f64], &[f64]),
        (rx, rc): (&mut [f64], &mut [f64]),
        (local, rp): (&mut Vec<Lane>, &mut [f64]),
    ) {
        let (nx, ny, np) = (layout.nx, layout.ny, layout.np);
        let (nj, nh) = (layout.step_jacobian.len(), layout.step_hessian.len());
        // x_k and y_k stand side by side: a step's variables are one run of them, then the parameters.
        let (own, size) = (nx + ny, nx + ny + np);
        local.clear();
        local.resize(2 * size + 2 * ny, ZERO);
        let (x, rest) = local.split_at_mut(size);
        let (r, rest) = rest.split_at_mut(size);
        let (lambda, c) = rest.split_at_mut(ny);
        for (to, p) in x[own..].iter_mut().zip(&dx[layout.p()..]) {
            *to = [*p; LANES];
        }
        for k in 0..self.steps.len() {
            let at = self.places(k, |s| layout.state(&s.window, s.start + k));
            let row = self.places(k, |s| s.window.row + (s.start + k) * ny);
            pack(dx, &at, own, x);
            pack(dlambda, &row, ny, lambda);
            r[..own].fill(ZERO);
            c.fill(ZERO);
            let values = &self.hessian[k * nh..(k + 1) * nh];
            for (&(i, j), a) in layout.step_hessian.iter().zip(values) {
                let (i, j, a) = (i as usize, j as usize, load(simd, a));
                r[i] = a.mul_add(load(simd, &x[j]), load(simd, &r[i])).into();
                if i != j {
                    r[j] = a.mul_add(load(simd, &x[i]), load(simd, &r[j])).into();
                }
            }
            let values = &self.jacobian[k * nj..(k + 1) * nj];
            for (&(i, j), a) in layout.step_jacobian.iter().zip(values) {
                let (i, j, a) = (i as usize, j as usize, load(simd, a));
                c[i] = a.mul_add(load(simd, &x[j]), load(simd, &c[i])).into();
                let sum = a.mul_add(load(simd, &lambda[i]), load(simd, &r[j]));
                r[j] = sum.into();
            }
            for (i, r) in r[..own].iter().enumerate() {
                put(rx, &at, i, *r);
            }
            for (i, c) in c.iter().enumerate() {
                put(rc, &row, i, *c);
            }
        }
        for (to, from) in rp.iter_mut().zip(&r[own..]) {
            *to += from.iter().sum::<f64>();
        }
    }
}
