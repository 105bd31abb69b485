//! The nominal values fitted within their tolerances where causes are missing.
//!
//! The errors of free runs are linear in small deviations: `e(θ + δ) ≈ e(θ) + J δ`, with J about the true
//! values under all causes. The deviations minimise
//!
//! ```text
//! N |e|² / F² + Σ θ²,        −1 ≤ θ ≤ 1
//! ```
//!
//! with θ in tolerances from the stated values, the floor F, and the number N of windows and channels:
//! each counts as one independent sample. Steps with the same J go on while this falls.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

use crate::plant::Plant;
use crate::record::Run;
use crate::replay::{errors, mean_square};
use crate::setup::Setup;

/// Difference that slopes are taken over, in tolerances.
const STEP: f64 = 0.02;
/// Steps at most.
const STEPS: usize = 4;
/// Least squared floor: windows of a record without noise leave rounding alone.
const LEAST: f64 = 1e-10;

/// Slopes of the errors in the nominal values, and how these answer.
pub(crate) struct Refit {
    slopes: DMatrix<f64>,
    curvature: Option<Cholesky<f64, Dyn>>,
    /// N / F².
    weight: f64,
}

impl Refit {
    /// About the true values under all causes, which leave the squared gap `floor`.
    pub(crate) fn new(setup: &Setup<'_>, runs: &[Run], window: usize, floor: f64) -> Self {
        let at = |theta: &[f64]| {
            let plant = Plant::new(setup.nominal, theta);
            let moved = Setup {
                plant: &plant,
                ..*setup
            };
            errors(&moved, runs, window, &|_| true)
        };
        let here = at(setup.theta);
        let columns: Vec<Vec<f64>> = (0..setup.theta.len())
            .into_par_iter()
            .map(|i| {
                let mut theta = setup.theta.to_vec();
                theta[i] += STEP;
                let there = at(&theta);
                there
                    .iter()
                    .zip(&here)
                    .map(|(a, b)| (a - b) / STEP)
                    .collect()
            })
            .collect();
        let slopes = DMatrix::from_fn(here.len(), columns.len(), |k, i| columns[i][k]);
        let windows: usize = runs.iter().map(|run| (run.rows.len() - 1) / window).sum();
        let channels = if setup.velocity == "absent" { 1 } else { 2 } * setup.robot.joints.len();
        let weight = (windows * channels) as f64 / floor.max(LEAST);
        let information = slopes.tr_mul(&slopes) * weight;
        let prior = DMatrix::identity(columns.len(), columns.len());
        Self {
            curvature: (information + prior).cholesky(),
            slopes,
            weight,
        }
    }

    /// The squared gap with the causes that are `on`, the nominal values fitted.
    pub(crate) fn square(
        &self,
        setup: &Setup<'_>,
        runs: &[Run],
        window: usize,
        on: &dyn Fn(usize) -> bool,
    ) -> f64 {
        let at = |theta: &DVector<f64>| {
            let plant = Plant::new(setup.nominal, theta.as_slice());
            let moved = Setup {
                plant: &plant,
                ..*setup
            };
            DVector::from_vec(errors(&moved, runs, window, on))
        };
        let objective = |e: &DVector<f64>, theta: &DVector<f64>| {
            self.weight * e.norm_squared() + theta.norm_squared()
        };
        let mut theta = DVector::from_column_slice(setup.theta);
        let mut left = at(&theta);
        let Some(curvature) = &self.curvature else {
            return mean_square(left.as_slice());
        };
        for _ in 0..STEPS {
            let pull = self.slopes.tr_mul(&left) * self.weight + &theta;
            let next = (&theta - curvature.solve(&pull)).map(|x| x.clamp(-1.0, 1.0));
            let there = at(&next);
            if objective(&there, &next) >= objective(&left, &theta) {
                break;
            }
            (theta, left) = (next, there);
        }
        mean_square(left.as_slice())
    }
}
