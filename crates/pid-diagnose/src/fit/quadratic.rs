//! The bounded quadratic model of the objective.

use nalgebra::{DMatrix, DVector};

use super::linear::{Basis, Linear};
use super::products::{Slopes, cross, gram};
use super::value::PRIOR;
use crate::point::Point;

/// Rounds of [`Quadratic::minimise`]: each changes the set of bounds that hold, and a robot of six
/// joints has some hundred of them.
const ROUNDS: usize = 60;

/// Quadratic model of the objective around a point, in (θ, e): `½ xᵀ H x + gᵀ x`, prior included.
#[derive(Debug, Clone)]
pub struct Quadratic {
    /// Curvature.
    pub h: DMatrix<f64>,
    /// Gradient.
    pub g: DVector<f64>,
}

impl Quadratic {
    /// From derivatives along the basis (first columns) and the effects' parameters (last).
    pub fn new(basis: &Basis, lin: &Linear, at: &Point) -> Self {
        Self::of(basis, &gram(&lin.j), &lin.j.tr_mul(&lin.r), at)
    }

    /// From borrowed derivatives along the basis, and innovations with their derivatives in the effects' parameters.
    pub(super) fn beside(basis: &Basis, slopes: &Slopes, own: &Linear, at: &Point) -> Self {
        let (rank, ne) = (slopes.j.ncols(), own.j.ncols());
        let mut products = DMatrix::zeros(rank + ne, rank + ne);
        let mixed = cross(&slopes.j, &own.j);
        products
            .view_mut((0, 0), (rank, rank))
            .copy_from(&slopes.gram);
        products.view_mut((0, rank), (rank, ne)).copy_from(&mixed);
        products
            .view_mut((rank, 0), (ne, rank))
            .copy_from(&mixed.transpose());
        products
            .view_mut((rank, rank), (ne, ne))
            .copy_from(&gram(&own.j));
        let mut pull = DVector::zeros(rank + ne);
        pull.rows_mut(0, rank).copy_from(&slopes.j.tr_mul(&own.r));
        pull.rows_mut(rank, ne).copy_from(&own.j.tr_mul(&own.r));
        Self::of(basis, &products, &pull, at)
    }

    /// From `jᵀ j` and `jᵀ r` of derivatives along the basis, then in the effects' parameters.
    pub(super) fn of(
        basis: &Basis,
        products: &DMatrix<f64>,
        pull: &DVector<f64>,
        at: &Point,
    ) -> Self {
        let (size, r) = basis.columns.shape();
        let ne = products.ncols() - r;
        let mut wide = DMatrix::zeros(size + ne, r + ne);
        wide.view_mut((0, 0), (size, r)).copy_from(&basis.columns);
        for i in 0..ne {
            wide[(size + i, r + i)] = 1.0;
        }
        let mut h = &wide * products * wide.transpose();
        let mut g = &wide * pull;
        for i in 0..size {
            h[(i, i)] += 1.0 / (PRIOR * PRIOR);
            // Without directions the deviations stay where they are.
            if r > 0 {
                g[i] += at.theta[i] / (PRIOR * PRIOR);
            }
        }
        Quadratic { h, g }
    }

    /// Minimiser within `low ≤ x ≤ high`, by an active set on Cholesky factorizations; and whether
    /// it is one: otherwise the curvature is not positive, or the active set has not settled within
    /// `ROUNDS`, and x is a point within the bounds.
    pub fn minimise(&self, low: &DVector<f64>, high: &DVector<f64>) -> (DVector<f64>, bool) {
        let m = self.g.len();
        let mut x = DVector::zeros(m);
        let mut held = vec![0i8; m];
        let mut settled = false;
        for _ in 0..ROUNDS {
            for i in 0..m {
                match held[i] {
                    1 => x[i] = high[i],
                    -1 => x[i] = low[i],
                    _ => {}
                }
            }
            let Some(changed) = self.move_free(&mut x, &mut held, (low, high)) else {
                break;
            };
            if !changed && !self.release(&x, &mut held) {
                settled = true;
                break;
            }
        }
        for i in 0..m {
            x[i] = x[i].clamp(low[i], high[i]);
        }
        (x, settled)
    }

    /// Puts the unknowns that no bound holds where the model is least, and holds those that end
    /// beyond a bound; whether any does. `None` where the curvature is not positive.
    fn move_free(
        &self,
        x: &mut DVector<f64>,
        held: &mut [i8],
        (low, high): (&DVector<f64>, &DVector<f64>),
    ) -> Option<bool> {
        let m = self.g.len();
        let free: Vec<usize> = (0..m).filter(|&i| held[i] == 0).collect();
        let k = free.len();
        let mut a = DMatrix::zeros(k, k);
        let mut b = DVector::zeros(k);
        for (p, &i) in free.iter().enumerate() {
            b[p] = -self.g[i];
            for j in 0..m {
                if held[j] != 0 {
                    b[p] -= self.h[(i, j)] * x[j];
                }
            }
            for (q, &j) in free.iter().enumerate() {
                a[(p, q)] = self.h[(i, j)];
            }
            a[(p, p)] += 1e-12 * self.h[(i, i)] + 1e-300;
        }
        let y = a.cholesky()?.solve(&b);
        let mut changed = false;
        for (p, &i) in free.iter().enumerate() {
            x[i] = y[p];
            if y[p] > high[i] {
                held[i] = 1;
                changed = true;
            } else if y[p] < low[i] {
                held[i] = -1;
                changed = true;
            }
        }
        Some(changed)
    }

    /// Releases what pulls inwards from its bound; whether anything does.
    fn release(&self, x: &DVector<f64>, held: &mut [i8]) -> bool {
        let m = self.g.len();
        let mut changed = false;
        for i in 0..m {
            if held[i] == 0 {
                continue;
            }
            let slope = self.g[i] + (0..m).map(|j| self.h[(i, j)] * x[j]).sum::<f64>();
            if (held[i] == 1 && slope > 1e-9) || (held[i] == -1 && slope < -1e-9) {
                held[i] = 0;
                changed = true;
            }
        }
        changed
    }

    /// The model at x, relative to its value at 0.
    pub fn at(&self, x: &DVector<f64>) -> f64 {
        0.5 * (x.transpose() * &self.h * x)[(0, 0)] + self.g.dot(x)
    }
}
