//! Weights of samples for residuals with long tails: iteratively reweighted least squares.
//!
//! With residual r of a joint and s = 1.4826 median|r| (the standard deviation of normal
//! residuals), a sample counts by `ρ'(r/s)/(2 r/s)`: 1 where the loss ρ is quadratic, less beyond
//! (P. J. Huber, *Robust Statistics*, 1981, section 7.8).

use crate::transcribe::Loss;
use nalgebra::DVector;
use rayon::prelude::*;

use crate::regress::columns::LinearModel;
use crate::regress::normal::{self, Normal};
use crate::regress::record::Record;
use crate::regress::solution::{self, How, RegressionError};
use crate::regress::unknowns::{self, Unknowns};

/// Most rounds of reweighting.
const ROUNDS: usize = 12;
/// Weights count as settled when none changes by more than this.
const SETTLED: f64 = 0.02;
/// Standard deviation over the median of the absolute value, for normal residuals.
const NORMAL: f64 = 1.482_6;

/// Weights of the kept samples and joints of each record; empty for squares.
///
/// # Errors
/// [`RegressionError`].
pub fn weights(
    model: &LinearModel<'_>,
    unknowns: &Unknowns,
    records: &[Record],
    rest: &[f64],
    how: &How,
    loss: Loss,
) -> Result<Vec<Vec<f64>>, RegressionError> {
    let mut weights: Vec<Vec<f64>> = Vec::new();
    if loss.is_square() {
        return Ok(weights);
    }
    let places: Vec<_> = records
        .iter()
        .enumerate()
        .map(|(r, record)| unknowns.place(&record.name, Some(r)))
        .collect();
    for _ in 0..ROUNDS {
        let normal = Normal::weighted(model, records, Some(rest), &weights)
            .placed(unknowns.infos().len(), places.clone());
        let x: DVector<f64> = solution::estimate(&normal.total(|_| true), how)?.columns();
        let residuals: Vec<Vec<f64>> = records
            .par_iter()
            .zip(&places)
            .map(|(record, place)| normal::residuals(model, record, &unknowns::columns(place, &x)))
            .collect();
        let nq = rest.len();
        let scale: Vec<f64> = (0..nq)
            .map(|j| {
                let moving = records.iter().zip(&residuals).flat_map(|(record, r)| {
                    record
                        .kept()
                        .enumerate()
                        .filter(move |(_, i)| record.v[i * nq + j].abs() >= rest[j])
                        .map(move |(k, _)| r[k * nq + j].abs())
                });
                NORMAL * median(moving.collect())
            })
            .collect();
        let next: Vec<Vec<f64>> = residuals
            .iter()
            .map(|r| {
                let one = |(i, r): (usize, &f64)| match scale[i % nq] {
                    s if s > 0.0 => 0.5 * loss.weight(r / s),
                    _ => 1.0,
                };
                r.iter().enumerate().map(one).collect()
            })
            .collect();
        let moved = match weights.is_empty() {
            true => f64::INFINITY,
            false => weights
                .iter()
                .flatten()
                .zip(next.iter().flatten())
                .fold(0.0_f64, |most, (a, b)| most.max((a - b).abs())),
        };
        weights = next;
        if moved < SETTLED {
            break;
        }
    }
    Ok(weights)
}

fn median(mut x: Vec<f64>) -> f64 {
    if x.is_empty() {
        return 0.0;
    }
    let middle = x.len() / 2;
    *x.select_nth_unstable_by(middle, f64::total_cmp).1
}
