//! How a list of effects ends: all parameters to free runs, without what is hardly there, in shares, as evidence.

use super::judge::{Gained, gained, grows, shrinks_its_own, sums_of};
use super::starts::begun_again;
use super::{Grown, Partial, tuned};
use crate::case::Case;
use crate::criteria::Criteria;
use crate::diagnosis::{Named, Remainder};
use crate::effect::Term;
use crate::fit::fit_free_runs;
use crate::gap::Gap;
use crate::levels::WHOLE;
use crate::noise;
use crate::search::evidence::{Evidence, Part};
use crate::search::magnitude::{name, sizes};
use crate::search::measure::{measured, noise_alone, share};
use crate::search::nameless::{described, free_laws, imitated_in_part};
use crate::search::odds::plain;
use crate::search::refit::Refit;
use crate::search::settings::Settings;
use crate::search::shares::{Fitted, Parts, Portion, parts, shares, taken_out};
use crate::search::stand::{Sought, Stand};

/// Where free runs on the train records lead, unless they grow on the test records beyond their scatter, or to more
/// than what is nearly the same: one window in which a joint drifts away has a large scatter.
fn freely(now: Stand, criteria: &Criteria) -> Stand {
    let Some(fit) = fit_free_runs(&now.case, &now.directions, &now.fit) else {
        return now;
    };
    let gap = measured(&now.case, &fit);
    let more = gap.total >= criteria.near * now.gap.total;
    match more || grows(criteria, &now.gap, &gap) {
        true => now,
        false => Stand { fit, gap, ..now },
    }
}

/// Where a list of effects leads whose parameters are all fitted over the whole horizon, if that leaves
/// less, those of effects with states begun again, and then to free runs, unless more than `most` is left only then.
pub(super) fn ended(
    case: &Case,
    part: f64,
    (mut now, most): (Stand, f64),
    settings: &Settings,
    sensors: &[(f64, f64)],
) -> Stand {
    if part < WHOLE && !settings.watch.stopped() {
        let step = "shares of the gap: all parameters over the whole horizon";
        settings.watch.step(step);
        let whole = tuned(case, &now.fit, WHOLE, settings, sensors);
        if whole.gap.total < now.gap.total {
            now = whole;
        }
    }
    for i in 0..now.fit.hypothesis.terms.len() {
        now = begun_again(now, i, WHOLE, settings, sensors);
    }
    if settings.watch.stopped() {
        return now;
    }
    let step = "shares of the gap: all parameters to free runs";
    settings.watch.step(step);
    let free = freely(now.clone(), &settings.criteria);
    match free.gap.total >= most && now.gap.total < most {
        true => now,
        false => free,
    }
}

/// The list with the share of each effect, and the free law that describes the records better in place
/// of all; noise alone leaves `floor`.
pub(super) fn in_shares(
    mut grown: Grown,
    sought: Sought,
    floor: f64,
    settings: &Settings,
) -> Partial {
    let (now, taken) = (&mut grown.now, &mut grown.taken);
    // Noise alone leaves no more than what is reached.
    let gaps = (&grown.before, floor.min(now.gap.total));
    let visited = &grown.visited;
    let small = smallest_dropped((now, taken), visited, settings, gaps);
    let fitted = (Fitted::Least, gaps.0, &now.gap);
    let parts = parts(&now.case, &now.directions, settings, &now.fit, fitted);
    let shares = shares(&parts, gaps.0, &now.gap, gaps.1);
    let shares = parts.into_iter().zip(shares).collect();
    if let Some(last) = grown.rounds.last_mut() {
        last.dropped.extend(small);
    }
    let laws = match settings.watch.stopped() {
        true => Vec::new(),
        false => free_laws(&now.case, &now.directions, settings, &grown.base, |_| true),
    };
    grown.refits += laws.len();
    let law = laws.into_iter().next().and_then(|law| {
        let Gained {
            train,
            test,
            number,
        } = gained(&now.case, &sums_of(&now.case, &now.fit), &law.fit);
        imitated_in_part(&settings.criteria, (&now.fit, &law), train + test, number)
            .then(|| measured(&now.case, &law.fit).total)
            .map(|gap| (law, gap))
    });
    Partial {
        grown,
        shares,
        law,
        sought,
    }
}

/// A stand without one of its effects, all other parameters to free runs from where they are; or from where the same
/// effects were on the way, in the same order, if free runs leave less there.
fn stand_without(now: &Stand, visited: &[Stand], criteria: &Criteria, i: usize) -> Stand {
    let fit = taken_out(&now.case, &now.directions, &now.fit, i);
    let less = Stand {
        gap: measured(&now.case, &fit),
        case: now.case.clone(),
        directions: now.directions.clone(),
        fit,
    };
    let labels = |s: &Stand| -> Vec<String> {
        let terms = s.fit.hypothesis.terms.iter();
        terms.map(Term::label).collect()
    };
    let own = labels(&less);
    let same = visited.iter().filter(|s| labels(s) == own);
    let all = same.cloned().chain([less.clone()]);
    let best = all.min_by(|a, b| a.gap.total.total_cmp(&b.gap.total));
    freely(best.unwrap_or(less), criteria)
}

/// Drops effects of hardly any share, the smallest first, and those that are smaller than their
/// deviation, unless free runs leave more without them than is nearly the same. The labels of those dropped.
fn smallest_dropped(
    (now, taken): (&mut Stand, &mut Vec<(Refit, f64)>),
    visited: &[Stand],
    settings: &Settings,
    (before, floor): (&Gap, f64),
) -> Vec<String> {
    let mut dropped = Vec::new();
    loop {
        let gaps = (Fitted::Predictions, before, &now.gap);
        let parts = parts(&now.case, &now.directions, settings, &now.fit, gaps);
        let own = shares(&parts, before, &now.gap, floor);
        let smallest = (0..own.len()).min_by(|&a, &b| own[a].share.total_cmp(&own[b].share));
        let criteria = &settings.criteria;
        let small = smallest.filter(|&i| own[i].share < criteria.least_share);
        let sizes = sizes(&now.case, criteria, &now.fit);
        let small = small.or_else(|| (0..own.len()).find(|&i| sizes[i] <= 1.0));
        let less = small.map(|i| (i, stand_without(now, visited, criteria, i)));
        // A window in which one joint drifts away hides the shares of effects at the others.
        let nearly_same = |(i, less): &(usize, Stand)| {
            let term = &now.fit.hypothesis.terms[*i];
            less.gap.total < criteria.near * now.gap.total
                && !shrinks_its_own(criteria, term, &less.gap, &now.gap)
        };
        match less.filter(nearly_same) {
            None => return dropped,
            Some((i, less)) => {
                *now = less;
                dropped.push(taken.remove(i).0.term.label());
            }
        }
    }
}

/// The gap that noise alone leaves where its stated level is the least there can be: the input is
/// also wrong between its samples. Drive noise is then what the nominal structure leaves.
fn floor_of_records(evidence: &Evidence) -> f64 {
    let mut case = evidence.case.clone();
    for noise in &mut case.noise {
        noise.stated = false;
    }
    noise::settle(&mut case, &evidence.base);
    noise_alone(&case, &evidence.base).typical
}

/// The floor under which nothing but noise is left of the gap `before`, if one is near enough: that of noise
/// alone, or that of the records. A hum is no noise, however little it moves the robot.
fn floor_of_nothing(evidence: &Evidence, before: &Gap, floor: f64) -> Option<f64> {
    let criteria = &evidence.criteria;
    let lines = criteria.allowance * criteria.line(evidence.residue.of.frequencies);
    if evidence.residue.hum >= lines {
        return None;
    }
    let near = |floor: &f64| before.total < criteria.near * floor;
    Some(floor)
        .filter(near)
        .or_else(|| Some(floor_of_records(evidence)).filter(near))
}

/// Places of the effects by their shares.
fn largest_first(shares: &[(Parts, Portion)]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..shares.len()).collect();
    order.sort_by(|&a, &b| shares[b].1.share.total_cmp(&shares[a].1.share));
    order
}

/// The effects in an order, each with its share.
fn shared_out(mut effects: Vec<Named>, shares: &[(Parts, Portion)], order: &[usize]) -> Vec<Named> {
    for (named, (_, own)) in effects.iter_mut().zip(shares) {
        named.share = Some(own.share);
        named.share_interval = own.interval;
    }
    order.iter().map(|&i| effects[i].clone()).collect()
}

/// The evidence of a search with what the library explains in part.
pub(super) fn with_effects(evidence: Evidence, found: Partial, criteria: &Criteria) -> Evidence {
    let Partial {
        grown,
        shares,
        law,
        sought,
    } = found;
    let Grown {
        base,
        before,
        now,
        taken,
        others,
        rounds,
        refits,
        given_up,
        ..
    } = grown;
    let Stand {
        case,
        fit,
        gap: after,
        ..
    } = now;
    let floor = evidence.floor.min(after.total);
    // What an effect predicts is no noise.
    let enough = match taken.is_empty() && !given_up {
        true => floor_of_nothing(&evidence, &before, floor),
        false => None,
    };
    let coloured = enough.is_some();
    let floor = enough.unwrap_or(floor);
    let explained = |gap: f64| share(before.total, gap, floor);
    let nameless = law
        .as_ref()
        .map(|(law, gap)| (law, explained(*gap)))
        .filter(|(_, explained)| *explained > criteria.majority)
        .and_then(|(law, explained)| described(&case, criteria, law, explained));
    let order = largest_first(&shares);
    let effects = shared_out(name(&case, criteria, &fit), &shares, &order);
    let ranking: Vec<(Refit, f64)> = (order.iter().map(|&i| taken[i].clone()))
        .chain(others)
        .collect();
    Evidence {
        effects,
        ranking: plain(&ranking),
        rounds,
        coloured,
        floor,
        part: Some(Part {
            first: order
                .first()
                .map_or(0.0, |&i| explained(shares[i].0.alone.total)),
            all: explained(after.total),
            left: after.total / floor,
            nameless: law.is_some(),
        }),
        remainder: (!coloured).then(|| Remainder {
            explained: explained(after.total),
            own_error: true,
            missing_force: Vec::new(),
            ceilings: Vec::new(),
            nameless,
            law: None,
        }),
        rivals: ranking.into_iter().map(|r| r.0.fit).collect(),
        refits: evidence.refits + refits,
        sought: Some(Box::new(sought)),
        without_law: None,
        case,
        base,
        fit,
        before,
        after,
        ..evidence
    }
}
