//! Lags that a reading shows by itself.
//!
//! A velocity that follows late from the positions of its own joint needs no model of the robot to be
//! seen, and no place or kind is chosen among many. So it comes before every round, without the margin
//! for many candidates and without a share of free runs: it must predict motions never fitted better,
//! and free runs must not grow. Where a larger effect hides it, it comes after that. It stays beside
//! every effect that is taken later.

use super::{Asked, Stand, round};
use crate::case::Case;
use crate::channel::late_readings;
use crate::diagnosis::Round;
use crate::effect::Term;
use crate::search::refit::Refit;
use crate::search::settings::Settings;

/// The effect by which a velocity reading lags.
const LAG: &str = "velocity_filter_lag";

/// Labels of the lags that the readings of a case show and that its description lacks.
pub(super) fn labels(case: &Case, settings: &Settings) -> Vec<String> {
    let Some(lag) = settings.effects.iter().find(|e| e.info().id == LAG) else {
        return Vec::new();
    };
    let known = |j: usize| case.known.parameters(LAG, j).is_some();
    let late = late_readings(case).into_iter().filter(|&j| !known(j));
    let term = |joint| Term {
        effect: lag.clone(),
        joint,
    };
    late.map(|joint| term(joint).label()).collect()
}

/// Takes the lags that the readings show and that are not taken yet; the rounds that took one.
pub(super) fn take_shown(
    now: &mut Stand,
    taken: &mut Vec<(Refit, f64)>,
    shown: &[String],
    settings: &Settings,
    sensors: &[(f64, f64)],
) -> Vec<Round> {
    let mut rounds = Vec::new();
    for label in shown {
        if taken.iter().any(|(r, _)| r.term.label() == *label) {
            continue;
        }
        let asked = Asked {
            only: &|term| term.label() == *label,
            shown: true,
        };
        let (mut tried, own, pays) = round(now, settings, sensors, &[], &asked);
        if let Some((i, next)) = pays {
            *now = next;
            taken.push((tried.swap_remove(i), 1.0));
            rounds.push(own);
        }
    }
    rounds
}
