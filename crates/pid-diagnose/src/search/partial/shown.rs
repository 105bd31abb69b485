//! Lags that a reading shows by itself.
//!
//! A velocity that follows late from the positions of its own joint needs no model of the robot to be
//! seen, and no place or kind is chosen among many. So it comes first, without the margin for many
//! candidates and without a share of free runs: it must predict motions never fitted better, and free
//! runs must not grow. It stays beside every effect that is taken later.

use super::{Asked, Stand, round};
use crate::case::Case;
use crate::channel::late_readings;
use crate::diagnosis::Round;
use crate::search::refit::Refit;
use crate::search::settings::Settings;

/// The effect by which a velocity reading lags.
const LAG: &str = "velocity_filter_lag";

/// Labels of the lags that the readings of a case show and that its description lacks.
fn labels(case: &Case, settings: &Settings) -> Vec<String> {
    let Some(lag) = settings.effects.iter().find(|e| e.info().id == LAG) else {
        return Vec::new();
    };
    let known = |j: usize| case.known.parameters(LAG, j).is_some();
    let late = late_readings(case).into_iter().filter(|&j| !known(j));
    late.map(|joint| {
        crate::effect::Term {
            effect: lag.clone(),
            joint,
        }
        .label()
    })
    .collect()
}

/// Takes the lags that the readings show; the rounds in which they were asked for.
pub(super) fn take_shown(
    now: &mut Stand,
    taken: &mut Vec<(Refit, f64)>,
    settings: &Settings,
    sensors: &[(f64, f64)],
) -> Vec<Round> {
    let mut rounds = Vec::new();
    for label in labels(&now.case, settings) {
        let asked = Asked {
            only: &|term| term.label() == label,
            shown: true,
        };
        let (mut tried, own, pays) = round(now, settings, sensors, &[], &asked);
        if let Some((i, next)) = pays {
            *now = next;
            taken.push((tried.swap_remove(i), 1.0));
        }
        rounds.push(own);
    }
    rounds
}
