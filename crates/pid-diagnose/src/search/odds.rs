//! Odds among the candidates of a search.

use super::forward::Lagging;
use super::refit::Refit;
use crate::criteria::Criteria;
use crate::diagnosis::Ranked;
use crate::effect::Term;

fn line(term: &Term, score: f64, probability: f64) -> Ranked {
    Ranked {
        effect: term.effect.info().id.to_owned(),
        joint: term.shown_joint(),
        score,
        probability,
    }
}

/// The ranking of forward selection: candidates of the first round among each other and the nominal
/// structure, a second effect that was accepted on top of the first with certainty. Neighbouring
/// innovations of a misfit are not independent: the odds are tempered.
pub(super) fn tempered(
    criteria: &Criteria,
    ranking: &[Refit],
    accepted: &[Term],
    lagging: Option<&Lagging>,
    misfit: f64,
) -> Vec<Ranked> {
    let scale = misfit.max(1.0);
    let temper = |score: f64| score / (2.0 * (criteria.shared + criteria.shared * (scale - 1.0)));
    // A second effect was compared with others on top of the first, not with the first.
    let second = accepted.get(1).map(Term::label);
    let on_top = |r: &Refit| second.as_deref() == Some(r.term.label().as_str());
    let best = ranking
        .iter()
        .filter(|r| !on_top(r))
        .map(|r| r.score)
        .fold(0.0, f64::max);
    let weights: Vec<f64> = ranking
        .iter()
        .map(|r| {
            if on_top(r) {
                0.0
            } else {
                temper(r.score - best).exp()
            }
        })
        .collect();
    let sum: f64 = weights.iter().sum::<f64>() + temper(-best).exp();
    let lag = lagging.map(|lag| line(&lag.term, lag.ratio * lag.ratio, 1.0));
    let candidates = ranking.iter().zip(&weights).map(|(r, w)| {
        let probability = if on_top(r) { 1.0 } else { w / sum };
        line(&r.term, r.score, probability)
    });
    lag.into_iter().chain(candidates).collect()
}

/// The ranking of effects that explain a part, of which the first `taken` are taken: those of the
/// first round among each other, the later ones in their own.
pub(super) fn plain(ranking: &[Refit], taken: usize) -> Vec<Ranked> {
    let own = |i: usize| i == 0 || i >= taken;
    // A candidate that scored more but did not pay on motions never fitted counts as an equal, not as better.
    let most = if taken > 0 {
        ranking[0].score
    } else {
        f64::INFINITY
    };
    let score = |i: usize| ranking[i].score.min(most);
    let best = (0..ranking.len())
        .filter(|&i| own(i))
        .map(score)
        .fold(0.0, f64::max);
    let weight = |score: f64| (0.5 * (score - best)).exp();
    let sum: f64 = weight(0.0)
        + (0..ranking.len())
            .filter(|&i| own(i))
            .map(|i| weight(score(i)))
            .sum::<f64>();
    ranking
        .iter()
        .enumerate()
        .map(|(i, r)| {
            let probability = if own(i) {
                weight(score(i)) / sum
            } else {
                1.0 - weight(0.0).min(1.0)
            };
            line(&r.term, r.score, probability)
        })
        .collect()
}
