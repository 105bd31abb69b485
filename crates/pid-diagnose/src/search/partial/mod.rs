//! Effects that pay although something is left that none of them explains.
//!
//! Where the verdict is `unknown`, the innovations are the model's errors and no measure of noise.
//! The nominal parameters are then fitted again to slow predictions (see
//! [`levels`](crate::levels)), and effects are taken one after the other, each judged by
//!
//! ```text
//! score = Σ over joints, channels, roles  N′ ln(S₀/S₁)  −  k ln N′  −  2 ln(candidates)
//! ```
//!
//! with the sums of squares S without and with it and the number N′ of independent samples of what
//! it leaves: twice the gain in profile likelihood with the level unknown (L. Ljung, System
//! Identification, 1999, section 7.4). It must also shrink the free-run gap on motions never fitted
//! by more than the scatter between their windows, over all joints or at its own. After each effect
//! taken those before it are judged again beside it, and the whole list is scored again. Delays and
//! lags that a signal shows by itself are asked for before every round (see the module `shown`).

mod exchange;
mod finish;
mod judge;
mod law;
mod pairs;
mod read_off;
mod shown;
mod starts;
#[cfg(test)]
mod tests;

use rayon::prelude::*;

use super::candidates::{directions, listed, overdamped};
use super::evidence::Evidence;
use super::magnitude::sizes;
use super::measure::{measured, share};
use super::odds::within_round;
use super::refit::{Refit, refit};
use super::settings::Settings;
use super::shares::{Parts, Portion, without};
use super::shorter::as_short;
use super::stand::{Sought, Stand};
use crate::case::Case;
use crate::criteria::Budget;
use crate::diagnosis::{Round, Tried};
use crate::effect::Term;
use crate::fit::{Basis, Effort, Fit, fit};
use crate::gap::Gap;
use crate::levels::{WHOLE, follow_slowly, settle};
use crate::screen::screen;
use exchange::exchange;
use finish::{ended, in_shares, with_effects};
use judge::{at_an_end, gained, grows, judge, refused, sums_of};
pub(super) use law::with_law;
use pairs::step;
use shown::{shown, stays, take_shown};
use starts::{begun_again, last_of};

/// What the library explains, and what it is judged against.
struct Partial {
    grown: Grown,
    /// Gaps with and without each effect, and its share.
    shares: Vec<(Parts, Portion)>,
    /// A free law in place of the effects that describes the records better, and its gap.
    law: Option<(Refit, f64)>,
    sought: Sought,
}

/// A list of effects that pay in predictions.
struct Grown {
    /// The nominal structure, tuned, and its gap.
    base: Fit,
    before: Gap,
    /// With the effects that pay.
    now: Stand,
    /// The refits they were taken as, in the order of [`Stand::fit`], each with its probability among
    /// those of its round.
    taken: Vec<(Refit, f64)>,
    /// Where it began, without any.
    first: Stand,
    /// Where it was after each round.
    visited: Vec<Stand>,
    /// Whether effects were taken that left more than none does.
    given_up: bool,
    /// Candidates of the first round that were not taken, best first, alike.
    others: Vec<(Refit, f64)>,
    rounds: Vec<Round>,
    /// Refits made.
    refits: usize,
}

/// A model under the levels of its own errors, predicted over a part of the horizon; `sensors` are the
/// levels of the readings.
fn tuned(case: &Case, at: &Fit, part: f64, settings: &Settings, sensors: &[(f64, f64)]) -> Stand {
    let mut case = case.clone();
    follow_slowly(&mut case, part);
    let mut fitted = at.clone();
    fitted.hypothesis.run = fitted.hypothesis.run.plain();
    let mut directions = directions(&case, &fitted);
    for _ in 0..settings.budget.turns {
        fitted = fit(
            &case,
            &directions,
            &fitted.hypothesis,
            fitted.point.clone(),
            Effort::full(settings.budget.steps),
        );
        (fitted, directions) = renewed(&mut case, settings, &fitted, sensors);
    }
    Stand {
        gap: measured(&case, &fitted),
        case,
        directions,
        fit: fitted,
    }
}

/// The nominal structure of a search, tuned to what free runs count, and its gap.
///
/// Predictions over the whole horizon serve that where something large is missing: over a part of it
/// they can be good with parameters that let free runs diverge.
pub(super) fn tuned_within(evidence: &Evidence, settings: &Settings) -> (Fit, Gap) {
    let sensors = readings(&evidence.case);
    let stand = tuned(&evidence.case, &evidence.base, WHOLE, settings, &sensors);
    (stand.fit, stand.gap)
}

/// What a round asks for.
struct Asked<'a> {
    /// Which terms.
    only: &'a dyn Fn(&Term) -> bool,
    /// Where else the parameters of a term start.
    starts: &'a (dyn Fn(&Term) -> Vec<Vec<f64>> + Sync),
    /// Whether a signal shows them by itself.
    shown: bool,
}

/// One round: the candidates on top of what is taken, best first, what became of each, and the one
/// that is taken with where it leads: the best that pays, or one that the score does not tell from it
/// and that free runs prefer.
fn round(
    now: &Stand,
    settings: &Settings,
    sensors: &[(f64, f64)],
    asked: &Asked<'_>,
) -> (Vec<Refit>, Round, Option<(usize, Stand)>) {
    let mut list = listed(&now.case, &now.directions, settings, &now.fit);
    list.retain(|(term, _)| (asked.only)(term));
    list.par_iter_mut()
        .for_each(|(term, starts)| starts.extend((asked.starts)(term)));
    let many = Settings {
        budget: Budget {
            refits: settings.budget.partial_refits,
            starts_beside_joint: true,
            ..settings.budget.clone()
        },
        ..settings.clone()
    };
    let (best, slopes) = screen(&now.case, &now.directions, &now.fit, &list, &many.budget);
    let mut tried = refit(
        &now.case,
        &now.directions,
        &many,
        &now.fit,
        (&best, &slopes),
        list.len(),
    );
    let held_out = judge(&now.case, &now.fit, &mut tried, list.len());
    let gaps: Vec<Gap> = tried
        .par_iter()
        .map(|r| measured(&now.case, &r.fit))
        .collect();
    let mut candidates: Vec<Tried> = Vec::with_capacity(tried.len());
    let mut passing: Vec<(usize, Stand)> = Vec::new();
    for (i, r) in tried.iter().enumerate() {
        // Of two that the score does not tell apart, the one that free runs prefer.
        let alike = |first: usize| r.score > tried[first].score - settings.criteria.replaces();
        let first = passing.first().map(|(i, _)| *i);
        let refused = if first.is_some_and(|first| !alike(first)) {
            Some(LATER.to_owned())
        } else {
            let judged = (&r.term, r.score, held_out[i]);
            let rule = refused(&settings.criteria, &now.gap, judged, &gaps[i], asked.shown)
                .map_or_else(|| led_to(settings, now, r, sensors), Err);
            match rule {
                Ok(next) => {
                    passing.push((i, next));
                    None
                }
                Err(rule) => Some(rule.to_owned()),
            }
        };
        candidates.push(Tried {
            label: r.term.label(),
            score: r.score,
            held_out: held_out[i],
            gap: gaps[i].total,
            refused,
        });
    }
    let taken = passing
        .into_iter()
        .min_by(|(_, a), (_, b)| a.gap.total.total_cmp(&b.gap.total));
    if let Some((taken, _)) = &taken {
        for (i, c) in candidates.iter_mut().enumerate() {
            if i != *taken && c.refused.is_none() {
                c.refused = Some(LATER.to_owned());
            }
        }
    }
    let beside = now.fit.hypothesis.terms.iter().map(Term::label);
    let round = Round {
        beside: beside.collect(),
        candidates,
        dropped: Vec::new(),
        exchange: false,
    };
    (tried, round, taken)
}

/// What is said of candidates behind the one taken.
const LATER: &str = "another one came first";

/// What is said of a candidate beside which another effect is hardly there.
const SMALLER: &str = "beside it an effect is smaller than its deviation";

/// Score of a candidate as a rival of the others. One beside which an effect is hardly there, its own among them, is
/// the others under another name: a play without a gap is a spring.
fn as_rival(candidate: &Tried) -> f64 {
    match candidate.refused.as_deref() {
        Some(SMALLER) => f64::NEG_INFINITY,
        _ => candidate.score,
    }
}

/// The refits of a round of which one may be taken, each with its probability.
fn with_odds(tried: Vec<Refit>, round: &Round, taken: Option<usize>) -> Vec<(Refit, f64)> {
    let scores: Vec<f64> = round.candidates.iter().map(as_rival).collect();
    tried
        .into_iter()
        .zip(within_round(&scores, taken))
        .collect()
}

/// Where a candidate leads under the levels that it leaves.
fn led_to(
    settings: &Settings,
    now: &Stand,
    tried: &Refit,
    sensors: &[(f64, f64)],
) -> Result<Stand, &'static str> {
    let mut case = now.case.clone();
    let (fit, directions) = renewed(&mut case, settings, &tried.fit, sensors);
    let gap = measured(&case, &fit);
    if grows(&settings.criteria, &now.gap, &gap) {
        return Err("free runs grow under the levels it leaves");
    }
    if at_an_end(&case, &fit) {
        return Err("its amplitude ends at the end of its range");
    }
    if overdamped(&case, &fit) {
        return Err("its damping ends at the end of its range");
    }
    if let Some(short) = as_short(&now.case, &now.directions, settings, &now.fit, &tried.fit) {
        let parameters = tried.term.effect.info().parameters.len();
        let gained = gained(&now.case, &sums_of(&now.case, &short), &tried.fit);
        if gained.score(parameters, 1) < settings.criteria.replaces() {
            return Err("shorter substeps do as well");
        }
    }
    let own = sizes(&case, &settings.criteria, &fit);
    if own.iter().any(|s| *s <= 1.0) {
        return Err(SMALLER);
    }
    Ok(Stand {
        case,
        directions,
        fit,
        gap,
    })
}

/// Drops the effects that are superfluous, one after the other: beside the others
/// they gain no more than chance, or free runs are better without beyond their scatter. Those that
/// signals show stay. Their places, in the order of dropping.
fn pruned(
    now: &mut Stand,
    settings: &Settings,
    sensors: &[(f64, f64)],
    stays: &(dyn Fn(&str) -> bool + Sync),
) -> Vec<usize> {
    let criteria = &settings.criteria;
    let mut dropped = Vec::new();
    loop {
        let terms = &now.fit.hypothesis.terms;
        if terms.len() < 2 {
            return dropped;
        }
        // The last one too: beside it the others may have come out of a local optimum.
        let superfluous = (0..terms.len())
            .into_par_iter()
            .filter(|&i| !stays(&terms[i].label()))
            .map(|i| {
                let less = without(&now.case, &now.directions, settings, &now.fit, i);
                let parameters = terms[i].effect.info().parameters.len();
                let gained = gained(&now.case, &sums_of(&now.case, &less), &now.fit);
                let gap = measured(&now.case, &less);
                (i, gained.score(parameters, 1), gap, less)
            })
            .filter(|(_, score, gap, _)| {
                *score < criteria.replaces() || grows(criteria, gap, &now.gap)
            })
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((i, _, _, less)) = superfluous else {
            return dropped;
        };
        (now.fit, now.directions) = renewed(&mut now.case, settings, &less, sensors);
        now.gap = measured(&now.case, &now.fit);
        dropped.push(i);
    }
}

/// How effects are taken.
#[derive(Debug, Clone, Copy)]
struct Way {
    /// Part of the horizon that is predicted.
    part: f64,
    /// Whether two are taken at once where none pays alone.
    pairs: bool,
}

/// Takes the effects that pay in predictions over a part of the horizon, and over another one where the
/// first explains less than most of the gap; the search that leaves the smaller gap.
///
/// Over a short part friction and timing are found where motion sticks and slips, over all of it play
/// and what acts slowly.
fn over(first: f64, then: Option<f64>, evidence: &Evidence, settings: &Settings) -> Partial {
    let nominal = tuned_within(evidence, settings);
    let singly = |part| Way { part, pairs: false };
    let mut found = partial(evidence, singly(first), &nominal, settings);
    let noise = settings.criteria.near * evidence.floor;
    let left = |found: &Partial| found.grown.now.gap.total;
    let explained = share(found.grown.before.total, left(&found), evidence.floor);
    let little = left(&found) >= noise && explained < settings.criteria.majority;
    let little = little || found.grown.given_up;
    let further = then.filter(|_| little && !settings.watch.stopped());
    if let Some(part) = further {
        found = less_left(
            found,
            partial(evidence, singly(part), &nominal, settings),
            settings,
        );
    }
    let nothing = found.grown.taken.is_empty() && left(&found) >= noise;
    if further.is_some() && nothing && !settings.watch.stopped() {
        let way = Way {
            part: first,
            pairs: true,
        };
        found = less_left(found, partial(evidence, way, &nominal, settings), settings);
    }
    found
}

/// Of two searches the one that leaves the smaller gap, with the rounds of both.
fn less_left(mut found: Partial, mut other: Partial, settings: &Settings) -> Partial {
    let left = |found: &Partial| found.grown.now.gap.total;
    // A window in which one joint drifts away is no reason to give up effects.
    let (own, its) = (&found.grown.now.gap, &other.grown.now.gap);
    let gives_up = other.grown.taken.is_empty() && !found.grown.taken.is_empty();
    let better = !gives_up || grows(&settings.criteria, its, own);
    if left(&other) < left(&found) && better {
        std::mem::swap(&mut found, &mut other);
    }
    found.grown.refits += other.grown.refits;
    // What was tried on the other way comes first.
    other.grown.rounds.append(&mut found.grown.rounds);
    found.grown.rounds = other.grown.rounds;
    found
}

/// Tunes the nominal structure of a search that explains nothing and takes the effects that pay in
/// predictions over a part of the horizon; `nominal` is that structure at its best and its gap, as far
/// as it is known.
fn partial(evidence: &Evidence, way: Way, nominal: &(Fit, Gap), settings: &Settings) -> Partial {
    let sensors = &readings(&evidence.case);
    let mut grown = grown(evidence, way, nominal, settings, sensors);
    let sought = Sought {
        stand: grown.now.clone(),
        sensors: sensors.clone(),
    };
    if !grown.taken.is_empty() {
        let before = grown.before.total;
        grown.now = ended(
            &evidence.case,
            way.part,
            (grown.now, before),
            settings,
            sensors,
        );
        // What leaves more than nothing does explains nothing.
        if grown.now.gap.total >= grown.before.total {
            grown.others.splice(0..0, grown.taken.drain(..));
            grown.now = grown.first.clone();
            grown.given_up = true;
        }
    }
    in_shares(grown, sought, evidence.floor, settings)
}

/// Takes effects, one after the other, until none pays.
fn grown(
    evidence: &Evidence,
    Way { part, pairs }: Way,
    nominal: &(Fit, Gap),
    settings: &Settings,
    sensors: &[(f64, f64)],
) -> Grown {
    let mut now = tuned(&evidence.case, &evidence.base, part, settings, sensors);
    let (mut base, mut before) = nominal.clone();
    if now.gap.total < before.total {
        (base, before) = (now.fit.clone(), now.gap.clone());
    }
    let first = now.clone();
    let shown = shown(&now.case, &base.point.theta, settings);
    let (mut taken, mut rounds, mut visited) = (Vec::new(), Vec::new(), Vec::new());
    let (mut refits, mut others) = (0, None);
    let everything = Asked {
        only: &|_| true,
        starts: &|term| last_of(&evidence.rivals, term),
        shown: false,
    };
    for _ in 0..settings.budget.rounds {
        let lags = take_shown(&mut now, &mut taken, &shown, settings, sensors);
        refits += lags.len();
        rounds.extend(lags);
        if taken.len() >= settings.budget.most_in_part || settings.watch.stopped() {
            break;
        }
        let beside: Vec<String> = taken.iter().map(|(r, _)| r.term.label()).collect();
        settings.watch.step(&match beside.as_slice() {
            [] => "shares of the gap: the first effect".to_owned(),
            _ => format!("shares of the gap: beside {}", beside.join(", ")),
        });
        let both = pairs && taken.is_empty();
        let step = step(&now, settings, sensors, &everything, both);
        let tried = step.rounds.iter().map(|r| r.candidates.len());
        refits += tried.sum::<usize>();
        rounds.extend(step.rounds);
        others.get_or_insert(step.others);
        let Some((own, next)) = step.taken else {
            break;
        };
        let before = now.gap.total;
        now = next;
        if now.gap.total >= settings.criteria.near * evidence.floor {
            let last = now.fit.hypothesis.terms.len() - 1;
            now = begun_again(now, last, part, settings, sensors);
        }
        taken.extend(own);
        let shows = |label: &str| stays(&shown, label);
        let dropped = pruned(&mut now, settings, sensors, &shows);
        let dropped = dropped
            .into_iter()
            .map(|place| taken.remove(place).0.term.label());
        if let Some(round) = rounds.last_mut() {
            round.dropped.extend(dropped);
        }
        if taken.len() > 1 && !settings.watch.stopped() {
            rounds.extend(exchange(&mut now, &mut taken, settings, sensors, &shown));
        }
        visited.push(now.clone());
        // One effect went in circles with another.
        let circles = rounds
            .last()
            .is_some_and(|r| !r.dropped.is_empty() && !r.exchange);
        if circles && now.gap.total >= before {
            break;
        }
    }
    Grown {
        base,
        before,
        now,
        taken,
        first,
        visited,
        given_up: false,
        others: others.unwrap_or_default(),
        rounds,
        refits,
    }
}

/// Levels of the readings, the least there can be.
fn readings(case: &Case) -> Vec<(f64, f64)> {
    case.noise.iter().map(|n| (n.q, n.v)).collect()
}

/// Levels that a fit leaves, and the fit under them with the directions they determine.
fn renewed(case: &mut Case, settings: &Settings, at: &Fit, sensors: &[(f64, f64)]) -> (Fit, Basis) {
    settle(case, at, sensors);
    let directions = directions(case, at);
    let next = fit(
        case,
        &directions,
        &at.hypothesis,
        at.point.clone(),
        Effort::full(settings.budget.touch),
    );
    (next, directions)
}

/// Adds to the evidence of a search that explains nothing what the library explains in part, by
/// predictions over a part of the horizon, and over another one where that explains little.
pub(super) fn add_part(
    evidence: Evidence,
    settings: &Settings,
    first: f64,
    then: Option<f64>,
) -> Evidence {
    let found = over(first, then, &evidence, settings);
    with_effects(evidence, found, &settings.criteria)
}
