//! [`ExplicitForm`] at four nodes at once, for programs that evaluate it at every node of a record.

use super::explicit_form::ExplicitForm;
use pid_lanes::kernel::{Simd, SimdFloat, all, axpy, axpy2, load, widest};
use pid_runtime::lanes::{Lane, LanesAt};

/// Solutions at four nodes. Constraints, Jacobian and Hessian of an iteration meet at the same
/// nodes, and each goes on where the one before it stopped.
#[derive(Debug, Clone, Default)]
pub(super) struct SolvedLanes {
    /// (q, v, u) and p it belongs to.
    point: Vec<Lane>,
    parameters: Vec<f64>,
    /// Cholesky factor of M with the inverse of its diagonal, and a*.
    mass: Vec<Lane>,
    acceleration: Vec<Lane>,
    /// ∂a*/∂y, nq × active; empty until it is asked for.
    slope: Vec<Lane>,
}

impl SolvedLanes {
    fn belongs_to(&self, at: &LanesAt<'_>) -> bool {
        let (nq, nu) = (at.q.len(), at.u.len());
        self.point.len() == 2 * nq + nu
            && self.point[..nq] == *at.q
            && self.point[nq..2 * nq] == *at.v
            && self.point[2 * nq..] == *at.u
            && self.parameters == at.p
    }

    fn begin(&mut self, at: &LanesAt<'_>) {
        self.point.clear();
        for part in [at.q, at.v, at.u] {
            self.point.extend_from_slice(part);
        }
        self.parameters.clear();
        self.parameters.extend_from_slice(at.p);
        self.slope.clear();
    }
}

/// Scratch space of one thread, kept from call to call.
#[derive(Debug, Default)]
pub(super) struct LaneWork {
    residual: Vec<Lane>,
    values: Vec<Lane>,
    nu: Vec<Lane>,
    /// Second derivatives of the solved form, then H_ay, nq × active, then unused values.
    second: Vec<Lane>,
}

fn resize(v: &mut Vec<Lane>, n: usize) {
    v.clear();
    v.resize(n, [0.0; 4]);
}

/// Cholesky of packed lower triangles in place, the inverse on the diagonal; NaN there if one is
/// not positive definite.
#[inline(always)]
fn cholesky<S: Simd>(simd: S, m: &mut [Lane], n: usize) {
    for i in 0..n {
        let row = i * (i + 1) / 2;
        for j in 0..=i {
            let other = j * (j + 1) / 2;
            let mut sum = load(simd, &m[row + j]);
            for k in 0..j {
                sum -= load(simd, &m[row + k]) * load(simd, &m[other + k]);
            }
            m[row + j] = if i == j {
                (all(simd, 1.0) / sum.sqrt()).into()
            } else {
                (sum * load(simd, &m[other + j])).into()
            };
        }
    }
}

/// Solves with the factors in place for the rows of `b`, each `width` long.
#[inline(always)]
fn cholesky_solve<S: Simd>(simd: S, m: &[Lane], n: usize, b: &mut [Lane], width: usize) {
    let entry = |i: usize, j: usize| load(simd, &m[i * (i + 1) / 2 + j]);
    for i in 0..n {
        let (above, rest) = b.split_at_mut(i * width);
        let row = &mut rest[..width];
        for k in 0..i {
            axpy(simd, -entry(i, k), &above[k * width..(k + 1) * width], row);
        }
        let inverse = entry(i, i);
        for b in row {
            *b = (inverse * load(simd, b)).into();
        }
    }
    for i in (0..n).rev() {
        let (head, below) = b.split_at_mut((i + 1) * width);
        let row = &mut head[i * width..];
        for k in i + 1..n {
            let at = (k - i - 1) * width;
            axpy(simd, -entry(k, i), &below[at..at + width], row);
        }
        let inverse = entry(i, i);
        for b in row {
            *b = (inverse * load(simd, b)).into();
        }
    }
}

/// Adds `value` of each entry to the place of the entry.
#[inline(always)]
fn gather<S: Simd>(simd: S, places: &[u32], values: &[Lane], out: &mut [Lane]) {
    for (at, value) in places.iter().zip(values) {
        let out = &mut out[*at as usize];
        *out = (load(simd, out) + load(simd, value)).into();
    }
}

/// Adds `m sᵀ + s mᵀ` to a packed lower triangle for every pair of rows of `mixed` and `slope`.
#[inline(always)]
fn add_products<S: Simd>(simd: S, mixed: &[Lane], slope: &[Lane], width: usize, out: &mut [Lane]) {
    let rows = slope.chunks_exact(width).zip(mixed.chunks_exact(width));
    for (slope, mixed) in rows {
        let mut rest = &mut *out;
        for i in 0..width {
            let (row, below) = rest.split_at_mut(i + 1);
            rest = below;
            let (m, s) = (load(simd, &mixed[i]), load(simd, &slope[i]));
            axpy2(simd, (m, slope), (s, mixed), row);
        }
    }
}

impl ExplicitForm<'_> {
    /// Factor of M and a*.
    fn solve_lanes(&self, at: &LanesAt<'_>, s: &mut SolvedLanes, work: &mut LaneWork) {
        if s.belongs_to(at) {
            return;
        }
        let dims = self.model.dims();
        s.begin(at);
        resize(&mut s.mass, dims.nm());
        resize(&mut s.acceleration, dims.nq);
        resize(&mut work.residual, dims.nq);
        self.model.mass_matrix_lanes(at, &mut s.mass);
        let point = LanesAt {
            a: &s.acceleration,
            ..*at
        };
        self.model.residual_lanes(&point, &mut work.residual);
        widest!(simd => {
            cholesky(simd, &mut s.mass, dims.nq);
            for (a, r) in s.acceleration.iter_mut().zip(&work.residual) {
                *a = (-load(simd, r)).into();
            }
            cholesky_solve(simd, &s.mass, dims.nq, &mut s.acceleration, 1);
        });
    }

    /// ∂a*/∂y beside the results of [`Self::solve_lanes`].
    fn slope_lanes(&self, at: &LanesAt<'_>, s: &mut SolvedLanes, work: &mut LaneWork) {
        self.solve_lanes(at, s, work);
        if !s.slope.is_empty() {
            return;
        }
        let (nq, width) = (self.model.dims().nq, self.active.len());
        resize(&mut work.values, self.model.jacobian_pattern().nnz());
        resize(&mut work.residual, nq);
        resize(&mut s.slope, nq * width);
        let point = LanesAt {
            a: &s.acceleration,
            ..*at
        };
        self.model
            .residual_jacobian_lanes(&point, &mut work.residual, &mut work.values);
        for (place, value) in self.slope_places.iter().zip(&work.values) {
            if let Some(at) = place {
                s.slope[*at as usize] = value.map(|v| -v);
            }
        }
        widest!(simd => cholesky_solve(simd, &s.mass, nq, &mut s.slope, width));
    }

    /// The residual, with the stored solutions of the nodes.
    pub(super) fn residual_of_lanes(
        &self,
        at: &LanesAt<'_>,
        s: &mut SolvedLanes,
        work: &mut LaneWork,
        r: &mut [Lane],
    ) {
        self.solve_lanes(at, s, work);
        for (r, (a, solved)) in r.iter_mut().zip(at.a.iter().zip(&s.acceleration)) {
            *r = std::array::from_fn(|l| a[l] - solved[l]);
        }
    }

    /// The Jacobian, with the stored solutions of the nodes.
    pub(super) fn jacobian_of_lanes(
        &self,
        at: &LanesAt<'_>,
        s: &mut SolvedLanes,
        work: &mut LaneWork,
        values: &mut [Lane],
    ) {
        self.slope_lanes(at, s, work);
        for (value, place) in values.iter_mut().zip(&self.jacobian_places) {
            *value = match place {
                Some(at) => s.slope[*at as usize].map(|x| -x),
                None => [1.0; 4],
            };
        }
    }

    /// The Hessian, with the stored solutions of the nodes.
    pub(super) fn hessian_of_lanes<'w>(
        &self,
        at: &LanesAt<'_>,
        lambda: &[Lane],
        s: &mut SolvedLanes,
        work: &'w mut LaneWork,
    ) -> &'w [Lane] {
        self.slope_lanes(at, s, work);
        let dims = self.model.dims();
        let (nq, width) = (dims.nq, self.active.len());
        let pairs = width * (width + 1) / 2;
        work.nu.clear();
        work.nu.extend_from_slice(lambda);
        resize(&mut work.values, self.model.hessian_pattern().nnz());
        resize(&mut work.second, pairs + nq * width + 1);
        widest!(simd => cholesky_solve(simd, &s.mass, nq, &mut work.nu, 1));
        let point = LanesAt {
            a: &s.acceleration,
            ..*at
        };
        self.model
            .residual_hessian_lanes(&point, &work.nu, &mut work.values);
        let (values, places) = (&work.values, &self.second_places);
        let (second, slope) = (&mut work.second, &s.slope);
        widest!(simd => {
            gather(simd, places, values, second);
            let (second, mixed) = second.split_at_mut(pairs);
            add_products(simd, &mixed[..nq * width], slope, width.max(1), second);
        });
        &work.second[..pairs]
    }
}
