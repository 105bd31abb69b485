//! How a list of effects ends: all parameters to free runs, and without what is hardly there.

use super::Stand;
use super::judge::grows;
use crate::criteria::Criteria;
use crate::fit::fit_free_runs;
use crate::gap::Gap;
use crate::search::magnitude::sizes;
use crate::search::measure::measured;
use crate::search::refit::Refit;
use crate::search::settings::Settings;
use crate::search::shares::{Parts, Portion, parts, shares, taken_out};

/// Where free runs on the train records lead, unless they grow on the test records.
pub(super) fn freely(now: Stand, criteria: &Criteria) -> Stand {
    let Some(fit) = fit_free_runs(&now.case, &now.directions, &now.fit) else {
        return now;
    };
    let gap = measured(&now.case, &fit);
    match grows(criteria, &now.gap, &gap) {
        true => now,
        false => Stand { fit, gap, ..now },
    }
}

/// A stand without one of its effects, all other parameters to free runs from where they are.
fn stand_without(now: &Stand, criteria: &Criteria, i: usize) -> Stand {
    let fit = taken_out(&now.case, &now.directions, &now.fit, i);
    let less = Stand {
        gap: measured(&now.case, &fit),
        case: now.case.clone(),
        directions: now.directions.clone(),
        fit,
    };
    freely(less, criteria)
}

/// Drops effects of hardly any share, the smallest first, and those that are smaller than their
/// deviation, unless free runs leave more without them than is nearly the same. The gaps with and without
/// each of the others with their shares, and the labels of those dropped.
pub(super) fn smallest_dropped(
    now: &mut Stand,
    taken: &mut Vec<(Refit, f64)>,
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
        let less = small.map(|i| (i, stand_without(now, criteria, i)));
        let nearly_same = |less: &Stand| less.gap.total < criteria.near * now.gap.total;
        match less.filter(|(_, less)| nearly_same(less)) {
            None => return (parts.into_iter().zip(own).collect(), dropped),
            Some((i, less)) => {
                *now = less;
                dropped.push(taken.remove(i).0.term.label());
            }
        }
    }
}
