//! Two effects at once, where none pays alone.
//!
//! Two causes can hide each other: a tilted base and friction that differs between directions both push, and where
//! each pushes against the other, neither alone lets free runs shrink. So the best of a round that took none are
//! each taken on trial, and the second one is asked for beside them. It has to pay as any effect does, and both
//! together have to pay over nothing by the same rules, as one of all pairs.

use super::judge::{gained, refused, sums_of};
use super::{Asked, renewed, round, with_odds};
use crate::diagnosis::Round;
use crate::screen::candidates;
use crate::search::measure::measured;
use crate::search::refit::Refit;
use crate::search::settings::Settings;
use crate::search::shares::with;
use crate::search::stand::Stand;

/// What is taken next.
pub(super) struct Step {
    /// One effect or two, each with its odds, and where they lead; none where none pays.
    pub(super) taken: Option<(Vec<(Refit, f64)>, Stand)>,
    /// The other candidates of the first round, alike.
    pub(super) others: Vec<(Refit, f64)>,
    /// The rounds that say so.
    pub(super) rounds: Vec<Round>,
}

/// The effect that pays beside what is there; where none does and `both` may be taken, two at once.
pub(super) fn step(
    now: &Stand,
    settings: &Settings,
    sensors: &[(f64, f64)],
    asked: &Asked<'_>,
    both: bool,
) -> Step {
    let (tried, mut own, pays) = round(now, settings, sensors, asked);
    let mut others = with_odds(tried, &own, pays.as_ref().map(|(i, _)| *i));
    if let Some((i, stand)) = pays {
        return Step {
            taken: Some((vec![others.remove(i)], stand)),
            others,
            rounds: vec![own],
        };
    }
    let found = if both {
        pair(now, &others, settings, sensors, asked)
    } else {
        None
    };
    let Some(found) = found else {
        return Step {
            taken: None,
            others,
            rounds: vec![own],
        };
    };
    own.candidates[found.first].refused = None;
    let first = others.remove(found.first);
    Step {
        taken: Some((vec![first, found.second], found.stand)),
        others,
        rounds: vec![own, found.round],
    }
}

/// Two effects that pay together.
struct Pair {
    /// Place of the first in the round that took none.
    first: usize,
    /// The second, with its odds among those asked beside the first.
    second: (Refit, f64),
    /// The round beside the first.
    round: Round,
    /// Where both lead.
    stand: Stand,
}

/// The pair that leaves the smallest gap, of the best [`pairs`](crate::criteria::Budget::pairs) of a round that took
/// none, each with the second that pays beside it.
fn pair(
    now: &Stand,
    tried: &[(Refit, f64)],
    settings: &Settings,
    sensors: &[(f64, f64)],
    asked: &Asked<'_>,
) -> Option<Pair> {
    let there = now.fit.hypothesis.terms.len();
    let candidates = candidates(&now.case, &settings.effects, &now.fit.hypothesis).len();
    let mut best: Option<Pair> = None;
    for (first, (on_trial, _)) in tried.iter().enumerate().take(settings.budget.pairs) {
        if settings.watch.stopped() {
            break;
        }
        let label = on_trial.term.label();
        let step = format!("shares of the gap: a pair with {label}");
        settings.watch.step(&step);
        let mut case = now.case.clone();
        let (fit, directions) = renewed(&mut case, settings, &on_trial.fit, sensors);
        let gap = measured(&case, &fit);
        let beside = Stand {
            case,
            directions,
            fit,
            gap,
        };
        let (refits, round, pays) = round(&beside, settings, sensors, asked);
        let Some((i, stand)) = pays else {
            continue;
        };
        // Under the levels that both leave, beside what was there before them.
        let (case, directions) = (&stand.case, &stand.directions);
        let steps = settings.budget.steps;
        let neither = with(case, directions, steps, &stand.fit, |k| k < there);
        let own = gained(case, &sums_of(case, &neither), &stand.fit);
        let terms = [&on_trial.term, &refits[i].term];
        let parameters = terms.map(|t| t.effect.info().parameters.len());
        let score = own.score(parameters.iter().sum(), candidates * candidates);
        let judged = (terms[1], score, own.test);
        let refused = refused(&settings.criteria, &now.gap, judged, &stand.gap, false);
        let least = best.as_ref().map_or(f64::INFINITY, |b| b.stand.gap.total);
        if refused.is_none() && stand.gap.total < least {
            let second = with_odds(refits, &round, Some(i)).swap_remove(i);
            best = Some(Pair {
                first,
                second,
                round,
                stand,
            });
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, among_a_dozen, named, pendulum};
    use crate::case::Case;
    use crate::effect::Term;
    use crate::fit::{Effort, Point, basis, fit};
    use crate::hypothesis::Hypothesis;
    use crate::levels::SHORT;
    use crate::search::partial::{readings, tuned};

    /// The pair that is found on a case of which the best candidate of a round is known.
    fn found(case: &Case, best: &[&str]) -> Option<Pair> {
        let settings = among_a_dozen();
        let sensors = readings(case);
        let nothing = Point {
            theta: vec![0.0; SIZE],
            e: Vec::new(),
        };
        let none = Hypothesis::default();
        let base = fit(case, &basis(case), &none, nothing, Effort::full(14));
        let now = tuned(case, &base, SHORT, &settings, &sensors);
        let asked = Asked {
            only: &|_| true,
            starts: &|_| Vec::new(),
            shown: false,
        };
        let (tried, own, _) = round(&now, &settings, &sensors, &asked);
        let mut tried = with_odds(tried, &own, None);
        tried.retain(|(r, _)| best.contains(&r.term.effect.info().id));
        assert_eq!(tried.len(), best.len());
        pair(&now, &tried, &settings, &sensors, &asked)
    }

    #[test]
    fn the_second_of_two_is_found_beside_the_first() {
        // Each pushes, and a spring takes for its own what the other does.
        let both = named(&["coulomb_asymmetry", "spring"]);
        let case = pendulum(&both, &[0.4, 0.9, 0.2], 8.0, &|_| {});
        for (first, second) in [
            ("coulomb_asymmetry", "spring"),
            ("spring", "coulomb_asymmetry"),
        ] {
            let pair = found(&case, &[first]).expect("a pair");
            assert_eq!(pair.first, 0);
            assert_eq!(pair.second.0.term.label(), format!("{second}:1"));
            assert_eq!(pair.round.beside, [format!("{first}:1")]);
            let labels: Vec<String> = (pair.stand.fit.hypothesis.terms.iter())
                .map(Term::label)
                .collect();
            assert_eq!(labels, [first, second].map(|id| format!("{id}:1")));
        }
    }

    #[test]
    fn nothing_pays_beside_the_only_effect_there_is() {
        let case = pendulum(&named(&["spring"]), &[0.9, 0.2], 8.0, &|_| {});
        assert!(found(&case, &["spring"]).is_none());
    }
}
