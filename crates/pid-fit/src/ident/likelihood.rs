//! Maximum likelihood: noise levels that are stated or estimated, prior knowledge, losses of
//! long-tailed noise.
//!
//! With noise levels σ_c the objective is −2 log of the posterior density over N ([`Loss`],
//! [`Prior`]). Levels that are not stated are eliminated by turns: the parameters are fitted with
//! the levels held, then each level is set where the likelihood is largest with the parameters
//! held,
//!
//! ```text
//! σ_c² = N'/(N' − n) · mean of ½ ρ'(z) z · σ_c²(old),      z = (y_c − d_c)/σ_c(old)
//! ```
//!
//! (N' samples of all channels, n unknowns; for squares the mean square of the residuals), until no
//! level changes by more than half a percent. The first levels come from the differences of the
//! records. Velocities computed from the positions ([`VelocityKind::Derived`]) carry the errors of
//! these; they are left out unless a level is stated for them.

use super::{Callback, IdentError, Identification, Prepare, Settings, once};
use crate::transcribe::{Loss, Prior};
use pid_data::signal::noise_level_without_jumps;
use pid_data::{Dataset, Role, VelocityKind};
use pid_runtime::dynamics::Hessian;

/// Most rounds of fit and levels.
const TURNS: usize = 15;
/// The rounds end when no noise level changes by more than this share.
const SETTLED: f64 = 5e-3;
/// Smallest level, as a share of the channel's spread.
const QUIETEST: f64 = 1e-7;

/// Assumptions about noise and parameters.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Likelihood {
    /// Standard deviation of the noise of each channel, positions of all joints, then velocities;
    /// `None` where it is estimated, infinite for values that start a state and are no readings. If
    /// empty, all are estimated.
    pub noise: Vec<Option<f64>>,
    /// Loss of deviations.
    pub loss: Loss,
    /// Prior knowledge of parameters.
    pub priors: Vec<Prior>,
}

/// Identifies in rounds until the noise levels settle.
pub(super) fn identify(
    model: &dyn Hessian,
    dataset: &Dataset,
    settings: &Settings,
    likelihood: &Likelihood,
    start: &[f64],
    callback: &mut Callback<'_>,
) -> Result<Identification, IdentError> {
    let channels = 2 * model.dims().nq;
    let stated: Vec<Option<f64>> = match likelihood.noise.as_slice() {
        [] => vec![None; channels],
        noise if noise.len() == channels => noise.to_vec(),
        noise => {
            return Err(IdentError::NoiseLength {
                expected: channels,
                found: noise.len(),
            });
        }
    };
    let mut stated = stated;
    for j in super::assemble::anchored(model, dataset) {
        stated[j] = Some(1.0);
    }
    let nq = model.dims().nq;
    let computed = |c: usize| {
        c >= nq && dataset.joints[c - nq].velocity == VelocityKind::Derived && stated[c].is_none()
    };
    let computed: Vec<bool> = (0..channels).map(computed).collect();
    let spread = spreads(dataset);
    let mut levels = first_levels(dataset, &stated, &spread);
    let all_stated = stated
        .iter()
        .zip(&computed)
        .all(|(s, computed)| s.is_some() || *computed);
    let mut settings = settings.clone();
    let mut start = start.to_vec();
    let motion = match settings.prepare {
        Prepare::Nothing => Prepare::Nothing,
        _ => Prepare::Motion,
    };
    for turn in 0..TURNS {
        let first = turn == 0 && !all_stated;
        settings.likelihood = Some(Likelihood {
            noise: levels
                .iter()
                .zip(&computed)
                .map(|(level, computed)| (!computed).then_some(*level))
                .collect(),
            // The first levels are those of the sensors. Under them the model's own errors would
            // look like outliers, so the first fit takes squares.
            loss: if first { Loss::Square } else { likelihood.loss },
            priors: likelihood.priors.clone(),
        });
        let mut stopped = false;
        let mut news = |progress: &super::Progress<'_>| {
            let flow = callback(progress);
            stopped |= flow.is_break();
            flow
        };
        let mut found = once(model, dataset, &settings, &start, &mut news)?;
        let mut moved = first;
        for (c, level) in levels.iter_mut().enumerate() {
            let (None, Some(new)) = (stated[c], found.noise[c]) else {
                continue;
            };
            let new = new.max(QUIETEST * spread[c]);
            moved |= (new / *level - 1.0).abs() > SETTLED;
            *level = new;
        }
        if stopped || !moved || turn + 1 == TURNS || !found.best().objective.is_finite() {
            if moved && !all_stated && !stopped {
                found.notes.push(format!(
                    "the noise levels have not settled after {} turns",
                    turn + 1
                ));
            }
            if computed.contains(&true) {
                found.notes.push(
                    "velocities computed from the positions are no readings of their own and are not fitted".to_owned(),
                );
            }
            return Ok(found);
        }
        start.clone_from(&found.best().parameters);
        (settings.starts, settings.prepare, settings.lift) = (1, motion, Some(false));
    }
    unreachable!("invariant: the last turn returns")
}

/// Largest less smallest value of each channel over the training records.
fn spreads(dataset: &Dataset) -> Vec<f64> {
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
fn first_levels(dataset: &Dataset, stated: &[Option<f64>], spread: &[f64]) -> Vec<f64> {
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
