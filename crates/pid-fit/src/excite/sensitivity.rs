//! The regressor of chosen parameters along a motion, with its exact derivatives by position,
//! velocity and acceleration.

use super::columns::Columns;
use pid_runtime::dynamics::{At, Dims, Hessian};

/// Points and weights of the derivative along a line: exact for polynomials up to the fourth degree.
const LINE: [(f64, f64); 4] = [
    (1.0, 8.0 / 12.0),
    (-1.0, -8.0 / 12.0),
    (2.0, -1.0 / 12.0),
    (-2.0, 1.0 / 12.0),
];

/// A structural entry of a derivative: where its value stands, its row and its column.
#[derive(Debug, Clone, Copy)]
struct Entry {
    at: usize,
    row: usize,
    col: usize,
}

/// Evaluates a model at nominal parameters with no input: the force a motion needs and its derivatives.
pub(super) struct Sensitivity<'a> {
    model: &'a dyn Hessian,
    dims: Dims,
    p: Vec<f64>,
    u: Vec<f64>,
    scale: Vec<f64>,
    params: Vec<usize>,
    /// One over the standard deviation of the force, per joint.
    weight: Vec<f64>,
    /// Rows: joints; columns: chosen parameters.
    by_param: Vec<Entry>,
    /// Rows: joints; columns: q, v, a.
    by_motion: Vec<Entry>,
    /// Rows: chosen parameters; columns: q, v, a.
    mixed: Vec<Entry>,
    /// Rows and columns: q, v, a; lower triangle.
    motion: Vec<Entry>,
    jacobian: Vec<f64>,
    hessian: Vec<f64>,
    shifted: Vec<f64>,
    unit: Vec<f64>,
    /// The force, nq.
    pub(super) force: Vec<f64>,
    /// ∂force/∂(q, v, a), nq × 3 nq.
    pub(super) slope: Vec<f64>,
    /// Weighted, scaled regressor, nq × nb.
    pub(super) y: Vec<f64>,
    /// Its derivatives: for each of the 3 nq entries of (q, v, a), nq × nb.
    pub(super) dy: Vec<f64>,
}

/// The point of a motion (q, v, a).
fn at<'a>(motion: &'a [f64], u: &'a [f64], p: &'a [f64]) -> At<'a> {
    let (q, rest) = motion.split_at(motion.len() / 3);
    let (v, a) = rest.split_at(q.len());
    At { q, v, a, u, p }
}

impl<'a> Sensitivity<'a> {
    /// `deviations`: standard deviation of the force of each joint.
    pub(super) fn new(
        model: &'a dyn Hessian,
        p: &[f64],
        columns: &Columns,
        deviations: &[f64],
    ) -> Self {
        let dims = model.dims();
        let (nq, nb, nm) = (dims.nq, columns.params.len(), 3 * dims.nq);
        let mut place = vec![None; dims.np];
        for (k, param) in columns.params.iter().enumerate() {
            place[*param] = Some(k);
        }
        let param = |z: usize| z.checked_sub(dims.p()).and_then(|k| place[k]);
        let (mut by_param, mut by_motion) = (Vec::new(), Vec::new());
        let pattern = model.jacobian_pattern();
        for (at, (row, col)) in pattern.rows.iter().zip(pattern.cols).enumerate() {
            let (row, col) = (*row as usize, *col as usize);
            if col < nm {
                by_motion.push(Entry { at, row, col });
            } else if let Some(col) = param(col) {
                by_param.push(Entry { at, row, col });
            }
        }
        let (mut mixed, mut motion) = (Vec::new(), Vec::new());
        let pattern = model.hessian_pattern();
        for (at, (row, col)) in pattern.rows.iter().zip(pattern.cols).enumerate() {
            let (row, col) = (*row as usize, *col as usize);
            if row < nm {
                motion.push(Entry { at, row, col });
            } else if let (Some(row), true) = (param(row), col < nm) {
                mixed.push(Entry { at, row, col });
            }
        }
        Self {
            model,
            dims,
            p: p.to_vec(),
            u: vec![0.0; dims.nu],
            scale: columns.scale.clone(),
            params: columns.params.clone(),
            weight: deviations.iter().map(|s| 1.0 / s).collect(),
            by_param,
            by_motion,
            mixed,
            motion,
            jacobian: vec![0.0; model.jacobian_pattern().nnz()],
            hessian: vec![0.0; model.hessian_pattern().nnz()],
            shifted: p.to_vec(),
            unit: vec![0.0; nq],
            force: vec![0.0; nq],
            slope: vec![0.0; nq * nm],
            y: vec![0.0; nq * nb],
            dy: vec![0.0; nm * nq * nb],
        }
    }

    /// The parameters.
    pub(super) fn p(&self) -> &[f64] {
        &self.p
    }

    /// Number of chosen parameters.
    pub(super) fn nb(&self) -> usize {
        self.params.len()
    }

    /// Force, its slope and the regressor at `motion` = (q, v, a).
    pub(super) fn first(&mut self, motion: &[f64]) {
        let nq = self.dims.nq;
        let at = at(motion, &self.u, &self.p);
        self.model
            .residual_jacobian(&at, &mut self.force, &mut self.jacobian);
        self.slope.fill(0.0);
        for e in &self.by_motion {
            self.slope[e.row * 3 * nq + e.col] = self.jacobian[e.at];
        }
        self.y.fill(0.0);
        let nb = self.params.len();
        for e in &self.by_param {
            self.y[e.row * nb + e.col] =
                self.jacobian[e.at] * self.scale[e.col] * self.weight[e.row];
        }
    }

    /// The force alone.
    pub(super) fn force(&mut self, motion: &[f64]) {
        let at = at(motion, &self.u, &self.p);
        self.model.residual(&at, &mut self.force);
    }

    fn curvature(&mut self, motion: &[f64], lambda: &[f64], shifted: bool) {
        let p = if shifted { &self.shifted } else { &self.p };
        let at = at(motion, &self.u, p);
        self.model.residual_hessian(&at, lambda, &mut self.hessian);
    }

    /// The regressor's derivatives by the motion.
    pub(super) fn second(&mut self, motion: &[f64]) {
        let (nq, nb) = (self.dims.nq, self.nb());
        self.dy.fill(0.0);
        for j in 0..nq {
            let mut unit = std::mem::take(&mut self.unit);
            unit.fill(0.0);
            unit[j] = 1.0;
            self.curvature(motion, &unit, false);
            self.unit = unit;
            for e in &self.mixed {
                self.dy[(e.col * nq + j) * nb + e.row] =
                    self.hessian[e.at] * self.scale[e.row] * self.weight[j];
            }
        }
    }

    /// Adds the lower triangle of `Σ_j λ_j ∂²force_j/∂(q, v, a)²` to `out`, 3 nq × 3 nq.
    pub(super) fn add_force_curvature(&mut self, motion: &[f64], lambda: &[f64], out: &mut [f64]) {
        self.curvature(motion, lambda, false);
        let width = 3 * self.dims.nq;
        for e in &self.motion {
            out[e.row * width + e.col] += self.hessian[e.at];
        }
    }

    /// Adds the lower triangle of `Σ_jk g_jk ∂²y_jk/∂(q, v, a)²` for g of the shape of [`y`](Self::y).
    ///
    /// The regressor is the force's derivative by parameters in which it is a polynomial of at most
    /// the fourth degree, so that the derivative along the line p + t g follows exactly from the
    /// force's Hessian at four points of that line.
    pub(super) fn add_regressor_curvature(&mut self, motion: &[f64], g: &[f64], out: &mut [f64]) {
        let (nq, nb) = (self.dims.nq, self.nb());
        let width = 3 * nq;
        for j in 0..nq {
            let row = &g[j * nb..(j + 1) * nb];
            if row.iter().all(|g| *g == 0.0) {
                continue;
            }
            // A step of the size of the parameters keeps rounding small; any size is exact otherwise.
            let step = row
                .iter()
                .zip(&self.params)
                .zip(&self.scale)
                .map(|((g, p), s)| (g * s).abs() / self.p[*p].abs().max(1e-3))
                .fold(0.0, f64::max);
            for (t, c) in LINE {
                for ((g, p), s) in row.iter().zip(&self.params).zip(&self.scale) {
                    self.shifted[*p] = self.p[*p] + t / step * g * s;
                }
                let mut unit = std::mem::take(&mut self.unit);
                unit.fill(0.0);
                unit[j] = 1.0;
                self.curvature(motion, &unit, true);
                self.unit = unit;
                let c = c * step * self.weight[j];
                for e in &self.motion {
                    out[e.row * width + e.col] += c * self.hessian[e.at];
                }
            }
        }
    }
}
