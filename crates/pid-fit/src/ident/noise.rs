//! Noise levels of the channels: first ones from the records, then those of the residuals.

use pid_data::signal::noise_level_without_jumps;
use pid_data::{Dataset, Role};

use crate::transcribe::Loss;

/// Largest less smallest value of each channel over the training records.
pub(super) fn spreads(dataset: &Dataset) -> Vec<f64> {
    let nq = dataset.nq();
    (0..2 * nq)
        .map(|c| {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for e in dataset.with_role(Role::Train) {
                let values = if c < nq { Some(&e.q) } else { e.v.as_ref() };
                let own = values.into_iter().flatten().skip(c % nq).step_by(nq);
                for x in own.filter(|x| x.is_finite()) {
                    (low, high) = (low.min(*x), high.max(*x));
                }
            }
            if high > low { high - low } else { 1.0 }
        })
        .collect()
}

/// Stated levels; for the other channels, levels from the differences of the records.
pub(super) fn first_levels(dataset: &Dataset, stated: &[Option<f64>], spread: &[f64]) -> Vec<f64> {
    let nq = dataset.nq();
    (0..2 * nq)
        .map(|c| {
            if let Some(level) = stated[c] {
                return level;
            }
            let (mut sum, mut count) = (0.0, 0.0);
            for e in dataset.with_role(Role::Train) {
                let values = if c < nq { Some(&e.q) } else { e.v.as_ref() };
                let own: Vec<f64> = values
                    .into_iter()
                    .flatten()
                    .skip(c % nq)
                    .step_by(nq)
                    .copied()
                    .filter(|x| x.is_finite())
                    .collect();
                let level = noise_level_without_jumps(&own);
                if level.is_finite() {
                    sum += level * level;
                    count += 1.0;
                }
            }
            let level = if count > 0.0 {
                f64::sqrt(sum / count)
            } else {
                0.0
            };
            level.max(1e-4 * spread[c])
        })
        .collect()
}

/// The level of each channel where the likelihood is largest, from `√(w/N) (y − d)` and the weights
/// w = 1/σ²; `None` for channels without measurements.
pub(super) fn levels(
    residuals: &[f64],
    weights: &[f64],
    loss: Loss,
    share: f64,
    unknowns: usize,
) -> Vec<Option<f64>> {
    let channels = weights.len();
    let all = residuals.iter().filter(|r| !r.is_nan()).count();
    if all <= unknowns {
        return vec![None; channels];
    }
    let correction = all as f64 / (all - unknowns) as f64;
    (0..channels)
        .map(|c| {
            let (mut sum, mut count) = (0.0, 0.0);
            let own = residuals.iter().skip(c).step_by(channels);
            for r in own.filter(|r| !r.is_nan()) {
                let z = r / share.sqrt();
                sum += 0.5 * loss.slope(z) * z;
                count += 1.0;
            }
            (count > 0.0 && weights[c] > 0.0)
                .then(|| (correction * sum / count / weights[c]).sqrt())
        })
        .collect()
}
