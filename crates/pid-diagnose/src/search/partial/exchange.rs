//! Whether an effect taken early stands in the place of one that it is confused with.
//!
//! A delay and a lag, play and a spring look alike while other effects are missing. Beside the
//! effects taken since, each earlier one meets those it is confused with at its joint once more,
//! from the parameters of all the others as they are.

use super::judge::takes_the_place;
use super::shown::{Shown, stays};
use super::{Asked, last_of, round};
use crate::diagnosis::Round;
use crate::search::measure::measured;
use crate::search::refit::Refit;
use crate::search::settings::Settings;
use crate::search::shares::taken_out;
use crate::search::stand::Stand;

/// Exchanges effects for others that they are confused with where these leave a smaller gap, or predict better
/// beyond doubt and leave no larger one beyond its scatter; the rounds in which that happened. `taken` are the
/// effects of the fit at hand, in its order; those that signals show stay.
pub(super) fn exchange(
    now: &mut Stand,
    taken: &mut Vec<(Refit, f64)>,
    settings: &Settings,
    sensors: &[(f64, f64)],
    shown: &[Shown],
) -> Vec<Round> {
    let mut out = Vec::new();
    // The last one was taken beside all the others just now. An exchanged one goes to the end.
    for _ in 0..taken.len() - 1 {
        let at = out.len();
        let exchanged = (0..taken.len() - 1 - at)
            .filter(|&i| !stays(shown, &taken[i].0.term.label()))
            .find_map(|i| exchange_one(now, i, settings, sensors));
        let Some((i, refit, next, mut own)) = exchanged else {
            break;
        };
        own.dropped.push(taken.remove(i).0.term.label());
        taken.push((refit, 1.0));
        *now = next;
        out.push(own);
    }
    out
}

/// What takes the place of the `i`-th effect, if something does.
fn exchange_one(
    now: &Stand,
    i: usize,
    settings: &Settings,
    sensors: &[(f64, f64)],
) -> Option<(usize, Refit, Stand, Round)> {
    let criteria = &settings.criteria;
    let old = &now.fit.hypothesis.terms[i];
    // Fitted again without it, the others would leave the place where the next one is looked for.
    let less = taken_out(&now.case, &now.directions, &now.fit, i);
    let stand = Stand {
        case: now.case.clone(),
        directions: now.directions.clone(),
        gap: measured(&now.case, &less),
        fit: less,
    };
    let (mut tried, mut own, taken) = round(
        &stand,
        settings,
        sensors,
        &Asked {
            only: &|term| {
                let alike = term.label() == old.label() || old.is_confused_with(term);
                term.joint == old.joint && alike
            },
            starts: &|term| last_of(std::slice::from_ref(&now.fit), term),
            shown: false,
        },
    );
    let (best, next) = taken?;
    let other = tried[best].term.label() != old.label();
    let again = tried.iter().find(|r| r.term.label() == old.label());
    let gain = again.map_or(0.0, |again| tried[best].score - again.score);
    own.exchange = true;
    let better = other && takes_the_place(criteria, gain, &now.gap, &next.gap);
    better.then(|| (i, tried.swap_remove(best), next, own))
}
