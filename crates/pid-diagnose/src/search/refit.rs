//! Full refits of the candidates that screening found promising.

use rayon::prelude::*;

use super::candidates::END;
use super::measure::Reached;
use super::settings::Settings;
use crate::case::Case;
use crate::criteria::Stage;
use crate::effect::Term;
use crate::fit::{Basis, Effort, Fit, Point, Slopes, fit, ranges};
use crate::screen::Candidate;

/// A refitted candidate.
#[derive(Debug, Clone)]
pub(super) struct Refit {
    pub(super) term: Term,
    pub(super) fit: Fit,
    pub(super) score: f64,
}

/// Refits the most promising candidates, those that fall behind for a few steps only; best score first.
pub(super) fn refit(
    case: &Case,
    basis: &Basis,
    settings: &Settings,
    current: &Fit,
    (best, slopes): (&[Candidate], &Slopes),
    tried: usize,
) -> Vec<Refit> {
    let mut out: Vec<Refit> = Vec::new();
    let budget = &settings.budget;
    for (stage, &own) in budget.stages.iter().enumerate() {
        let Stage {
            steps,
            candidates,
            exact,
        } = own;
        // Everything to its end, where the shortcut is itself what is measured.
        let (many, exact) = if settings.refit_all {
            (usize::MAX, exact || stage + 1 == budget.stages.len())
        } else {
            (candidates, exact)
        };
        let effort = Effort {
            steps: steps.min(budget.steps),
            slopes: Some(slopes),
            exact,
            curvature: true,
        };
        if stage == 0 {
            let many = match settings.refit_all {
                true => usize::MAX,
                false => budget.refits,
            };
            out = best
                .par_iter()
                .take(many)
                .map(|c| started(case, basis, current, c, effort))
                .collect();
        } else {
            let leading = out.first().map_or(0.0, |r| gain(current, r));
            out.par_iter_mut().take(many).for_each(|r| {
                if settings.refit_all || gain(current, r) >= budget.hopeless * leading {
                    r.fit = fit(case, basis, &r.fit.hypothesis, r.fit.point.clone(), effort);
                }
            });
        }
        out.sort_by(|a, b| a.fit.train.evidence().total_cmp(&b.fit.train.evidence()));
    }
    rest(case, basis, current, &mut out, settings);
    // Impacts and sticking make for slow ends; where much is left the leader gets derivatives of
    // its own in every step.
    if let Some(leader) = out.first_mut()
        && leader.fit.train.total() > settings.criteria.calm * leader.fit.train.number()
        && gain(current, leader) > 0.0
    {
        let effort = Effort::full(budget.steps);
        let (hypothesis, point) = (&leader.fit.hypothesis, leader.fit.point.clone());
        leader.fit = fit(case, basis, hypothesis, point, effort);
        if let Some(other) = back_from_the_end(case, basis, &leader.fit, effort) {
            leader.fit = other;
        }
    }
    let Some(least) = out
        .iter()
        .map(|r| r.fit.train.objective())
        .min_by(f64::total_cmp)
    else {
        return out;
    };
    let number = current.train.number();
    let scale = (least / number).max(1.0);
    let over = Reached::new(case, current);
    for r in &mut out {
        r.score = score(&Reached::new(case, &r.fit), &over, tried, (scale, number));
    }
    out.sort_by(|a, b| b.score.total_cmp(&a.score));
    out
}

/// Candidates at most that go on to their optimum: more than two that are one map on a robot are rare.
const CONTENDERS: usize = 3;
/// Share of the best gain that the others may lack then. 0.01: wide; a force and a feed-forward of gravity that are one
/// map, in seed 501001 of `pid-studies servo --unstated`, were 1e-6 apart.
const CLOSE: f64 = 0.01;

/// Brings the first candidates to their optima where several gain nearly the same: where a fit stopped on its way
/// would decide between them.
fn rest(case: &Case, basis: &Basis, current: &Fit, all: &mut [Refit], settings: &Settings) {
    let leading = all.first().map_or(0.0, |r| gain(current, r));
    let close = |r: &Refit| gain(current, r) > (1.0 - CLOSE) * leading;
    let number = all.iter().take(CONTENDERS).take_while(|r| close(r)).count();
    if number < 2 || leading < settings.criteria.margin() {
        return;
    }
    all[..number].par_iter_mut().for_each(|r| {
        if let Some(rested) = r.fit.rested(case, basis, settings.budget.steps) {
            r.fit = rested;
        }
    });
    all.sort_by(|a, b| a.fit.train.evidence().total_cmp(&b.fit.train.evidence()));
}

/// The first steps of a candidate beside the effects of a fit.
fn started(
    case: &Case,
    basis: &Basis,
    current: &Fit,
    candidate: &Candidate,
    effort: Effort<'_>,
) -> Refit {
    let mut hypothesis = current.hypothesis.clone();
    hypothesis.terms.push(candidate.term.clone());
    let mut e = current.point.e.clone();
    e.extend_from_slice(&candidate.start);
    let theta = candidate.theta.iter().map(|t| t.clamp(-1.0, 1.0));
    let start = Point {
        theta: theta.collect(),
        e,
    };
    Refit {
        term: candidate.term.clone(),
        fit: fit(case, basis, &hypothesis, start, effort),
        score: 0.0,
    }
}

/// The fit from a point where the parameters of the last effect that ended at the largest value of
/// their range are zero, if it is a better one. Where two parameters stand in for each other, such
/// as the dampers of a gear, a fit can stop at the end of one.
fn back_from_the_end(case: &Case, basis: &Basis, at: &Fit, effort: Effort<'_>) -> Option<Fit> {
    let term = at.hypothesis.terms.last()?;
    let first = at.point.e.len() - term.effect.info().parameters.len();
    let ranges = ranges(case, &at.hypothesis);
    let mut start = at.point.clone();
    let mut moved = false;
    for (x, &(low, high)) in start.e.iter_mut().zip(&ranges).skip(first) {
        if low == 0.0 && *x > high - END * (high - low) {
            *x = 0.0;
            moved = true;
        }
    }
    let other = moved.then(|| fit(case, basis, &at.hypothesis, start, effort))?;
    (other.train.objective() < at.train.objective()).then_some(other)
}

/// Gain of a fit (see [`Reached::gain`]) of one of `tried` candidates, less the penalty for their number.
pub(super) fn score(
    fit: &Reached,
    over: &Reached,
    tried: usize,
    (scale, number): (f64, f64),
) -> f64 {
    fit.gain(over, scale, number) - 2.0 * (tried as f64).ln()
}

/// What a refit gains on the train records.
fn gain(current: &Fit, refit: &Refit) -> f64 {
    current.train.evidence() - refit.fit.train.evidence()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, named, waist};
    use crate::fit::basis;
    use crate::hypothesis::Hypothesis;
    use crate::screen::{candidates, screen};

    fn nothing() -> Point {
        Point {
            theta: vec![0.0; SIZE],
            e: Vec::new(),
        }
    }

    /// The one effect of a hypothesis, searched for on records that have it.
    fn found(case: &Case, wanted: &Hypothesis) -> Fit {
        let basis = basis(case);
        let none = Hypothesis::default();
        let base = fit(case, &basis, &none, nothing(), Effort::full(14));
        let settings = Settings::default();
        let library = [wanted.terms[0].effect.clone()];
        let list = candidates(case, &library, &base.hypothesis);
        let (best, slopes) = screen(case, &basis, &base, &list, &settings.budget);
        let mut refits = refit(case, &basis, &settings, &base, (&best, &slopes), 1);
        refits.swap_remove(0).fit
    }

    #[test]
    fn a_gap_is_reached_from_afar_where_nothing_but_inertia_closes_it() {
        let play = named(&["backlash"]);
        for gap in [0.03, 0.1, 0.13] {
            // The grease damps throughout.
            let case = waist(&play, &[gap, 1e-3, 0.0, 3e-4], 6.0);
            let own = found(&case, &play).point.e[0];
            assert!((own / gap - 1.0).abs() < 0.01, "{own} for {gap}");
        }
    }

    #[test]
    fn a_damper_at_the_end_of_its_range_is_tried_without_it() {
        let play = named(&["backlash"]);
        let truth = [0.03, 1e-3, 0.0, 3e-4];
        let case = waist(&play, &truth, 6.0);
        let basis = basis(&case);
        let mut at = nothing();
        at.e = truth.to_vec();
        let right = fit(&case, &basis, &play, at.clone(), Effort::full(0));
        assert!(back_from_the_end(&case, &basis, &right, Effort::full(10)).is_none());
        at.e[2] = 0.03;
        let end = fit(&case, &basis, &play, at, Effort::full(0));
        let back = back_from_the_end(&case, &basis, &end, Effort::full(10)).expect("a better fit");
        assert!(back.train.objective() < end.train.objective());
        assert!(back.point.e[2] < 0.01, "{:?}", back.point.e);
    }
}
