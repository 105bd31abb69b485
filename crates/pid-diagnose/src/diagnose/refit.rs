//! Full refits of the candidates that screening found promising.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::{Settings, test_value};
use crate::case::Case;
use crate::effect::Term;
use crate::fit::{Basis, Effort, Fit, Point, fit};

/// A refitted candidate.
pub(super) struct Refit {
    pub(super) term: Term,
    pub(super) fit: Fit,
    pub(super) score: f64,
}

/// Steps after which the refits are compared, how many go on, and whether they end at an optimum of their own.
const STAGES: [(usize, usize, bool); 3] = [(3, usize::MAX, false), (5, 4, false), (8, 2, true)];
/// Mean squared innovation of the leader above which it is followed to its end.
const LEFT: f64 = 1.1;
/// Share of the best gain below which a candidate is not followed further.
const HOPELESS: f64 = 0.35;

/// Refits the most promising candidates, those that fall behind for a few steps only; best score first.
pub(super) fn refit(
    case: &Case,
    basis: &Basis,
    settings: &Settings,
    current: &Fit,
    (best, slopes): (&[crate::screen::Candidate], &DMatrix<f64>),
    tried: usize,
) -> Vec<Refit> {
    let mut out: Vec<Refit> = Vec::new();
    for (stage, &(steps, many, exact)) in STAGES.iter().enumerate() {
        // Everything to its end, where the shortcut is itself what is measured.
        let (many, exact) = if settings.refit_all {
            (usize::MAX, exact || stage + 1 == STAGES.len())
        } else {
            (many, exact)
        };
        let effort = Effort {
            steps: steps.min(settings.steps),
            slopes: Some(slopes),
            exact,
            curvature: true,
        };
        if stage == 0 {
            out = best
                .par_iter()
                .take(if settings.refit_all {
                    usize::MAX
                } else {
                    settings.refits
                })
                .map(|c| {
                    let mut hypothesis = current.hypothesis.clone();
                    hypothesis.terms.push(c.term.clone());
                    let mut e = current.point.e.clone();
                    e.extend_from_slice(&c.start);
                    let start = Point {
                        theta: c.theta.iter().map(|t| t.clamp(-1.0, 1.0)).collect(),
                        e,
                    };
                    Refit {
                        term: c.term.clone(),
                        fit: fit(case, basis, &hypothesis, start, effort),
                        score: 0.0,
                    }
                })
                .collect();
        } else {
            let leading = out.first().map_or(0.0, |r| gain(current, r));
            out.par_iter_mut().take(many).for_each(|r| {
                if settings.refit_all || gain(current, r) >= HOPELESS * leading {
                    r.fit = fit(case, basis, &r.fit.hypothesis, r.fit.point.clone(), effort);
                }
            });
        }
        out.sort_by(|a, b| a.fit.train.evidence().total_cmp(&b.fit.train.evidence()));
    }
    // Impacts and sticking make for slow ends; where much is left the leader gets derivatives of its own in every step.
    if let Some(leader) = out.first_mut()
        && leader.fit.train.total() > LEFT * leader.fit.train.number()
        && gain(current, leader) > 0.0
    {
        leader.fit = fit(
            case,
            basis,
            &leader.fit.hypothesis,
            leader.fit.point.clone(),
            Effort::full(settings.steps),
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
    for r in &mut out {
        let k = r.term.effect.info().parameters.len();
        r.score = score((case, current), &r.fit, (k, tried), scale);
    }
    out.sort_by(|a, b| b.score.total_cmp(&a.score));
    out
}

/// Twice the gain in log-likelihood over a fit, by `k` parameters of one of `tried` candidates, less the penalties for both; `scale`: mean
/// square that counts as noise.
pub(super) fn score(
    (case, current): (&Case, &Fit),
    fit: &Fit,
    (k, tried): (usize, usize),
    scale: f64,
) -> f64 {
    // What it gains where it was not fitted counts alike.
    let held_out = test_value(case, current) - test_value(case, fit);
    (current.train.evidence() - fit.train.evidence() + held_out) / scale
        - k as f64 * current.train.number().ln()
        - 2.0 * (tried as f64).ln()
}

fn gain(current: &Fit, refit: &Refit) -> f64 {
    current.train.evidence() - refit.fit.train.evidence()
}
