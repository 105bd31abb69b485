//! Boxes in which points of the robot stay.

use super::error::ExciteError;
use nalgebra::{DMatrix, DVector};
use pid_runtime::kinematics::ForwardKinematics;

/// Most steps towards a pose with all points in their boxes.
const STEPS: usize = 50;
/// Such a pose leaves this share of each box free.
const INSIDE: f64 = 0.25;
/// It leaves this share of a joint's range free at each end.
const ENDS: f64 = 0.05;

/// Boxes in which points of the robot stay, in the base frame.
#[derive(Debug, Clone)]
pub struct Workspace<'a> {
    /// Where the points are.
    pub points: &'a dyn ForwardKinematics,
    /// Ranges of x, y and z for each point, m; an end may be infinite.
    pub boxes: Vec<[(f64, f64); 3]>,
}

impl Workspace<'_> {
    pub(super) fn check(&self) -> Result<(), ExciteError> {
        let names = self.points.points();
        if self.boxes.len() != names.len() {
            return Err(ExciteError::Boxes {
                boxes: self.boxes.len(),
                points: names.len(),
            });
        }
        for (point, ranges) in names.iter().zip(&self.boxes) {
            for (axis, &(low, high)) in AXES.into_iter().zip(ranges) {
                let sound = low < high && low < f64::INFINITY && high > f64::NEG_INFINITY;
                if !sound {
                    return Err(ExciteError::Box {
                        point: point.clone(),
                        axis,
                        low,
                        high,
                    });
                }
            }
        }
        Ok(())
    }
}

/// Names of the directions.
pub(super) const AXES: [char; 3] = ['x', 'y', 'z'];

/// One limited coordinate of a point as a share: `scale (x − middle)` is 1 at a limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Side {
    /// Position among the coordinates of all points.
    pub(super) at: usize,
    pub(super) scale: f64,
    pub(super) middle: f64,
    /// Whether the box is open on one side. The share then has no lower limit: it is the used part
    /// of the box's last metre.
    pub(super) open: bool,
}

/// Evaluates the points at fixed parameters.
#[derive(Debug)]
pub(super) struct Places<'a> {
    workspace: Workspace<'a>,
    p: Vec<f64>,
    nq: usize,
    /// Positions of all points.
    pub(super) x: Vec<f64>,
    /// ∂x/∂q, row by row.
    pub(super) slope: Vec<f64>,
    curvature: Vec<f64>,
}

impl<'a> Places<'a> {
    pub(super) fn new(workspace: &Workspace<'a>, p: &[f64], nq: usize) -> Self {
        let n = 3 * workspace.boxes.len();
        Self {
            workspace: workspace.clone(),
            p: p.to_vec(),
            nq,
            x: vec![0.0; n],
            slope: vec![0.0; n * nq],
            curvature: vec![0.0; workspace.points.hessian_places().len()],
        }
    }

    /// The limited coordinates.
    pub(super) fn sides(&self) -> Vec<Side> {
        let ranges = self.workspace.boxes.iter().flatten().enumerate();
        ranges
            .filter_map(|(at, &(low, high))| {
                let side = |scale, middle, open| Side {
                    at,
                    scale,
                    middle,
                    open,
                };
                match (low.is_finite(), high.is_finite()) {
                    (true, true) => Some(side(2.0 / (high - low), 0.5 * (low + high), false)),
                    (true, false) => Some(side(-1.0, low + 1.0, true)),
                    (false, true) => Some(side(1.0, high - 1.0, true)),
                    (false, false) => None,
                }
            })
            .collect()
    }

    /// Positions at coordinates q.
    pub(super) fn place(&mut self, q: &[f64]) {
        self.workspace.points.positions(q, &self.p, &mut self.x);
    }

    /// Positions and their derivative.
    pub(super) fn slope(&mut self, q: &[f64]) {
        let points = self.workspace.points;
        points.jacobian(q, &self.p, &mut self.x, &mut self.slope);
    }

    /// Derivative of coordinate `at` by q.
    pub(super) fn row(&self, at: usize) -> &[f64] {
        &self.slope[at * self.nq..(at + 1) * self.nq]
    }

    /// Adds the lower triangle of `Σ λ ∂²x/∂q²` to a matrix with rows of `width` entries.
    pub(super) fn add_curvature(
        &mut self,
        q: &[f64],
        lambda: &[f64],
        width: usize,
        square: &mut [f64],
    ) {
        let points = self.workspace.points;
        points.hessian(q, &self.p, lambda, &mut self.curvature);
        for (&(row, col), value) in points.hessian_places().iter().zip(&self.curvature) {
            square[row * width + col] += value;
        }
    }

    /// Moves a pose until the points are well within their boxes, by damped least squares in the
    /// joints' ranges; it may fail.
    pub(super) fn bring_inside(&mut self, q: &mut [f64], ranges: &[(f64, f64)]) {
        let sides = self.sides();
        for _ in 0..STEPS {
            self.slope(q);
            let mut j = DMatrix::<f64>::zeros(sides.len(), self.nq);
            let mut r = DVector::<f64>::zeros(sides.len());
            for (k, side) in sides.iter().enumerate() {
                let share = side.scale * (self.x[side.at] - side.middle);
                let beyond = match side.open {
                    true => share.max(0.0),
                    false => share.abs(),
                } - (1.0 - INSIDE);
                if beyond > 0.0 {
                    r[k] = beyond * share.signum();
                    for (c, slope) in self.row(side.at).iter().enumerate() {
                        j[(k, c)] = side.scale * slope;
                    }
                }
            }
            if r.amax() == 0.0 {
                return;
            }
            let mut h = j.tr_mul(&j);
            let damping = 1e-6 + 1e-3 * h.amax();
            for k in 0..self.nq {
                h[(k, k)] += damping;
            }
            let Some(factor) = h.cholesky() else { return };
            let step = factor.solve(&j.tr_mul(&r));
            for ((q, step), (low, high)) in q.iter_mut().zip(step.iter()).zip(ranges) {
                let free = ENDS * (high - low);
                *q = (*q - step).clamp(low + free, high - free);
            }
        }
    }

    /// A limited coordinate in words: point, axis, range.
    pub(super) fn named(&self, at: usize) -> (String, char, (f64, f64)) {
        (
            self.workspace.points.points()[at / 3].clone(),
            AXES[at % 3],
            self.workspace.boxes[at / 3][at % 3],
        )
    }
}
