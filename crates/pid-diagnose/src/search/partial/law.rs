//! A law of its own for what the named effects leave.
//!
//! Where free runs with the named effects leave more than noise, [terms](pid_effects::terms) without a
//! name are taken one after the other by the rules for effects: a score beyond chance, a gain on records
//! never fitted, and free runs that shrink beyond their scatter. Their sum is the law. Where effects imitate
//! what has no name, effects and terms are taken together.

use std::collections::BTreeSet;

use pid_data::Role;

use super::finish::{ended, in_shares, with_effects};
use super::judge::grows;
use super::read_off::Missing;
use super::{Asked, Grown, SMALLER, last_of, pruned, readings, round, tuned, with_odds};
use crate::case::Case;
use crate::criteria::Criteria;
use crate::diagnosis::{Earned, Named, OwnLaw, Remainder, Round, Tried};
use crate::effect::Term;
use crate::fit::{Effort, Fit, fit};
use crate::levels::SHORT;
use crate::search::evidence::Evidence;
use crate::search::magnitude::name;
use crate::search::measure::measured;
use crate::search::refit::Refit;
use crate::search::settings::Settings;
use crate::search::shares::{self, Fitted, Portion, beyond, parts, with};
use crate::search::stand::{Sought, Stand};
use crate::terms;

/// The evidence with a law of its own beside the effects, where something is left that terms describe;
/// `case` has the levels from which the effects were sought.
///
/// Effects imitate what has no name. Where many leave much all the same, where a free law describes the records
/// better, or where nothing is left of an effect beside a term that explains more, effects and terms are taken
/// together from the nominal structure on.
pub(in crate::search) fn with_law(
    mut evidence: Evidence,
    case: &Case,
    settings: &Settings,
) -> Evidence {
    let criteria = &settings.criteria;
    let over = |floors: f64, e: &Evidence| e.after.total >= floors * e.floor;
    let sought = evidence.sought.take();
    // A hum is no noise, however little it moves the robot.
    let lines = criteria.allowance * criteria.line(evidence.residue.of.frequencies);
    let left = over(criteria.near, &evidence) || evidence.residue.hum >= lines;
    if evidence.remainder.is_none() || !left || settings.watch.stopped() {
        return evidence;
    }
    let mut imitated = evidence
        .remainder
        .as_ref()
        .is_some_and(|r| r.nameless.is_some());
    let mut sensors = readings(case);
    if let Some(sought) = sought {
        settings.watch.step("a law of its own for what is left");
        let now = resumed(sought.stand, &evidence.fit, settings);
        sensors = sought.sensors;
        let named: Vec<String> = labels(&now);
        let least = at_most(criteria, now.gap.total, 2.0);
        let before = evidence.rounds.len();
        evidence = beside(evidence, case, now, settings, &sensors, &named);
        imitated |= evidence.part.is_some_and(|part| part.nameless);
        imitated |= evidence.rounds[before..].iter().any(|r| replaces(r, least));
        let many = named.len() > criteria.together && over(criteria.unexplained, &evidence);
        imitated = !named.is_empty() && (imitated || many);
    }
    if imitated && !settings.watch.stopped() {
        settings.watch.step("effects and a law of its own together");
        let base = tuned(case, &evidence.base, SHORT, settings, &sensors);
        evidence = beside(evidence, case, base, settings, &sensors, &[]);
    }
    evidence
}

/// The evidence with the terms that pay beside a stand, and effects where none is `named`, if they leave
/// less than what was reached.
fn beside(
    mut evidence: Evidence,
    case: &Case,
    mut now: Stand,
    settings: &Settings,
    sensors: &[(f64, f64)],
    named: &[String],
) -> Evidence {
    let criteria = &settings.criteria;
    let first = now.clone();
    let Taken {
        rounds,
        refits,
        others,
        visited,
    } = taken(&mut now, &evidence, settings, sensors, named);
    evidence.refits += rounds.iter().map(|r| r.candidates.len()).sum::<usize>();
    evidence.rounds.extend(rounds);
    let terms = now.fit.hypothesis.terms.iter().filter(|t| is_term(t));
    if refits.is_empty() || (terms.count() == 0 && !named.is_empty()) {
        return evidence;
    }
    // Beside named effects a law has to leave less as an effect has to. In their place it has to as a second one,
    // and fewer parameters need not.
    let fewer = now.fit.point.e.len() < evidence.fit.point.e.len();
    let steps = match named {
        [] if fewer => 0.0,
        [] => 2.0,
        _ => 1.0,
    };
    let least = at_most(criteria, evidence.after.total, steps);
    let now = ended(case, SHORT, (now, least), settings, sensors);
    if now.gap.total > least || grows(criteria, &evidence.after, &now.gap) {
        return evidence;
    }
    if !now.fit.hypothesis.terms.iter().any(is_term) {
        let grown = Grown {
            base: evidence.base.clone(),
            before: evidence.before.clone(),
            taken: refits,
            first,
            visited,
            given_up: false,
            others,
            rounds: std::mem::take(&mut evidence.rounds),
            refits: 0,
            now,
        };
        return alone(evidence, grown, settings, sensors);
    }
    if named.is_empty() {
        return together(evidence, now, settings);
    }
    let own = beyond(&evidence.before, &evidence.after, &now.gap, evidence.floor);
    let left = evidence.after.total;
    let without = evidence.fit.clone();
    adopted(evidence, now, (own, left, without))
}

/// What a list may leave where another one leaves a gap: less by so many times what one effect has to take away.
fn at_most(criteria: &Criteria, left: f64, steps: f64) -> f64 {
    (1.0 - steps * criteria.least_shrink) * left
}

/// Whether a term of a round leaves little and nothing to an effect beside it: that imitated it.
fn replaces(round: &Round, least: f64) -> bool {
    let smaller = |c: &Tried| c.refused.as_deref() == Some(SMALLER) && c.gap <= least;
    round.candidates.iter().any(smaller)
}

/// Whether a term is one of a law without a name.
fn is_term(term: &Term) -> bool {
    let id = term.effect.info().id;
    terms::all().iter().any(|t| t.info().id == id)
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

/// The evidence with effects that need no term beside them: from where the terms began, other starts led to more.
fn alone(
    evidence: Evidence,
    grown: Grown,
    settings: &Settings,
    sensors: &[(f64, f64)],
) -> Evidence {
    let sought = Sought {
        stand: grown.now.clone(),
        sensors: sensors.to_vec(),
    };
    let found = in_shares(grown, sought, evidence.floor, settings);
    with_effects(evidence, found, &settings.criteria)
}

/// What was taken on the way, as in [`Grown`].
#[derive(Default)]
struct Taken {
    rounds: Vec<Round>,
    refits: Vec<(Refit, f64)>,
    others: Vec<(Refit, f64)>,
    visited: Vec<Stand>,
}

/// Takes terms until none pays; the effects that are `named` stay. Where none is, effects are taken too, of
/// those that were among the best of a round of the evidence.
fn taken(
    now: &mut Stand,
    evidence: &Evidence,
    settings: &Settings,
    sensors: &[(f64, f64)],
    named: &[String],
) -> Taken {
    let mut effects = terms::all();
    if named.is_empty() {
        effects.extend(settings.effects.iter().cloned());
    }
    let wider = Settings {
        effects,
        ..settings.clone()
    };
    let tried = evidence.rounds.iter().flat_map(|r| &r.candidates);
    let tried: BTreeSet<&str> = tried.map(|c| c.label.as_str()).collect();
    let mut out = Taken::default();
    let kept = labels(now).len();
    for _ in 0..settings.budget.terms {
        if settings.watch.stopped() {
            break;
        }
        let missing = Missing::new(&now.case, &now.fit);
        let asked = Asked {
            only: &|term| is_term(term) || tried.contains(term.label().as_str()),
            starts: &|term| match is_term(term) {
                true => missing.starts(term),
                false => last_of(&evidence.rivals, term),
            },
            shown: false,
        };
        let (tried, mut own, pays) = round(now, &wider, sensors, &asked);
        let mut tried = with_odds(tried, &own, pays.as_ref().map(|(i, _)| *i));
        let Some((i, next)) = pays else {
            out.rounds.push(own);
            break;
        };
        *now = next;
        out.refits.push(tried.remove(i));
        if out.others.is_empty() {
            out.others = tried;
        }
        let stays = |label: &str| named.iter().any(|n| n == label);
        let dropped = pruned(now, settings, sensors, &stays);
        for &place in &dropped {
            let (refit, _) = out.refits.remove(place - kept);
            own.dropped.push(refit.term.label());
        }
        out.rounds.push(own);
        out.visited.push(now.clone());
        if !dropped.is_empty() {
            break;
        }
    }
    out
}

/// The evidence with a law that has its `own` share beside the named effects, which leave a gap under a
/// fit without it.
fn adopted(evidence: Evidence, now: Stand, (own, left, without): (Portion, f64, Fit)) -> Evidence {
    let all = name(&now.case, &evidence.criteria, &now.fit);
    let is_named = |n: &Named| {
        let mut named = evidence.effects.iter();
        named.any(|old| (&old.effect, old.joint) == (&n.effect, n.joint))
    };
    let (named, terms): (Vec<Named>, Vec<Named>) = all.into_iter().partition(is_named);
    let again = |old: &Named| {
        let mut found = named.iter();
        let found = found.find(|n| (&n.effect, n.joint) == (&old.effect, old.joint));
        Named {
            parameters: found.map_or_else(|| old.parameters.clone(), |n| n.parameters.clone()),
            ..old.clone()
        }
    };
    let effects = evidence.effects.iter().map(again).collect();
    let law = OwnLaw {
        terms,
        share: own.share,
        share_interval: own.interval,
        gap_without: left,
        earned: earned(&now.case),
    };
    let remainder = evidence.remainder.clone().map(|left| Remainder {
        law: Some(law),
        ..left
    });
    Evidence {
        floor: evidence.floor.min(now.gap.total),
        without_law: Some(Box::new(without)),
        effects,
        remainder,
        case: now.case,
        fit: now.fit,
        after: now.gap,
        ..evidence
    }
}

/// The evidence with effects and a law that were taken together, in place of what was named before.
fn together(mut evidence: Evidence, now: Stand, settings: &Settings) -> Evidence {
    let floor = evidence.floor.min(now.gap.total);
    let gaps = (&evidence.before, &now.gap);
    let fitted = (Fitted::Least, gaps.0, gaps.1);
    let parts = parts(&now.case, &now.directions, settings, &now.fit, fitted);
    let portions = shares::shares(&parts, &evidence.before, &now.gap, floor);
    let hypothesis = &now.fit.hypothesis;
    let keep = |i: usize| !is_term(&hypothesis.terms[i]);
    let without = with(
        &now.case,
        &now.directions,
        settings.budget.steps,
        &now.fit,
        keep,
    );
    let all = name(&now.case, &evidence.criteria, &now.fit);
    let mut effects: Vec<Named> = Vec::new();
    for (i, (mut named, own)) in all.into_iter().zip(&portions).enumerate() {
        if keep(i) {
            named.share = Some(own.share);
            named.share_interval = own.interval;
            effects.push(named);
        }
    }
    effects.sort_by(|a, b| b.share.unwrap_or(0.0).total_cmp(&a.share.unwrap_or(0.0)));
    let of_names: f64 = effects.iter().filter_map(|e| e.share).sum();
    let own = shares::together(&parts, gaps.0, gaps.1, floor, |i| !keep(i));
    if let Some(part) = &mut evidence.part {
        // What has a name is not the verdict where most has none, or effects imitated it.
        part.nameless = true;
    }
    if let Some(left) = &mut evidence.remainder {
        left.explained = of_names;
        left.own_error = true;
    }
    evidence.effects = effects;
    let left = measured(&now.case, &without).total;
    adopted(evidence, now, (own, left, without))
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{named, pendulum};
    use crate::diagnosis::{Outcome, Verdict};
    use crate::effects::by_id;
    use crate::search::{Settings, diagnose, search};

    /// A stop beside drag is no effect of the library: drag keeps its name, the stop is a law of one term.
    #[test]
    fn a_stop_beside_a_named_effect_is_a_law_of_its_own() {
        let (drag, k, from) = (0.06, 4.0, 0.5);
        let both = named(&["quadratic_drag", "hinge_above"]);
        let case = pendulum(&both, &[drag, k, from], 8.0, &|_| {});
        let d = diagnose(&case, &Settings::default());
        let found: Vec<&str> = d.effects.iter().map(|e| &*e.effect).collect();
        assert!(found.contains(&"quadratic_drag"), "{found:?}");
        let law = d.remainder.as_ref().and_then(|r| r.law.as_ref());
        let law = law.unwrap_or_else(|| panic!("no law: {d:?}"));
        assert_eq!(law.terms.len(), 1, "{law:?}");
        let stop = &law.terms[0];
        assert_eq!((&*stop.effect, stop.joint), ("hinge_above", Some(1)));
        for (parameter, truth) in stop.parameters.iter().zip([k, from]) {
            let off = (parameter.value / truth - 1.0).abs();
            assert!(off < 0.05, "{parameter:?}");
        }
        // It has no name, so the verdict does not say one.
        assert_eq!(
            (&d.verdict, d.outcome()),
            (&Verdict::Unknown, Outcome::PartlyUnknown)
        );
        assert!(d.gap_after < 0.5 * law.gap_without, "{d:?}");
        assert!(
            d.gap_after < 1.3 * d.gap_floor,
            "{} {}",
            d.gap_after,
            d.gap_floor
        );
        // Where the records have been, nothing else is said.
        let (low, high) = law.earned[0].position;
        assert!(low < from && from < high, "{:?}", law.earned);
    }

    /// In place of what was named a law has to leave 12 % less, or no more if it has fewer parameters; beside
    /// named effects it has to leave 6 % less.
    #[test]
    fn a_law_has_to_leave_less_than_what_has_as_few_parameters() {
        let case = pendulum(&named(&["hinge_above"]), &[4.0, 0.5], 8.0, &|_| {});
        let settings = Settings {
            effects: vec![by_id("quadratic_drag").expect("an effect")],
            ..Settings::default()
        };
        let mut blind = settings.clone();
        blind.budget.terms = 0;
        let evidence = search(&case, &blind);
        let sensors = readings(&case);
        let base = tuned(&case, &evidence.base, SHORT, &settings, &sensors);
        let taken = |left: f64, parameters: usize, named: &[String]| {
            let mut evidence = evidence.clone();
            evidence.after.total = left;
            evidence.fit.point.e = vec![0.0; parameters];
            let found = beside(evidence, &case, base.clone(), &settings, &sensors, named);
            let law = found.remainder.and_then(|r| r.law);
            law.map(|_| found.after.total)
        };
        let much = 10.0 * evidence.after.total;
        let least = taken(much, 0, &[]).expect("a stop");
        // The stop has two parameters.
        assert!(taken(1.05 * least, 3, &[]).is_some());
        assert!(taken(1.05 * least, 2, &[]).is_none());
        assert!(taken(1.2 * least, 2, &[]).is_some());
        let drag = ["quadratic_drag:1".to_owned()];
        assert!(taken(1.05 * least, 0, &drag).is_none());
        assert!(taken(1.1 * least, 0, &drag).is_some());
    }

    /// Where no term pays beside what is found then, effects are the verdict, and no law is said.
    #[test]
    fn effects_that_leave_no_term_are_named_without_a_law() {
        let (stiffness, preload) = (0.9, 0.2);
        let case = pendulum(&named(&["spring"]), &[stiffness, preload], 8.0, &|_| {});
        // A search that does not know the spring, and takes no terms.
        let effect = |id: &str| by_id(id).expect("an effect");
        let mut blind = Settings {
            effects: vec![effect("quadratic_drag")],
            ..Settings::default()
        };
        blind.budget.terms = 0;
        let mut evidence = search(&case, &blind);
        assert!(evidence.effects.is_empty() && evidence.remainder.is_some());
        let before = (evidence.before.clone(), evidence.after.total);

        let settings = Settings {
            effects: vec![effect("quadratic_drag"), effect("spring")],
            ..Settings::default()
        };
        evidence.rounds.push(Round {
            beside: Vec::new(),
            dropped: Vec::new(),
            exchange: false,
            candidates: vec![Tried {
                label: "spring:1".to_owned(),
                score: 0.0,
                held_out: 0.0,
                gap: evidence.after.total,
                refused: None,
            }],
        });
        let sensors = readings(&case);
        let base = tuned(&case, &evidence.base, SHORT, &settings, &sensors);
        let found = beside(evidence, &case, base, &settings, &sensors, &[]);
        assert_eq!(found.before, before.0);
        assert!(found.after.total < 0.2 * before.1, "{:?}", found.after);
        let [spring] = &found.effects[..] else {
            panic!("{:?}", found.effects);
        };
        assert_eq!((&*spring.effect, spring.joint), ("spring", Some(1)));
        let truth = [stiffness, preload / stiffness];
        for (parameter, truth) in spring.parameters.iter().zip(truth) {
            assert!(
                (parameter.value / truth - 1.0).abs() < 0.01,
                "{parameter:?}"
            );
        }
        assert_eq!(found.ranking[0].label(), "spring:1");
        assert!(found.without_law.is_none() && found.remainder.is_none_or(|r| r.law.is_none()));
        assert!(
            found
                .part
                .is_some_and(|part| !part.nameless && part.all > 0.9)
        );
    }
}
