//! Length of the simulations of an identification: stated, by rule, or by cross validation.

use std::ops::ControlFlow;

use pid_data::{Dataset, Horizon, Role};
use pid_fit::ident::{CandidateScore, Progress as News, Settings, cross_validate};
use pid_runtime::dynamics::Hessian;

use crate::error::CliError;
use crate::progress::{Interrupt, Progress};

/// Horizons to choose from, s.
const LADDER: [f64; 3] = [0.5, 1.0, 2.0];
/// Length of the free runs that judge them, s: the same for all.
const JUDGED: Horizon = Horizon::Seconds(1.0);

/// Whole records of noise-free or short simulated data; one second where friction and drift make
/// long runs a lottery.
pub(crate) fn by_rule(dataset: &Dataset) -> Horizon {
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

/// The horizon with the lowest error on left-out training records, and the scores in words.
pub(crate) fn chosen(
    model: &dyn Hessian,
    dataset: &Dataset,
    settings: &Settings,
    start: Option<&[f64]>,
    progress: &Progress,
    interrupt: &Interrupt,
) -> Result<(Horizon, String), CliError> {
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
    let mut callback = |news: &News<'_>| {
        progress.step(format!(
            "choosing the horizon by cross validation: {}, iteration {}",
            news.phase, news.iteration.iteration
        ));
        match interrupt.requested() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    };
    let scores = cross_validate(model, dataset, &candidates, JUDGED, start, &mut callback)?;
    let best = scores
        .iter()
        .filter(|s| s.score.is_finite())
        .min_by(|a, b| a.score.total_cmp(&b.score));
    let horizon = best.map_or_else(|| by_rule(dataset), |s| candidates[s.candidate].horizon);
    let words: Vec<String> = scores.iter().map(|s| in_words(s, &candidates)).collect();
    let note = format!(
        "The horizon was chosen by cross validation over the training records (left-out records, free runs restarted every {JUDGED}, RMS error over spread): {}.",
        words.join("; ")
    );
    Ok((horizon, note))
}

/// `1 s: 0.0312 (both_a 0.03, …)`.
fn in_words(score: &CandidateScore, candidates: &[Settings]) -> String {
    let folds: Vec<String> = score
        .folds
        .iter()
        .map(|(name, s)| format!("{name} {s:.4}"))
        .collect();
    format!(
        "{}: {:.4} ({})",
        candidates[score.candidate].horizon,
        score.score,
        folds.join(", ")
    )
}
