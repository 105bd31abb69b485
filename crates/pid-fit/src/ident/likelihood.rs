//! Maximum likelihood: noise levels that are stated or estimated, prior knowledge, losses of
//! long-tailed noise.
//!
//! With noise levels σ_c the objective is −2 log of the posterior density over N ([`Loss`],
//! [`crate::transcribe::Prior`]). Levels that are not stated are eliminated by turns: the parameters are fitted with
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

use super::assemble::anchored;
use super::error::IdentError;
use super::estimate::once;
use super::noise::{first_levels, spreads};
use super::outcome::{Callback, Identification, Progress};
use super::settings::{Likelihood, Prepare, Settings};
use crate::transcribe::Loss;
use pid_data::{Dataset, VelocityKind};
use pid_runtime::dynamics::Hessian;

/// Most rounds of fit and levels.
const TURNS: usize = 15;
/// The rounds end when no noise level changes by more than this share.
const SETTLED: f64 = 5e-3;
/// Smallest level, as a share of the channel's spread.
const QUIETEST: f64 = 1e-7;

/// Noise levels that are given, channel by channel, and those of joints that are anchored.
fn stated_levels(
    model: &dyn Hessian,
    dataset: &Dataset,
    likelihood: &Likelihood,
) -> Result<Vec<Option<f64>>, IdentError> {
    let channels = 2 * model.dims().nq;
    let mut stated: Vec<Option<f64>> = match likelihood.noise.as_slice() {
        [] => vec![None; channels],
        noise if noise.len() == channels => noise.to_vec(),
        noise => {
            return Err(IdentError::NoiseLength {
                expected: channels,
                found: noise.len(),
            });
        }
    };
    for j in anchored(model, dataset) {
        stated[j] = Some(1.0);
    }
    Ok(stated)
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
    let stated = stated_levels(model, dataset, likelihood)?;
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
        let mut news = |progress: &Progress<'_>| {
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
