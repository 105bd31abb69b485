//! The list of effects that fast predictions find, to begin with.
//!
//! Slow predictions of motion that sticks and slips are rough in the parameters of friction: a search
//! by them alone stops early. Predictions from sample to sample are smooth there, but they do not say
//! what free runs need. So a list is grown by fast predictions, each effect by the score of forward
//! selection. The whole list is fitted again to slow predictions. There each of its effects must pay
//! beside the others by the rules of every round (see [`refused`]).

use rayon::prelude::*;

use super::judge::{gained, grows, sums_of};
use super::{Stand, refused, renewed, tuned};
use crate::case::Case;
use crate::criteria::Budget;
use crate::diagnosis::{Round, Tried};
use crate::fit::{Effort, Fit, fit};
use crate::gap::Gap;
use crate::hypothesis::Run;
use crate::noise;
use crate::screen::screen;
use crate::search::candidates::{directions, listed, overdamped};
use crate::search::evidence::Evidence;
use crate::search::measure::{Reached, measured, noise_scale};
use crate::search::refit::{Refit, refit};
use crate::search::settings::Settings;
use crate::search::shares::without;

/// What a search begins with.
pub(super) struct Begun {
    pub(super) stand: Stand,
    /// The effects of its fit, in their order.
    pub(super) taken: Vec<(Refit, f64)>,
    pub(super) round: Round,
}

/// The most likely of the fits that forward selection made, in fast predictions.
fn most_likely(evidence: &Evidence) -> &Fit {
    let all = std::iter::once(&evidence.fit).chain(&evidence.rivals);
    all.min_by(|a, b| a.train.evidence().total_cmp(&b.train.evidence()))
        .expect("one fit at least")
}

/// Grows the list of the most likely fit by fast predictions, while they gain beyond the margin on the
/// records fitted and on those never fitted.
fn grown(evidence: &Evidence, settings: &Settings) -> Fit {
    let mut case = evidence.case.clone();
    let mut current = most_likely(evidence).clone();
    let few = Settings {
        budget: Budget {
            refits: settings.budget.sketched,
            ..settings.budget.clone()
        },
        ..settings.clone()
    };
    while current.hypothesis.terms.len() < settings.budget.most_in_part && !settings.watch.stopped()
    {
        let basis = directions(&case, &current);
        noise::settle(&mut case, &current);
        current = fit(
            &case,
            &basis,
            &current.hypothesis,
            current.point.clone(),
            Effort::full(settings.budget.touch),
        );
        let list = listed(&case, &basis, settings, &current);
        let (best, slopes) = screen(&case, &basis, &current, &list, &settings.budget);
        let tried = refit(&case, &basis, &few, &current, (&best, &slopes), list.len());
        eprintln!("beside {:?} misfit {:?}: {:?}", current.hypothesis.terms.iter().map(|t| t.label()).collect::<Vec<_>>(), current.train.chi.iter().zip(&current.train.count).map(|(c,n)| c[0]/n[0]).collect::<Vec<_>>(), tried.iter().map(|t| (t.term.label(), t.score)).collect::<Vec<_>>());
        eprintln!("  screen {:?}", best.iter().take(12).map(|t| (t.term.label(), t.objective)).collect::<Vec<_>>());
        let pays = |r: &Refit| {
            let own = Reached::new(&case, &r.fit);
            r.score > settings.criteria.margin
                && own.held_out(&Reached::new(&case, &current)) > 0.0
                && !overdamped(&case, &r.fit)
        };
        match tried.into_iter().next().filter(pays) {
            Some(first) => current = exchanged(&case, &few, first.fit),
            None => break,
        }
    }
    current
}

/// Gives the place of every effect but the last to one that it is confused with at its joint, where
/// that is more likely beside the others.
fn exchanged(case: &Case, settings: &Settings, mut current: Fit) -> Fit {
    // One that is exchanged goes to the end.
    let mut place = 0;
    for _ in 1..current.hypothesis.terms.len() {
        let basis = directions(case, &current);
        let old = current.hypothesis.terms[place].clone();
        let less = without(case, &basis, settings, &current, place);
        let mut list = listed(case, &basis, settings, &less);
        list.retain(|(term, _)| term.joint == old.joint && old.is_confused_with(term));
        let (best, slopes) = screen(case, &basis, &less, &list, &settings.budget);
        let tried = refit(case, &basis, settings, &less, (&best, &slopes), list.len());
        let (scale, number) = (noise_scale(&current), current.train.number());
        let present = Reached::new(case, &current);
        let better = |r: &Refit| {
            let gain = Reached::new(case, &r.fit).gain(&present, scale, number);
            gain > settings.criteria.replaces()
        };
        match tried.into_iter().next().filter(better) {
            Some(other) => current = other.fit,
            None => place += 1,
        }
    }
    current
}

/// What an effect of a list does beside the others.
struct Beside {
    place: usize,
    score: f64,
    held_out: f64,
    refused: Option<&'static str>,
    /// The fit without it.
    less: Fit,
}

/// Judges every effect of a list beside the others.
fn beside(now: &Stand, settings: &Settings) -> Vec<Beside> {
    let terms = &now.fit.hypothesis.terms;
    let count = listed(&now.case, &now.directions, settings, &now.fit).len() + terms.len();
    (0..terms.len())
        .into_par_iter()
        .map(|place| {
            let less = without(&now.case, &now.directions, settings, &now.fit, place);
            let gained = gained(&now.case, &sums_of(&now.case, &less), &now.fit);
            let parameters = terms[place].effect.info().parameters.len();
            let score = gained.score(parameters, count);
            let gap = measured(&now.case, &less);
            let judged = (&terms[place], score, gained.test);
            Beside {
                place,
                score,
                held_out: gained.test,
                refused: refused(settings, &gap, judged, &now.gap, false),
                less,
            }
        })
        .collect()
}

/// Begins with the list that fast predictions find, less the effects that do not pay in slow
/// predictions and free runs. `None` where none pays, or free runs are no better than those of the
/// nominal structure with the gap `before`.
pub(super) fn begin(
    evidence: &Evidence,
    settings: &Settings,
    sensors: &[(f64, f64)],
    before: &Gap,
) -> Option<Begun> {
    settings.watch.step("effects by fast predictions");
    let mut list = grown(evidence, settings);
    eprintln!(
        "grown {:?} {:?}",
        list.hypothesis
            .terms
            .iter()
            .map(|t| t.label())
            .collect::<Vec<_>>(),
        list.point.e
    );
    list.hypothesis.run = Run::default();
    if list.hypothesis.terms.is_empty() {
        return None;
    }
    let mut stand = tuned(&evidence.case, &list, settings, sensors);
    let mut dropped = Vec::new();
    let kept = loop {
        let judged = beside(&stand, settings);
        eprintln!(
            "stand {:?} e {:?} joints {:?}",
            stand.gap.total, stand.fit.point.e, stand.gap.joints
        );
        for b in &judged {
            eprintln!(
                "  {} score {} held {} gap without {} {:?}",
                stand.fit.hypothesis.terms[b.place].label(),
                b.score,
                b.held_out,
                measured(&stand.case, &b.less).total,
                b.refused
            );
        }
        let worst = judged.iter().filter(|b| b.refused.is_some());
        let Some(worst) = worst.min_by(|a, b| a.score.total_cmp(&b.score)) else {
            break judged;
        };
        dropped.push(stand.fit.hypothesis.terms[worst.place].label());
        if stand.fit.hypothesis.terms.len() == 1 {
            return None;
        }
        (stand.fit, stand.directions) = renewed(&mut stand.case, settings, &worst.less, sensors);
        stand.gap = measured(&stand.case, &stand.fit);
    };
    let better = stand.gap.total < before.total && !grows(&settings.criteria, before, &stand.gap);
    better.then(|| begun(stand, kept, dropped))
}

/// With the round that tells of it.
fn begun(stand: Stand, kept: Vec<Beside>, dropped: Vec<String>) -> Begun {
    let terms = &stand.fit.hypothesis.terms;
    let tried = |b: &Beside| Tried {
        label: terms[b.place].label(),
        score: b.score,
        held_out: b.held_out,
        gap: stand.gap.total,
        refused: None,
    };
    let taken = |b: &Beside| {
        let refit = Refit {
            term: terms[b.place].clone(),
            fit: stand.fit.clone(),
            score: b.score,
        };
        (refit, 1.0)
    };
    Begun {
        round: Round {
            beside: Vec::new(),
            candidates: kept.iter().map(tried).collect(),
            dropped,
            exchange: false,
        },
        taken: kept.iter().map(taken).collect(),
        stand,
    }
}
