//! A law of its own for what the named effects leave.
//!
//! Where free runs with the named effects leave more than noise, [terms](pid_effects::terms) without a
//! name are taken one after the other by the rules for effects: a score beyond chance, a gain on records
//! never fitted, and free runs that shrink beyond their scatter. Their sum is the law. Where a law
//! without a name describes the records better than the effects, these are judged again beside it.

use pid_data::Role;

use super::finish::ended;
use super::judge::grows;
use super::read_off::Missing;
use super::{Asked, Sought, Stand, pruned, round};
use crate::case::Case;
use crate::diagnosis::{Earned, OwnLaw, Remainder, Round};
use crate::effect::Term;
use crate::fit::{Effort, Fit, fit};
use crate::levels::SHORT;
use crate::search::evidence::Evidence;
use crate::search::magnitude::name;
use crate::search::measure::{measured, share};
use crate::search::settings::Settings;
use crate::terms;

/// The evidence with a law of its own beside the effects, where something is left that terms describe;
/// `case` has the levels from which the effects were sought.
pub(in crate::search) fn with_law(
    mut evidence: Evidence,
    case: &Case,
    settings: &Settings,
) -> Evidence {
    let criteria = &settings.criteria;
    let left = evidence.after.total >= criteria.near * evidence.floor;
    if evidence.remainder.is_none() || !left || settings.watch.stopped() {
        return evidence;
    }
    let Some(sought) = evidence.sought.take() else {
        return evidence;
    };
    settings.watch.step("a law of its own for what is left");
    let Sought { stand, sensors } = *sought;
    let mut now = resumed(stand, &evidence.fit, settings);
    let named: Vec<String> = labels(&now);
    let rounds = taken(&mut now, settings, &sensors, &named);
    evidence.refits += rounds.iter().map(|r| r.candidates.len()).sum::<usize>();
    evidence.rounds.extend(rounds);
    if labels(&now).iter().all(|label| named.contains(label)) {
        return evidence;
    }
    let now = ended(case, SHORT, now, settings, &sensors);
    let explained = |gap: f64| share(evidence.before.total, gap, evidence.floor);
    let own = explained(now.gap.total) - explained(evidence.after.total);
    if own < criteria.least_share || grows(criteria, &evidence.after, &now.gap) {
        return evidence;
    }
    adopted(evidence, now, own)
}

/// Where the search for effects ended, with those of a fit alone.
fn resumed(now: Stand, kept: &Fit, settings: &Settings) -> Stand {
    let all: Vec<String> = kept.hypothesis.terms.iter().map(Term::label).collect();
    if labels(&now) == all {
        return now;
    }
    let (case, directions) = (now.case, now.directions);
    let effort = Effort::full(settings.budget.steps);
    let fit = fit(
        &case,
        &directions,
        &kept.hypothesis,
        kept.point.clone(),
        effort,
    );
    Stand {
        gap: measured(&case, &fit),
        case,
        directions,
        fit,
    }
}

/// Labels of the effects of a stand.
fn labels(now: &Stand) -> Vec<String> {
    now.fit.hypothesis.terms.iter().map(Term::label).collect()
}

/// Takes terms until none pays; the effects that are named stay.
fn taken(
    now: &mut Stand,
    settings: &Settings,
    sensors: &[(f64, f64)],
    named: &[String],
) -> Vec<Round> {
    let of_terms = Settings {
        effects: terms::all(),
        ..settings.clone()
    };
    let mut rounds: Vec<Round> = Vec::new();
    for _ in 0..settings.budget.terms {
        if settings.watch.stopped() {
            break;
        }
        let missing = Missing::new(&now.case, &now.fit);
        let asked = Asked {
            only: &|_| true,
            starts: &|term| missing.starts(term),
            shown: false,
        };
        let (_, mut own, pays) = round(now, &of_terms, sensors, &asked);
        let Some((_, next)) = pays else {
            rounds.push(own);
            break;
        };
        *now = next;
        let before = labels(now);
        let stays = |label: &str| named.iter().any(|n| n == label);
        let dropped = pruned(now, settings, sensors, &stays);
        let kept = labels(now);
        own.dropped
            .extend(before.into_iter().filter(|label| !kept.contains(label)));
        let circles = !dropped.is_empty();
        rounds.push(own);
        if circles {
            break;
        }
    }
    rounds
}

/// The evidence with a law that removes a share of the gap.
fn adopted(evidence: Evidence, now: Stand, share: f64) -> Evidence {
    let Evidence {
        effects, remainder, ..
    } = &evidence;
    let all = name(&now.case, &evidence.criteria, &now.fit);
    let count = effects.len();
    let effects = (effects.iter())
        .map(|old| {
            let again = all
                .iter()
                .find(|n| n.effect == old.effect && n.joint == old.joint);
            let mut named = old.clone();
            if let Some(again) = again {
                named.parameters.clone_from(&again.parameters);
            }
            named
        })
        .collect();
    let law = OwnLaw {
        terms: all.into_iter().skip(count).collect(),
        share,
        gap_without: evidence.after.total,
        earned: earned(&now.case),
    };
    let remainder = remainder.clone().map(|left| Remainder {
        law: Some(law),
        ..left
    });
    let floor = evidence.floor.min(now.gap.total);
    Evidence {
        without_law: Some(Box::new(evidence.fit)),
        effects,
        remainder,
        floor,
        case: now.case,
        fit: now.fit,
        after: now.gap,
        ..evidence
    }
}

/// What the train records pass through, joint by joint.
fn earned(case: &Case) -> Vec<Earned> {
    let train = || case.records.iter().filter(|r| r.role == Role::Train);
    let hull = |x: &mut dyn Iterator<Item = f64>| {
        x.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
            (low.min(x), high.max(x))
        })
    };
    let of = |j: usize| Earned {
        joint: j + 1,
        position: hull(&mut train().flat_map(|r| r.smooth_q[j].iter().copied())),
        velocity: hull(&mut train().flat_map(|r| r.smooth_v[j].iter().copied())),
    };
    (0..case.n()).map(of).collect()
}
