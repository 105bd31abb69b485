//! The nonlinear program of an exciting motion.

use super::criterion::{Criterion, Measured, measure};
use super::fourier::{basis, evaluate};
use super::limits::Limits;
use super::sensitivity::Sensitivity;
use super::settings::Settings;
use super::workspace::{Places, Side};
use nalgebra::DMatrix;
use pid_nlp::{Nlp, SparsePattern};

/// Rows of one sample, in this order, for the joints that are limited so.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Row {
    /// Entry of (q, v, a), scaled by one over half the width of its range, and the middle of the range.
    Motion { z: usize, scale: f64, middle: f64 },
    /// Force of a joint over its limit.
    Force { joint: usize, scale: f64 },
    /// Coordinate of a point in its box.
    Place(Side),
}

impl Row {
    /// Share of the limit that a value of the row uses. A value that is not finite exceeds every
    /// limit.
    fn used(&self, value: f64) -> f64 {
        match self {
            _ if value.is_nan() => f64::INFINITY,
            Self::Place(side) if side.open => value,
            _ => value.abs(),
        }
    }
}

/// The limit that a motion uses most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Binding {
    /// A joint's position, velocity or acceleration.
    Motion,
    /// The force of a joint.
    Force(usize),
    /// A coordinate of a point, and its value.
    Place(usize, f64),
}

/// Minimises a criterion of the information over Fourier coefficients, samples within limits, at
/// rest where a period begins.
pub(super) struct Program<'a> {
    sensitivity: Sensitivity<'a>,
    places: Option<Places<'a>>,
    criterion: Criterion,
    nq: usize,
    /// Coefficients of one joint.
    width: usize,
    /// For each sample the rows of `basis`.
    bases: Vec<f64>,
    samples: usize,
    rows: Vec<Row>,
    at_rest: bool,
    within: f64,
    jacobian: SparsePattern,
    hessian: SparsePattern,
    scratch: Scratch,
}

#[derive(Debug, Default)]
struct Scratch {
    motion: Vec<f64>,
    /// Weighted y times the criterion's gradient, nq × nb.
    g: Vec<f64>,
    /// 3 nq × 3 nq.
    square: Vec<f64>,
    /// nx × nx.
    dense: Vec<f64>,
    /// ∂A/∂x, nx matrices nb × nb.
    da: Vec<f64>,
    lambda: Vec<f64>,
    /// Multipliers of the points' coordinates.
    pull: Vec<f64>,
    row: Vec<f64>,
    turned: DMatrix<f64>,
}

/// Rows that keep positions, velocities, accelerations and forces within their limits.
fn bounds(limits: &Limits<'_>) -> Vec<Row> {
    let nq = limits.v.len();
    let mut rows = Vec::new();
    for j in 0..nq {
        if let Some((low, high)) = limits.q[j] {
            rows.push(Row::Motion {
                z: j,
                scale: 2.0 / (high - low),
                middle: 0.5 * (low + high),
            });
        }
        for (z, limit) in [(nq + j, limits.v[j]), (2 * nq + j, limits.a[j])] {
            rows.push(Row::Motion {
                z,
                scale: 1.0 / limit,
                middle: 0.0,
            });
        }
        if limits.force[j].is_finite() {
            rows.push(Row::Force {
                joint: j,
                scale: 1.0 / limits.force[j],
            });
        }
    }
    rows
}

impl<'a> Program<'a> {
    pub(super) fn new(
        sensitivity: Sensitivity<'a>,
        limits: &Limits<'a>,
        settings: &Settings,
    ) -> Self {
        let nq = limits.v.len();
        let places = limits
            .workspace
            .as_ref()
            .map(|workspace| Places::new(workspace, sensitivity.p(), nq));
        let width = 2 * settings.harmonics + 1;
        let (nx, nb) = (nq * width, sensitivity.nb());
        let mut bases = vec![0.0; settings.samples * 3 * width];
        for (i, rows) in bases.chunks_exact_mut(3 * width).enumerate() {
            let t = settings.period * i as f64 / settings.samples as f64;
            basis(settings.period, settings.harmonics, t, rows);
        }
        let mut rows = bounds(limits);
        let sides = places.as_ref().map_or_else(Vec::new, Places::sides);
        rows.extend(sides.into_iter().map(Row::Place));
        let mut jacobian = SparsePattern::default();
        let mut m = 0;
        for _ in 0..settings.samples {
            for row in &rows {
                let columns = match row {
                    Row::Motion { z, .. } => (z % nq) * width..(z % nq + 1) * width,
                    Row::Force { .. } | Row::Place(_) => 0..nx,
                };
                columns.for_each(|c| jacobian.push(m, c));
                m += 1;
            }
        }
        if settings.at_rest {
            for j in 0..2 * nq {
                ((j % nq) * width..(j % nq + 1) * width).for_each(|c| jacobian.push(m, c));
                m += 1;
            }
        }
        let mut hessian = SparsePattern::default();
        (0..nx).for_each(|r| (0..=r).for_each(|c| hessian.push(r, c)));
        Self {
            criterion: settings.criterion,
            nq,
            width,
            bases,
            samples: settings.samples,
            rows,
            at_rest: settings.at_rest,
            within: 1.0 - settings.margin,
            jacobian,
            hessian,
            scratch: Scratch {
                motion: vec![0.0; 3 * nq],
                g: vec![0.0; nq * nb],
                square: vec![0.0; 9 * nq * nq],
                dense: vec![0.0; nx * nx],
                da: vec![0.0; nx * nb * nb],
                lambda: vec![0.0; nq],
                pull: vec![0.0; places.as_ref().map_or(0, |p| p.x.len())],
                row: vec![0.0; 3 * nq],
                turned: DMatrix::zeros(nb, nb),
            },
            sensitivity,
            places,
        }
    }

    /// Motion at sample i.
    fn place(&mut self, x: &[f64], i: usize) {
        let rows = &self.bases[i * 3 * self.width..(i + 1) * 3 * self.width];
        let (q, rest) = self.scratch.motion.split_at_mut(self.nq);
        let (v, a) = rest.split_at_mut(self.nq);
        evaluate(rows, x, q, v, a);
    }

    /// Mean information of a sample, in scaled parameters.
    pub(super) fn information(&mut self, x: &[f64]) -> DMatrix<f64> {
        let nb = self.sensitivity.nb();
        let mut a = DMatrix::<f64>::zeros(nb, nb);
        for i in 0..self.samples {
            self.place(x, i);
            self.sensitivity.first(&self.scratch.motion);
            for y in self.sensitivity.y.chunks_exact(nb) {
                for (c, yc) in y.iter().enumerate().filter(|(_, y)| **y != 0.0) {
                    for (r, yr) in y.iter().enumerate().skip(c) {
                        a[(r, c)] += yr * yc;
                    }
                }
            }
        }
        a /= self.samples as f64;
        a.fill_upper_triangle_with_lower_triangle();
        a
    }

    fn measured(&mut self, x: &[f64]) -> Measured {
        let a = self.information(x);
        measure(self.criterion, &a)
    }

    /// `g = 2/N y G` and the derivative of the objective by the motion at the current sample, into
    /// `scratch.row`.
    fn pull_back(&mut self, gradient: &DMatrix<f64>) {
        let nb = self.sensitivity.nb();
        let c = 2.0 / self.samples as f64;
        self.scratch.g.fill(0.0);
        for (y, g) in self
            .sensitivity
            .y
            .chunks_exact(nb)
            .zip(self.scratch.g.chunks_exact_mut(nb))
        {
            for (k, y) in y.iter().enumerate().filter(|(_, y)| **y != 0.0) {
                for (g, s) in g.iter_mut().zip(gradient.column(k).iter()) {
                    *g += c * y * s;
                }
            }
        }
        for (row, dy) in self
            .scratch
            .row
            .iter_mut()
            .zip(self.sensitivity.dy.chunks_exact(self.nq * nb))
        {
            *row = dy.iter().zip(&self.scratch.g).map(|(a, b)| a * b).sum();
        }
    }

    /// `out[x] += Φᵀ row` at sample i.
    fn spread(width: usize, nq: usize, basis: &[f64], row: &[f64], out: &mut [f64]) {
        for (z, value) in row.iter().enumerate().filter(|(_, v)| **v != 0.0) {
            let (kind, joint) = (z / nq, z % nq);
            let out = &mut out[joint * width..(joint + 1) * width];
            let basis = &basis[kind * width..(kind + 1) * width];
            out.iter_mut().zip(basis).for_each(|(o, b)| *o += value * b);
        }
    }

    /// Adds `Φᵀ S Φ` of the symmetric S in `scratch.square` (lower triangle) to the lower triangle
    /// of `scratch.dense`.
    fn spread_square(&mut self, i: usize) {
        let (nq, width) = (self.nq, self.width);
        let nx = nq * width;
        let basis = &self.bases[i * 3 * width..(i + 1) * 3 * width];
        let Scratch { square, dense, .. } = &mut self.scratch;
        for r in 0..3 * nq {
            for c in 0..=r {
                let value = square[r * 3 * nq + c];
                if value == 0.0 {
                    continue;
                }
                let mut add = |r: usize, c: usize| {
                    let (rj, cj) = ((r % nq) * width, (c % nq) * width);
                    let br = &basis[(r / nq) * width..][..width];
                    let bc = &basis[(c / nq) * width..][..width];
                    for (k, b) in br.iter().enumerate() {
                        let row = &mut dense[(rj + k) * nx + cj..][..width];
                        let s = value * b;
                        row.iter_mut().zip(bc).for_each(|(o, b)| *o += s * b);
                    }
                };
                add(r, c);
                if r != c {
                    add(c, r);
                }
            }
        }
    }

    /// Adds σ times the objective's Hessian to `scratch.dense`.
    fn add_objective(&mut self, x: &[f64], sigma: f64) {
        let measured = self.measured(x);
        let (nq, nb, width) = (self.nq, self.sensitivity.nb(), self.width);
        let nx = nq * width;
        self.scratch.da.fill(0.0);
        let c = 2.0 / self.samples as f64;
        let scaled = &measured.gradient * (sigma * c);
        let mut product = vec![0.0; nq * nb];
        let mut square = vec![0.0; nb * nb];
        for i in 0..self.samples {
            self.place(x, i);
            let motion = std::mem::take(&mut self.scratch.motion);
            self.sensitivity.first(&motion);
            self.sensitivity.second(&motion);
            self.pull_back(&measured.gradient);
            self.scratch.square.fill(0.0);
            self.scratch.g.iter_mut().for_each(|g| *g *= sigma);
            self.sensitivity.add_regressor_curvature(
                &motion,
                &self.scratch.g,
                &mut self.scratch.square,
            );
            self.scratch.motion = motion;
            let basis = &self.bases[i * 3 * width..(i + 1) * 3 * width];
            for (z, dy) in self.sensitivity.dy.chunks_exact(nq * nb).enumerate() {
                if dy.iter().all(|d| *d == 0.0) {
                    continue;
                }
                product.fill(0.0);
                square.fill(0.0);
                for (j, dy) in dy.chunks_exact(nb).enumerate() {
                    let y = &self.sensitivity.y[j * nb..(j + 1) * nb];
                    for (k, d) in dy.iter().enumerate().filter(|(_, d)| **d != 0.0) {
                        for (p, s) in product[j * nb..(j + 1) * nb]
                            .iter_mut()
                            .zip(scaled.column(k).iter())
                        {
                            *p += d * s;
                        }
                        for (s, y) in square[k * nb..(k + 1) * nb].iter_mut().zip(y) {
                            *s += d * y;
                        }
                    }
                }
                for w in 0..=z {
                    let other = &self.sensitivity.dy[w * nq * nb..(w + 1) * nq * nb];
                    self.scratch.square[z * 3 * nq + w] +=
                        product.iter().zip(other).map(|(a, b)| a * b).sum::<f64>();
                }
                let (kind, joint) = (z / nq, z % nq);
                for (k, b) in basis[kind * width..(kind + 1) * width].iter().enumerate() {
                    let at = (joint * width + k) * nb * nb;
                    let da = &mut self.scratch.da[at..at + nb * nb];
                    let b = b / self.samples as f64;
                    da.iter_mut().zip(&square).for_each(|(o, s)| *o += b * s);
                }
            }
            self.spread_square(i);
        }
        // In the basis of eigenvectors, symmetric.
        let q = &measured.eigen.eigenvectors;
        for da in self.scratch.da.chunks_exact_mut(nb * nb) {
            let half = DMatrix::from_column_slice(nb, nb, da);
            self.scratch.turned = &half + half.transpose();
            let turned = q.tr_mul(&self.scratch.turned) * q;
            da.copy_from_slice(turned.as_slice());
        }
        for r in 0..nx {
            for c in 0..=r {
                let (e, f) = (
                    &self.scratch.da[r * nb * nb..(r + 1) * nb * nb],
                    &self.scratch.da[c * nb * nb..(c + 1) * nb * nb],
                );
                self.scratch.dense[r * nx + c] += sigma * measured.curvature(e, f);
            }
        }
    }
}

impl Nlp for Program<'_> {
    fn n(&self) -> usize {
        self.nq * self.width
    }

    fn m(&self) -> usize {
        self.samples * self.rows.len() + if self.at_rest { 2 * self.nq } else { 0 }
    }

    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        lower.fill(f64::NEG_INFINITY);
        upper.fill(f64::INFINITY);
    }

    fn constraint_bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        let limited = self.samples * self.rows.len();
        for (row, lower) in self.rows.iter().cycle().zip(&mut lower[..limited]) {
            *lower = match row {
                Row::Place(side) if side.open => f64::NEG_INFINITY,
                _ => -self.within,
            };
        }
        upper[..limited].fill(self.within);
        lower[limited..].fill(0.0);
        upper[limited..].fill(0.0);
    }

    fn objective(&mut self, x: &[f64]) -> f64 {
        self.measured(x).value
    }

    fn gradient(&mut self, x: &[f64], gradient: &mut [f64]) {
        gradient.fill(0.0);
        let measured = self.measured(x);
        for i in 0..self.samples {
            self.place(x, i);
            let motion = std::mem::take(&mut self.scratch.motion);
            self.sensitivity.first(&motion);
            self.sensitivity.second(&motion);
            self.scratch.motion = motion;
            self.pull_back(&measured.gradient);
            let basis = &self.bases[i * 3 * self.width..(i + 1) * 3 * self.width];
            Self::spread(self.width, self.nq, basis, &self.scratch.row, gradient);
        }
    }

    fn constraints(&mut self, x: &[f64], c: &mut [f64]) {
        let per = self.rows.len();
        for i in 0..self.samples {
            self.place(x, i);
            self.sensitivity.force(&self.scratch.motion);
            if let Some(places) = &mut self.places {
                places.place(&self.scratch.motion[..self.nq]);
            }
            for (c, row) in c[i * per..(i + 1) * per].iter_mut().zip(&self.rows) {
                *c = match *row {
                    Row::Motion { z, scale, middle } => scale * (self.scratch.motion[z] - middle),
                    Row::Force { joint, scale } => scale * self.sensitivity.force[joint],
                    Row::Place(side) => {
                        let x = self.places.as_ref().map_or(0.0, |p| p.x[side.at]);
                        side.scale * (x - side.middle)
                    }
                };
            }
        }
        if self.at_rest {
            self.place(x, 0);
            c[self.samples * per..].copy_from_slice(&self.scratch.motion[self.nq..]);
        }
    }

    fn jacobian_pattern(&self) -> &SparsePattern {
        &self.jacobian
    }

    fn jacobian(&mut self, x: &[f64], values: &mut [f64]) {
        let (nq, width) = (self.nq, self.width);
        let mut rest = values;
        for i in 0..self.samples {
            self.place(x, i);
            self.sensitivity.first(&self.scratch.motion);
            if let Some(places) = &mut self.places {
                places.slope(&self.scratch.motion[..nq]);
            }
            let basis = &self.bases[i * 3 * width..(i + 1) * 3 * width];
            for row in &self.rows {
                match *row {
                    Row::Motion { z, scale, .. } => {
                        let (out, tail) = rest.split_at_mut(width);
                        rest = tail;
                        let b = &basis[(z / nq) * width..][..width];
                        out.iter_mut().zip(b).for_each(|(o, b)| *o = scale * b);
                    }
                    Row::Force { joint, scale } => {
                        let (out, tail) = rest.split_at_mut(nq * width);
                        rest = tail;
                        out.fill(0.0);
                        let slope = &self.sensitivity.slope[joint * 3 * nq..(joint + 1) * 3 * nq];
                        self.scratch.row.copy_from_slice(slope);
                        self.scratch.row.iter_mut().for_each(|s| *s *= scale);
                        Self::spread(width, nq, basis, &self.scratch.row, out);
                    }
                    Row::Place(side) => {
                        let (out, tail) = rest.split_at_mut(nq * width);
                        rest = tail;
                        out.fill(0.0);
                        self.scratch.row.fill(0.0);
                        let slope = self.places.as_ref().map_or(&[][..], |p| p.row(side.at));
                        for (row, slope) in self.scratch.row.iter_mut().zip(slope) {
                            *row = side.scale * slope;
                        }
                        Self::spread(width, nq, basis, &self.scratch.row, out);
                    }
                }
            }
        }
        if self.at_rest {
            for j in 0..2 * nq {
                let (out, tail) = rest.split_at_mut(width);
                rest = tail;
                out.copy_from_slice(&self.bases[(1 + j / nq) * width..][..width]);
            }
        }
    }

    fn hessian_pattern(&self) -> &SparsePattern {
        &self.hessian
    }

    fn hessian(&mut self, x: &[f64], sigma: f64, lambda: &[f64], values: &mut [f64]) {
        self.scratch.dense.fill(0.0);
        if sigma != 0.0 {
            self.add_objective(x, sigma);
        }
        let per = self.rows.len();
        for i in 0..self.samples {
            self.scratch.lambda.fill(0.0);
            self.scratch.pull.fill(0.0);
            for (row, l) in self.rows.iter().zip(&lambda[i * per..]) {
                match row {
                    Row::Force { joint, scale } => self.scratch.lambda[*joint] = scale * l,
                    Row::Place(side) => self.scratch.pull[side.at] = side.scale * l,
                    Row::Motion { .. } => {}
                }
            }
            self.place(x, i);
            self.scratch.square.fill(0.0);
            let Scratch {
                motion,
                lambda,
                pull,
                square,
                ..
            } = &mut self.scratch;
            let (forced, pulled) = (
                lambda.iter().any(|l| *l != 0.0),
                pull.iter().any(|l| *l != 0.0),
            );
            if forced {
                self.sensitivity.add_force_curvature(motion, lambda, square);
            }
            if let Some(places) = self.places.as_mut().filter(|_| pulled) {
                places.add_curvature(&motion[..self.nq], pull, 3 * self.nq, square);
            }
            if forced || pulled {
                self.spread_square(i);
            }
        }
        let nx = self.nq * self.width;
        let mut values = values.iter_mut();
        for r in 0..nx {
            for c in 0..=r {
                if let Some(v) = values.next() {
                    *v = self.scratch.dense[r * nx + c];
                }
            }
        }
    }
}

impl<'a> Program<'a> {
    /// Largest use of a limit over the samples: 1 at a limit.
    pub(super) fn largest_use(&mut self, x: &[f64]) -> f64 {
        self.binding(x).0
    }

    /// Largest use of a limit over the samples, and which limit.
    pub(super) fn binding(&mut self, x: &[f64]) -> (f64, Binding) {
        let mut c = vec![0.0; self.m()];
        self.constraints(x, &mut c);
        let mut worst = (0.0, Binding::Motion);
        for (row, &c) in self
            .rows
            .iter()
            .cycle()
            .zip(&c[..self.samples * self.rows.len()])
        {
            let used = row.used(c);
            if used > worst.0 {
                let what = match row {
                    Row::Motion { .. } => Binding::Motion,
                    Row::Force { joint, .. } => Binding::Force(*joint),
                    Row::Place(side) => Binding::Place(side.at, c / side.scale + side.middle),
                };
                worst = (used, what);
            }
        }
        worst
    }

    /// The points in their boxes, if there are any.
    pub(super) fn places(&mut self) -> Option<&mut Places<'a>> {
        self.places.as_mut()
    }
}
