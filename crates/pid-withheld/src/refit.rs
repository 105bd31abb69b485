//! The nominal values fitted within their tolerances where causes are missing.
//!
//! The deviations θ, in tolerances from the stated values, minimise
//!
//! ```text
//! N |e(θ)|² / F² + |θ|²,        −1 ≤ θ ≤ 1
//! ```
//!
//! with the errors e of free runs, the floor F, and the number N of windows and channels: each counts as one
//! independent sample. The first step takes the slopes of e at the true values under all causes, which are
//! the same for all sets of causes; the next ones take slopes where they are, or the same again where a draw
//! asks for a rough gap. Each step is the minimum of its quadratic model within the bounds, cut in half until
//! the objective falls.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::plant::Plant;
use crate::record::Run;
use crate::replay::{errors, mean_square};
use crate::setup::Setup;

/// Difference that slopes are taken over, in tolerances.
const STEP: f64 = 0.02;
/// Steps at most.
const STEPS: usize = 4;
/// Halvings of a step at most.
const HALVINGS: usize = 4;
/// Decrease of the objective, relative, below which it is at its least.
const REST: f64 = 0.01;
/// Least squared floor: windows of a record without noise leave rounding alone.
const LEAST: f64 = 1e-10;

/// Free runs under some of the causes.
struct Runs<'a> {
    setup: &'a Setup<'a>,
    runs: &'a [Run],
    window: usize,
    on: &'a (dyn Fn(usize) -> bool + Sync),
}

impl Runs<'_> {
    fn errors(&self, theta: &[f64]) -> DVector<f64> {
        let plant = Plant::new(self.setup.nominal, theta);
        let moved = Setup {
            plant: &plant,
            ..*self.setup
        };
        DVector::from_vec(errors(&moved, self.runs, self.window, self.on))
    }

    /// Slopes of the errors, which are `here` at θ.
    fn slopes(&self, theta: &[f64], here: &DVector<f64>) -> DMatrix<f64> {
        let columns: Vec<DVector<f64>> = (0..theta.len())
            .into_par_iter()
            .map(|i| {
                let mut moved = theta.to_vec();
                // Inwards, so that no value leaves its range.
                let step = if moved[i] > 0.0 { -STEP } else { STEP };
                moved[i] += step;
                (self.errors(&moved) - here) / step
            })
            .collect();
        DMatrix::from_columns(&columns)
    }
}

/// Slopes at the true values under all causes, and what an error counts.
pub(crate) struct Refit {
    slopes: DMatrix<f64>,
    /// N / F².
    weight: f64,
    /// Whether a rough gap will do.
    rough: bool,
}

impl Refit {
    /// About the true values under all causes, which leave the squared gap `floor`.
    pub(crate) fn new(
        setup: &Setup<'_>,
        runs: &[Run],
        window: usize,
        (floor, rough): (f64, bool),
    ) -> Self {
        let all = Runs {
            setup,
            runs,
            window,
            on: &|_| true,
        };
        let slopes = all.slopes(setup.theta, &all.errors(setup.theta));
        let windows: usize = runs.iter().map(|run| (run.rows.len() - 1) / window).sum();
        let channels = if setup.velocity == "absent" { 1 } else { 2 } * setup.robot.joints.len();
        Self {
            slopes,
            weight: (windows * channels) as f64 / floor.max(LEAST),
            rough,
        }
    }

    /// The squared gap with the causes that are `on`, the nominal values fitted.
    pub(crate) fn square(
        &self,
        setup: &Setup<'_>,
        runs: &[Run],
        window: usize,
        on: &(dyn Fn(usize) -> bool + Sync),
    ) -> f64 {
        let some = Runs {
            setup,
            runs,
            window,
            on,
        };
        let objective = |e: &DVector<f64>, theta: &DVector<f64>| {
            self.weight * e.norm_squared() + theta.norm_squared()
        };
        let mut theta = DVector::from_column_slice(setup.theta);
        let mut left = some.errors(theta.as_slice());
        let mut own: Option<DMatrix<f64>> = None;
        for _ in 0..STEPS {
            let slopes = own.as_ref().unwrap_or(&self.slopes);
            let mut h = slopes.tr_mul(slopes) * self.weight;
            (0..theta.len()).for_each(|i| h[(i, i)] += 1.0);
            let g = slopes.tr_mul(&left) * self.weight + &theta;
            let whole = least_within(&h, &g, &theta);
            let before = objective(&left, &theta);
            let next = (0..=HALVINGS).find_map(|k| {
                let next = &theta + &whole * 0.5_f64.powi(k as i32);
                let there = some.errors(next.as_slice());
                (objective(&there, &next) < before).then_some((next, there))
            });
            let rests = match next {
                Some((next, there)) => {
                    (theta, left) = (next, there);
                    objective(&left, &theta) > (1.0 - REST) * before
                }
                None => true,
            };
            if rests && (self.rough || own.is_some()) {
                break;
            }
            if !self.rough {
                own = Some(some.slopes(theta.as_slice(), &left));
            }
        }
        mean_square(left.as_slice())
    }
}

/// The step d that minimises ½ dᵀ H d + gᵀ d while θ + d stays within ±1, by Newton steps in the values
/// that no bound holds (D. P. Bertsekas, SIAM J. Control Optim. 20, 1982).
fn least_within(h: &DMatrix<f64>, g: &DVector<f64>, theta: &DVector<f64>) -> DVector<f64> {
    let n = theta.len();
    let mut d = DVector::zeros(n);
    let value = |d: &DVector<f64>| 0.5 * d.dot(&(h * d)) + g.dot(d);
    for _ in 0..4 * n {
        let slope = h * &d + g;
        let held = |i: usize| {
            let at = theta[i] + d[i];
            (at >= 1.0 && slope[i] < 0.0) || (at <= -1.0 && slope[i] > 0.0)
        };
        let free: Vec<usize> = (0..n).filter(|i| !held(*i)).collect();
        let own = DMatrix::from_fn(free.len(), free.len(), |a, b| h[(free[a], free[b])]);
        let Some(factor) = own.cholesky() else { break };
        let newton = factor.solve(&DVector::from_fn(free.len(), |a, _| -slope[free[a]]));
        let here = value(&d);
        let next = (0..20).find_map(|k| {
            let mut next = d.clone();
            for (a, &i) in free.iter().enumerate() {
                let to = theta[i] + d[i] + newton[a] * 0.5_f64.powi(k);
                next[i] = to.clamp(-1.0, 1.0) - theta[i];
            }
            (value(&next) < here - 1e-12 * here.abs()).then_some(next)
        });
        match next {
            Some(next) => d = next,
            None => break,
        }
    }
    d
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_within_bounds_has_no_slope_but_against_them() {
        // Values that act much alike: without the bounds both ends lie far outside.
        let h = DMatrix::from_row_slice(3, 3, &[4.0, 3.9, 0.5, 3.9, 4.0, 0.2, 0.5, 0.2, 2.0]);
        let g = DVector::from_vec(vec![-3.0, 2.0, 0.4]);
        let theta = DVector::from_vec(vec![0.3, -0.2, 0.9]);
        let d = least_within(&h, &g, &theta);
        let slope = &h * &d + &g;
        let mut bound = 0;
        for i in 0..3 {
            let at = theta[i] + d[i];
            assert!((-1.0..=1.0).contains(&at), "{at}");
            if at.abs() < 1.0 {
                assert!(slope[i].abs() < 1e-9, "{i}: {slope}");
            } else {
                assert!(slope[i] * at < 0.0, "{i}: {slope}");
                bound += 1;
            }
        }
        assert!(bound > 0, "{d}");
    }
}
