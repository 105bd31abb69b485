//! Length of the simulations of an identification: by rule, or by cross validation.

use pid_data::{Dataset, Horizon, Role};
use pid_runtime::dynamics::Hessian;

use super::request::{HorizonChoice, News, Tell};
use crate::ident::{CandidateScore, CrossValidationError, Settings, cross_validate};

/// Horizons to choose from, s.
const LADDER: [f64; 3] = [0.5, 1.0, 2.0];
/// Length of the free runs that judge them, s: the same for all.
const JUDGED: Horizon = Horizon::Seconds(1.0);

/// Whole records of noise-free or short simulated data; one second where friction and drift make
/// long runs a lottery.
pub fn by_rule(dataset: &Dataset) -> Horizon {
    let longest = dataset
        .experiments
        .iter()
        .map(|e| e.duration())
        .fold(0.0, f64::max);
    if longest > 10.0 {
        Horizon::Seconds(1.0)
    } else {
        Horizon::Record
    }
}

/// The horizon with the lowest error on left-out training records.
pub(super) fn chosen(
    model: &dyn Hessian,
    dataset: &Dataset,
    settings: &Settings,
    start: Option<&[f64]>,
    tell: &Tell<'_>,
) -> Result<HorizonChoice, CrossValidationError> {
    let shortest = dataset
        .with_role(Role::Train)
        .map(|e| e.duration())
        .fold(f64::INFINITY, f64::min);
    let candidates: Vec<Settings> = LADDER
        .iter()
        .filter(|h| **h <= LADDER[0] || **h <= 0.5 * shortest)
        .map(|h| Settings {
            horizon: Horizon::Seconds(*h),
            starts: 1,
            ..settings.clone()
        })
        .collect();
    let mut news = |i: &crate::ident::Progress<'_>| tell(&News::Horizon(i));
    let scores = cross_validate(model, dataset, &candidates, JUDGED, start, &mut news)?;
    let best = scores
        .iter()
        .filter(|s| s.score.is_finite())
        .min_by(|a, b| a.score.total_cmp(&b.score));
    let horizon = best.map_or_else(|| by_rule(dataset), |s| candidates[s.candidate].horizon);
    let of = |s: CandidateScore| (candidates[s.candidate].horizon, s);
    Ok(HorizonChoice {
        horizon,
        judged: JUDGED,
        scores: scores.into_iter().map(of).collect(),
    })
}
