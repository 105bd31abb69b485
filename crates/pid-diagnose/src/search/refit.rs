//! Full refits of the candidates that screening found promising.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::measure::Reached;
use super::settings::Settings;
use crate::case::Case;
use crate::criteria::Stage;
use crate::effect::Term;
use crate::fit::{Basis, Effort, Fit, Point, fit};
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
    (best, slopes): (&[Candidate], &DMatrix<f64>),
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
    // Impacts and sticking make for slow ends; where much is left the leader gets derivatives of
    // its own in every step.
    if let Some(leader) = out.first_mut()
        && leader.fit.train.total() > settings.criteria.calm * leader.fit.train.number()
        && gain(current, leader) > 0.0
    {
        leader.fit = fit(
            case,
            basis,
            &leader.fit.hypothesis,
            leader.fit.point.clone(),
            Effort::full(budget.steps),
        );
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
