//! How a list of effects ends: all parameters to free runs, without what is hardly there, in shares.

use super::judge::{Gained, gained, grows, shrinks_its_own, sums_of};
use super::starts::begun_again;
use super::{Grown, Partial, tuned};
use crate::case::Case;
use crate::criteria::Criteria;
use crate::effect::Term;
use crate::fit::fit_free_runs;
use crate::gap::Gap;
use crate::levels::WHOLE;
use crate::search::magnitude::sizes;
use crate::search::measure::measured;
use crate::search::nameless::{free_laws, imitated_in_part};
use crate::search::refit::Refit;
use crate::search::settings::Settings;
use crate::search::shares::{Parts, Portion, parts, shares, taken_out};
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
    let (shares, small) = smallest_dropped((now, taken), visited, settings, gaps);
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
/// deviation, unless free runs leave more without them than is nearly the same. The gaps with and without
/// each of the others with their shares, and the labels of those dropped.
fn smallest_dropped(
    (now, taken): (&mut Stand, &mut Vec<(Refit, f64)>),
    visited: &[Stand],
    settings: &Settings,
    (before, floor): (&Gap, f64),
) -> (Vec<(Parts, Portion)>, Vec<String>) {
    let mut dropped = Vec::new();
    loop {
        let gaps = (before, &now.gap);
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
            None => return (parts.into_iter().zip(own).collect(), dropped),
            Some((i, less)) => {
                *now = less;
                dropped.push(taken.remove(i).0.term.label());
            }
        }
    }
}
