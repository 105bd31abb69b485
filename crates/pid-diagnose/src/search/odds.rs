//! Odds among the candidates of a search.

use super::lagging::Lagging;
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

/// Probabilities of the candidates of one round among each other and what was there before them, by
/// their scores. A candidate that scored more than the one taken, but was refused, counts as an
/// equal, not as better; one without a score (−∞) is none.
pub(super) fn within_round(scores: &[f64], taken: Option<usize>) -> Vec<f64> {
    let most = taken.map_or(f64::INFINITY, |i| scores[i]);
    let best = scores.iter().map(|s| s.min(most)).fold(0.0, f64::max);
    let weights: Vec<f64> = scores
        .iter()
        .map(|s| (0.5 * (s.min(most) - best)).exp())
        .collect();
    let sum = weights.iter().sum::<f64>() + (-0.5 * best).exp();
    weights.iter().map(|w| w / sum).collect()
}

/// The ranking of refits with their probabilities.
pub(super) fn plain(refits: &[(Refit, f64)]) -> Vec<Ranked> {
    refits
        .iter()
        .map(|(r, probability)| line(&r.term, r.score, *probability))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::within_round;

    #[test]
    fn a_refused_candidate_counts_as_an_equal_of_the_one_taken() {
        let [refused, taken, faint] =
            within_round(&[300.0, 100.0, 100.0 - 2.0 * 3f64.ln()], Some(1))[..]
        else {
            panic!("three");
        };
        assert!((refused - 3.0 / 7.0).abs() < 1e-12 && (taken - 3.0 / 7.0).abs() < 1e-12);
        assert!((faint - 1.0 / 7.0).abs() < 1e-12);
        let none = within_round(&[f64::NEG_INFINITY, 100.0], Some(1));
        assert!(none[0] == 0.0 && none[1] > 1.0 - 1e-12, "{none:?}");
        // Nothing gains: what was there before is as likely as each.
        assert!((within_round(&[0.0], None)[0] - 0.5).abs() < 1e-12);
    }
}
