//! A model with its accelerations solved for: `r̃ = a − a*(q, v, u, p)`, where `a*` solves the residual.
//!
//! The same motions satisfy both forms, but Newton steps differ: for stiff explicit steps the
//! solved form finds better optima (docs/decisions/0002). Derivatives follow from those of the
//! residual by the implicit function rule with one factorization of M, never from a symbolic
//! inverse:
//!
//! ```text
//! ∂a*/∂y       = −M⁻¹ r_y                                                    y = (q, v, u, p)
//! ∇²(λᵀ a*)    = −(H_yy + H_ya a_y + a_yᵀ H_ay),   H = ∇²(νᵀ r) at a = a*,  ν = M⁻¹ λ      (r_aa = 0)
//! ```

use pid_runtime::dynamics::{
    At, Dims, Dynamics, Hessian, InputInfo, Jacobian, JointInfo, ParamInfo, Pattern,
};
use std::cell::RefCell;

/// The explicit form of a model, itself a model whose mass matrix is the identity.
pub struct ExplicitForm<'m> {
    pub(super) model: &'m dyn Hessian,
    /// Columns of z, accelerations excepted, that a* depends on.
    pub(super) active: Vec<usize>,
    /// Place in ∂a*/∂y, nq × active, of the entries of the model's Jacobian and of the form's own,
    /// none for accelerations.
    pub(super) slope_places: Vec<Option<u32>>,
    pub(super) jacobian_places: Vec<Option<u32>>,
    /// Place of each entry of the model's Hessian: among the pairs of active columns, among the
    /// products of accelerations with active columns behind them, or behind both.
    pub(super) second_places: Vec<u32>,
    jacobian_rows: Vec<u32>,
    jacobian_cols: Vec<u32>,
    hessian_rows: Vec<u32>,
    hessian_cols: Vec<u32>,
}

/// Scratch space of one thread, kept from call to call.
#[derive(Debug, Default)]
struct Work {
    /// Cholesky factor of M, and a*.
    mass: Vec<f64>,
    acceleration: Vec<f64>,
    /// ∂a*/∂y, nq × active.
    slope: Vec<f64>,
    residual: Vec<f64>,
    values: Vec<f64>,
    nu: Vec<f64>,
    /// Second derivatives of the solved form, then H_ay, nq × active, then unused values.
    second: Vec<f64>,
}

thread_local! {
    static SCRATCH: RefCell<Work> = RefCell::default();
}

fn resize(v: &mut Vec<f64>, n: usize) {
    v.clear();
    v.resize(n, 0.0);
}

/// Cholesky of a packed lower triangle in place; NaN on the diagonal if it is not positive definite.
fn cholesky(m: &mut [f64], n: usize) {
    for i in 0..n {
        for j in 0..=i {
            let mut sum = m[i * (i + 1) / 2 + j];
            for k in 0..j {
                sum -= m[i * (i + 1) / 2 + k] * m[j * (j + 1) / 2 + k];
            }
            m[i * (i + 1) / 2 + j] = if i == j {
                sum.sqrt()
            } else {
                sum / m[j * (j + 1) / 2 + j]
            };
        }
    }
}

/// Solves with the factor in place for the rows of `b`, each `width` long.
fn cholesky_solve(m: &[f64], n: usize, b: &mut [f64], width: usize) {
    let entry = |i: usize, j: usize| m[i * (i + 1) / 2 + j];
    for i in 0..n {
        let (above, rest) = b.split_at_mut(i * width);
        let row = &mut rest[..width];
        for k in 0..i {
            eliminate(row, entry(i, k), &above[k * width..(k + 1) * width]);
        }
        let inverse = 1.0 / entry(i, i);
        row.iter_mut().for_each(|b| *b *= inverse);
    }
    for i in (0..n).rev() {
        let (head, below) = b.split_at_mut((i + 1) * width);
        let row = &mut head[i * width..];
        for k in i + 1..n {
            let at = (k - i - 1) * width;
            eliminate(row, entry(k, i), &below[at..at + width]);
        }
        let inverse = 1.0 / entry(i, i);
        row.iter_mut().for_each(|b| *b *= inverse);
    }
}

/// `row −= factor · other`.
fn eliminate(row: &mut [f64], factor: f64, other: &[f64]) {
    for (r, o) in row.iter_mut().zip(other) {
        *r -= factor * o;
    }
}

impl<'m> ExplicitForm<'m> {
    /// Wraps a model.
    pub fn new(model: &'m dyn Hessian) -> Self {
        let dims = model.dims();
        let acceleration = |z: usize| (dims.a()..dims.u()).contains(&z);
        let mut place = vec![None; dims.nz()];
        for &z in model.jacobian_pattern().cols {
            if !acceleration(z as usize) {
                place[z as usize] = Some(0);
            }
        }
        let active: Vec<usize> = (0..dims.nz()).filter(|&z| place[z].is_some()).collect();
        for (k, &z) in active.iter().enumerate() {
            place[z] = Some(k);
        }
        let (mut jacobian_rows, mut jacobian_cols) = (Vec::new(), Vec::new());
        for row in 0..dims.nq {
            let mut columns = active.clone();
            columns.push(dims.a() + row);
            columns.sort_unstable();
            for z in columns {
                jacobian_rows.push(row as u32);
                jacobian_cols.push(z as u32);
            }
        }
        let (mut hessian_rows, mut hessian_cols) = (Vec::new(), Vec::new());
        for (i, &row) in active.iter().enumerate() {
            for &col in &active[..=i] {
                hessian_rows.push(row as u32);
                hessian_cols.push(col as u32);
            }
        }
        let width = active.len();
        let at_slope = |row: u32, col: u32| {
            let column = place[col as usize]?;
            Some((row as usize * width + column) as u32)
        };
        let pattern = model.jacobian_pattern();
        let pairs = pattern.rows.iter().zip(pattern.cols);
        let slope_places = pairs.map(|(&row, &col)| at_slope(row, col)).collect();
        let pairs = jacobian_rows.iter().zip(&jacobian_cols);
        let jacobian_places = pairs.map(|(&row, &col)| at_slope(row, col)).collect();
        let triangle = width * (width + 1) / 2;
        let pattern = model.hessian_pattern();
        let pairs = pattern.rows.iter().zip(pattern.cols);
        let second_places = pairs
            .map(|(&row, &col)| {
                let (row, col) = (row as usize, col as usize);
                let at = match (place[row], place[col]) {
                    (Some(i), Some(j)) => i.max(j) * (i.max(j) + 1) / 2 + i.min(j),
                    (Some(i), None) => triangle + (col - dims.a()) * width + i,
                    (None, Some(j)) => triangle + (row - dims.a()) * width + j,
                    (None, None) => triangle + dims.nq * width,
                };
                at as u32
            })
            .collect();
        Self {
            model,
            active,
            slope_places,
            jacobian_places,
            second_places,
            jacobian_rows,
            jacobian_cols,
            hessian_rows,
            hessian_cols,
        }
    }

    /// Factor of M and a*.
    fn solve(&self, at: &At<'_>, w: &mut Work) {
        let dims = self.model.dims();
        resize(&mut w.mass, dims.nm());
        resize(&mut w.acceleration, dims.nq);
        resize(&mut w.residual, dims.nq);
        self.model.mass_matrix(at, &mut w.mass);
        cholesky(&mut w.mass, dims.nq);
        let point = At {
            a: &w.acceleration,
            ..*at
        };
        self.model.residual(&point, &mut w.residual);
        for (a, r) in w.acceleration.iter_mut().zip(&w.residual) {
            *a = -r;
        }
        cholesky_solve(&w.mass, dims.nq, &mut w.acceleration, 1);
    }

    /// ∂a*/∂y beside the results of [`Self::solve`].
    fn slope(&self, at: &At<'_>, w: &mut Work) {
        self.solve(at, w);
        let (nq, width) = (self.model.dims().nq, self.active.len());
        resize(&mut w.values, self.model.jacobian_pattern().nnz());
        resize(&mut w.slope, nq * width);
        let point = At {
            a: &w.acceleration,
            ..*at
        };
        self.model
            .residual_jacobian(&point, &mut w.residual, &mut w.values);
        for (place, value) in self.slope_places.iter().zip(&w.values) {
            if let Some(at) = place {
                w.slope[*at as usize] = -value;
            }
        }
        cholesky_solve(&w.mass, nq, &mut w.slope, width);
    }
}

/// `r = a − a*`.
fn difference(a: &[f64], solved: &[f64], r: &mut [f64]) {
    for (r, (a, solved)) in r.iter_mut().zip(a.iter().zip(solved)) {
        *r = a - solved;
    }
}

/// Adds `m sᵀ + s mᵀ` to a packed lower triangle for every pair of rows of `mixed` and `slope`.
fn add_products(mixed: &[f64], slope: &[f64], width: usize, out: &mut [f64]) {
    let rows = slope.chunks_exact(width).zip(mixed.chunks_exact(width));
    for (slope, mixed) in rows {
        let mut rest = &mut *out;
        for i in 0..width {
            let (row, below) = rest.split_at_mut(i + 1);
            rest = below;
            let (m, d) = (mixed[i], slope[i]);
            for ((out, slope), mixed) in row.iter_mut().zip(slope).zip(mixed) {
                *out += m * slope + d * mixed;
            }
        }
    }
}

impl Dynamics for ExplicitForm<'_> {
    fn name(&self) -> &str {
        self.model.name()
    }
    fn dims(&self) -> Dims {
        self.model.dims()
    }
    fn params(&self) -> &[ParamInfo] {
        self.model.params()
    }
    fn joints(&self) -> &[JointInfo] {
        self.model.joints()
    }
    fn inputs(&self) -> &[InputInfo] {
        self.model.inputs()
    }
    fn mass_matrix(&self, _: &At<'_>, m: &mut [f64]) {
        m.fill(0.0);
        for i in 0..self.model.dims().nq {
            m[i * (i + 1) / 2 + i] = 1.0;
        }
    }
    fn bias(&self, _: &At<'_>, b: &mut [f64]) {
        b.fill(0.0);
    }
    /// a*, the accelerations of the model.
    fn applied_force(&self, at: &At<'_>, f: &mut [f64]) {
        SCRATCH.with_borrow_mut(|w| {
            self.solve(at, w);
            f.copy_from_slice(&w.acceleration);
        });
    }
    fn residual(&self, at: &At<'_>, r: &mut [f64]) {
        SCRATCH.with_borrow_mut(|w| {
            self.solve(at, w);
            difference(at.a, &w.acceleration, r);
        });
    }
    fn kinetic_energy(&self, at: &At<'_>) -> f64 {
        self.model.kinetic_energy(at)
    }
    fn potential_energy(&self, at: &At<'_>) -> f64 {
        self.model.potential_energy(at)
    }
}

impl Jacobian for ExplicitForm<'_> {
    fn jacobian_pattern(&self) -> Pattern<'_> {
        Pattern {
            rows: &self.jacobian_rows,
            cols: &self.jacobian_cols,
        }
    }
    fn residual_jacobian(&self, at: &At<'_>, r: &mut [f64], values: &mut [f64]) {
        SCRATCH.with_borrow_mut(|w| {
            self.slope(at, w);
            difference(at.a, &w.acceleration, r);
            for (value, place) in values.iter_mut().zip(&self.jacobian_places) {
                *value = place.map_or(1.0, |at| -w.slope[at as usize]);
            }
        });
    }
}

impl Hessian for ExplicitForm<'_> {
    fn hessian_pattern(&self) -> Pattern<'_> {
        Pattern {
            rows: &self.hessian_rows,
            cols: &self.hessian_cols,
        }
    }
    fn residual_hessian(&self, at: &At<'_>, lambda: &[f64], values: &mut [f64]) {
        SCRATCH.with_borrow_mut(|w| {
            self.slope(at, w);
            let (nq, width) = (self.model.dims().nq, self.active.len());
            let pairs = values.len();
            w.nu.clear();
            w.nu.extend_from_slice(lambda);
            cholesky_solve(&w.mass, nq, &mut w.nu, 1);
            resize(&mut w.values, self.model.hessian_pattern().nnz());
            resize(&mut w.second, pairs + nq * width + 1);
            let point = At {
                a: &w.acceleration,
                ..*at
            };
            self.model.residual_hessian(&point, &w.nu, &mut w.values);
            for (place, value) in self.second_places.iter().zip(&w.values) {
                w.second[*place as usize] += value;
            }
            let (second, mixed) = w.second.split_at_mut(pairs);
            add_products(&mixed[..nq * width], &w.slope, width.max(1), second);
            values.copy_from_slice(second);
        });
    }
}
