//! By what an effect is judged where the model's own errors count in place of noise: scores of slow
//! predictions, and free runs from window to window.

use pid_data::Role;

use crate::case::Case;
use crate::criteria::Criteria;
use crate::effect::{Term, Unit};
use crate::fit::{Fit, ranges};
use crate::gap::{FEW_WINDOWS, Gap};
use crate::levels::{errors, left};
use crate::search::candidates::END;
use crate::search::refit::Refit;

/// Sums of squares of every joint and channel under a fit, and numbers of independent samples, on
/// the records of a role.
fn sums(case: &Case, fit: &Fit, role: Role) -> Vec<(f64, f64)> {
    left(&errors(case, fit, role))
        .iter()
        .flatten()
        .filter(|l| l.number > 0.0)
        .map(|l| (l.square.max(1e-300), l.independent))
        .collect()
}

/// [`sums`] on the train records and on the test records.
pub(super) fn sums_of(case: &Case, fit: &Fit) -> [Vec<(f64, f64)>; 2] {
    [Role::Train, Role::Test].map(|role| sums(case, fit, role))
}

/// What a fit gains over another, `Σ N′ ln(S₀/S₁)`, and the number of samples N′ that rests on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gained {
    pub(super) train: f64,
    pub(super) test: f64,
    pub(super) number: f64,
}

impl Gained {
    /// Less ln N′ per parameter and twice the logarithm of the number of candidates.
    pub(super) fn score(&self, parameters: usize, candidates: usize) -> f64 {
        let penalty = parameters as f64 * self.number.max(2.0).ln();
        self.train + self.test - penalty - 2.0 * (candidates.max(1) as f64).ln()
    }
}

/// What a fit gains over one with the sums of squares `old`.
pub(super) fn gained(case: &Case, old: &[Vec<(f64, f64)>; 2], fit: &Fit) -> Gained {
    let mut number = 0.0;
    let mut gains = [0.0; 2];
    for ((new, old), gain) in sums_of(case, fit).iter().zip(old).zip(&mut gains) {
        for ((s1, independent), (s0, _)) in new.iter().zip(old) {
            *gain += independent * (s0 / s1).ln();
            number += independent;
        }
    }
    let [train, test] = gains;
    Gained {
        train,
        test,
        number,
    }
}

/// Scores the refits and orders them, best first; returns what each gains on the records never
/// fitted, in that order.
pub(super) fn judge(
    case: &Case,
    current: &Fit,
    tried: &mut Vec<Refit>,
    candidates: usize,
) -> Vec<f64> {
    let old = sums_of(case, current);
    let mut judged: Vec<(Refit, f64)> = std::mem::take(tried)
        .into_iter()
        .map(|mut r| {
            let gained = gained(case, &old, &r.fit);
            let parameters = r.term.effect.info().parameters.len();
            r.score = gained.score(parameters, candidates);
            (r, gained.test)
        })
        .collect();
    judged.sort_by(|a, b| b.0.score.total_cmp(&a.0.score));
    let (refits, held_out) = judged.into_iter().unzip();
    *tried = refits;
    held_out
}

/// Growth of the squared error that counts where windows are too few for a scatter: that of a gap that grows by 5 %.
const GROWS: f64 = 0.1;

/// Mean decrease of the logarithm of the squared error from window to window, in its standard
/// errors: each window counts alike, however lively its motion.
fn certainty(before: &[f64], after: &[f64]) -> f64 {
    let d: Vec<f64> = before
        .iter()
        .zip(after)
        .filter(|(a, b)| **a > 0.0 && **b > 0.0)
        .map(|(a, b)| (a / b).ln())
        .collect();
    let n = d.len() as f64;
    let mean = d.iter().sum::<f64>() / n.max(1.0);
    if d.len() < FEW_WINDOWS {
        // Too few windows for a scatter: the gap itself decides.
        return match mean {
            mean if mean > 0.0 => f64::INFINITY,
            mean if mean < -GROWS => f64::NEG_INFINITY,
            _ => 0.0,
        };
    }
    let variance = d.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    mean / (variance / n).sqrt().max(1e-300)
}

/// Joints that a term acts on; `None` for the whole robot.
fn acted(term: &Term) -> Option<Vec<usize>> {
    let own = term.shown_joint()? - 1;
    Some(
        std::iter::once(own)
            .chain(term.effect.partner(own))
            .collect(),
    )
}

/// Whether free runs shrink beyond the scatter between windows: all joints together, or the joints
/// that the term acts on while the others do not grow beyond theirs.
pub(super) fn shrinks(criteria: &Criteria, term: &Term, before: &Gap, after: &Gap) -> bool {
    let least = 1.0 - 0.5 * criteria.least_shrink;
    let decreases = |a: &[f64], b: &[f64]| certainty(a, b) > criteria.decrease();
    if after.total < least * before.total && decreases(&before.windows, &after.windows) {
        return true;
    }
    let Some(own) = acted(term) else {
        return false;
    };
    let sum = |gap: &Gap| squares(gap, &own).sqrt();
    let shrink = own
        .iter()
        .all(|&j| decreases(&before.joint_windows[j], &after.joint_windows[j]));
    let others = (0..before.joints.len()).filter(|j| !own.contains(j));
    // Few windows of one joint tell nothing.
    let mut grow = others
        .map(|j| certainty(&before.joint_windows[j], &after.joint_windows[j]))
        .filter(|c| c.is_finite() && *c < -criteria.decrease());
    sum(after) < least * sum(before) && shrink && grow.next().is_none()
}

/// Whether free runs of the joints that a term acts on shrink by it beyond the scatter between windows, and by
/// the least share of the gap that they would have if all joints moved alike.
pub(super) fn shrinks_its_own(criteria: &Criteria, term: &Term, without: &Gap, with: &Gap) -> bool {
    let Some(own) = acted(term) else {
        return false;
    };
    let (before, after) = (squares(without, &own), squares(with, &own));
    let alike = without.joints.len() as f64 / own.len() as f64;
    let certain = own.iter().all(|&j| {
        certainty(&without.joint_windows[j], &with.joint_windows[j]) > criteria.decrease()
    });
    certain && before - after >= (criteria.least_share * alike).min(0.5) * before
}

/// Sum of the squares of the gaps of joints.
fn squares(gap: &Gap, joints: &[usize]) -> f64 {
    let square = |&j: &usize| {
        let (q, v) = gap.joints[j];
        q * q + v.map_or(0.0, |v| v * v)
    };
    joints.iter().map(square).sum()
}

/// Whether free runs grow beyond the scatter between windows.
pub(super) fn grows(criteria: &Criteria, before: &Gap, after: &Gap) -> bool {
    after.total > before.total && certainty(&before.windows, &after.windows) < -criteria.decrease()
}

/// The rule that refuses a term with its score and its gain on records never fitted, if one does;
/// `before` and `after` are the gaps without and with it, `shown` whether a signal shows it by itself.
pub(super) fn refused(
    criteria: &Criteria,
    before: &Gap,
    (term, score, held_out): (&Term, f64, f64),
    after: &Gap,
    shown: bool,
) -> Option<&'static str> {
    // What few windows or another effect that is missing hide: the slow predictions of motions never
    // fitted are beyond doubt.
    let beyond_doubt =
        held_out > criteria.sure_in_part * criteria.margin() && !grows(criteria, before, after);
    let shrunk = shrinks(criteria, term, before, after);
    // Two witnesses that each may err with the probability of chance: rare together.
    let seen = shrunk && after.total < (1.0 - criteria.drift_shrink) * before.total;
    let least = match (shown, seen) {
        (true, _) => 0.0,
        (false, true) => criteria.replaces(),
        (false, false) => criteria.margin(),
    };
    if score <= least {
        Some("its score is that of chance")
    } else if held_out <= 0.0 {
        Some("it does not predict records never fitted better")
    } else if !(shown || shrunk || beyond_doubt) {
        Some("free runs do not shrink beyond their scatter")
    } else {
        None
    }
}

/// Whether an effect with a score that is so much higher takes the place of one that it is confused with: where
/// free runs prefer it, or do not tell the two apart and predictions do.
pub(super) fn takes_the_place(criteria: &Criteria, gain: f64, before: &Gap, after: &Gap) -> bool {
    let clearer = gain > criteria.margin() && !grows(criteria, before, after);
    after.total < before.total || clearer
}

/// Whether an amplitude of the last effect, or its number of periods, ended at the end of its
/// range: the effect then stands for something else.
pub(super) fn at_an_end(case: &Case, fit: &Fit) -> bool {
    let Some(term) = fit.hypothesis.terms.last() else {
        return false;
    };
    let info = term.effect.info();
    let first = fit.point.e.len() - info.parameters.len();
    let ranges = ranges(case, &fit.hypothesis);
    info.parameters.iter().enumerate().any(|(i, parameter)| {
        if !info.amplitudes.contains(&i) && parameter.unit != Unit::Wave {
            return false;
        }
        let (low, high) = ranges[first + i];
        let x = fit.point.e[first + i];
        let edge = END * (high - low);
        // Zero is where the effect is absent, and a share may be all.
        let all = parameter.unit == Unit::Share;
        (x < low + edge && low != 0.0) || (x > high - edge && !all)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::named;

    fn gap(joints: &[[f64; 6]]) -> Gap {
        let mean = |w: &[f64]| w.iter().sum::<f64>() / w.len() as f64;
        let windows: Vec<f64> = (0..6)
            .map(|i| joints.iter().map(|w| w[i]).sum::<f64>() / joints.len() as f64)
            .collect();
        Gap {
            total: mean(&windows).sqrt(),
            joints: joints.iter().map(|w| (mean(w).sqrt(), None)).collect(),
            windows,
            joint_windows: joints.iter().map(|w| w.to_vec()).collect(),
        }
    }

    /// Windows about a square, with a scatter of a few percent.
    fn about(square: f64) -> [f64; 6] {
        [0.97, 1.04, 1.0, 0.95, 1.02, 1.03].map(|x| square * x)
    }

    #[test]
    fn a_joint_that_shakes_does_not_hide_what_an_effect_does_at_its_own() {
        let spring = &named(&["spring"]).terms[0];
        let criteria = Criteria::default();
        let shaking = [1e-4, 9.0, 0.3, 40.0, 2.0, 0.01];
        let other = [9.0, 1e-4, 40.0, 0.3, 0.01, 2.0];
        let before = gap(&[about(1e-2), shaking]);
        assert!(shrinks(
            &criteria,
            spring,
            &before,
            &gap(&[about(2e-3), other])
        ));
        // Its own joint stays as it was.
        assert!(!shrinks(
            &criteria,
            spring,
            &before,
            &gap(&[about(1e-2), other])
        ));
        // The other one grows in every window.
        let worse = shaking.map(|x| 2.0 * x);
        assert!(!shrinks(
            &criteria,
            spring,
            &before,
            &gap(&[about(2e-3), worse])
        ));
    }

    #[test]
    fn an_effect_of_hardly_any_share_counts_where_it_rules_its_own_joint() {
        let spring = &named(&["spring"]).terms[0];
        let criteria = Criteria::default();
        let shaking = about(9.0);
        let without = gap(&[about(1e-2), shaking]);
        let own = |square: f64| {
            let with = gap(&[about(square), shaking]);
            shrinks_its_own(&criteria, spring, &without, &with)
        };
        assert!(own(2e-3));
        // A share of its own joint that would be less than the least one if both moved alike.
        assert!(!own((1.0 - criteria.least_share) * 1e-2));
        let mut scattered = about(2e-3);
        scattered[1] = 2.0;
        assert!(!shrinks_its_own(
            &criteria,
            spring,
            &without,
            &gap(&[scattered, shaking])
        ));
    }

    #[test]
    fn free_runs_and_a_score_that_chance_hardly_gives_are_two_witnesses() {
        let spring = &named(&["spring"]).terms[0];
        let criteria = Criteria::default();
        let before = gap(&[about(1e-2)]);
        let rule = |score: f64, held_out: f64, square: f64| {
            let judged = (spring, score, held_out);
            refused(&criteria, &before, judged, &gap(&[about(square)]), false)
        };
        // Odds of 19 beside half the gap, of 370 beside a tenth of it.
        assert_eq!(rule(6.0, 1.0, 2.5e-3), None);
        assert_eq!(rule(12.0, 1.0, 8e-3), None);
        assert_eq!(rule(6.0, 1.0, 8e-3), Some("its score is that of chance"));
        assert_eq!(rule(5.0, 1.0, 2.5e-3), Some("its score is that of chance"));
        // What predicts nothing better is none, however little free runs leave.
        assert!(rule(6.0, -1.0, 2.5e-3).is_some());
        // A gap that one window rules is no witness.
        let mut one = about(1e-2);
        one[3] = 1.0;
        let ruled = gap(&[one]);
        let judged = (spring, 6.0, 1.0);
        assert!(refused(&criteria, &ruled, judged, &before, false).is_some());
    }

    #[test]
    fn of_two_that_free_runs_do_not_tell_apart_the_better_prediction_stays() {
        let criteria = Criteria::default();
        let before = gap(&[about(1e-2)]);
        let mut nearly = about(1e-2);
        nearly[4] *= 1.1;
        let rule =
            |gain: f64, after: [f64; 6]| takes_the_place(&criteria, gain, &before, &gap(&[after]));
        assert!(rule(200.0, nearly));
        assert!(!rule(10.0, nearly));
        // Smaller in every window, larger in every window.
        assert!(rule(0.0, about(0.9e-2)));
        assert!(!rule(200.0, about(1.2e-2)));
    }

    #[test]
    fn few_windows_grow_by_what_the_gap_does() {
        let criteria = Criteria::default();
        let few = |square: f64| {
            let mut gap = gap(&[about(square)]);
            gap.windows.truncate(3);
            gap
        };
        assert!(grows(&criteria, &few(1e-2), &few(1.3e-2)));
        assert!(!grows(&criteria, &few(1e-2), &few(1.05e-2)));
        assert!(!grows(&criteria, &few(1e-2), &few(0.7e-2)));
    }

    #[test]
    fn free_runs_grow_where_every_window_does() {
        let criteria = Criteria::default();
        let before = gap(&[about(1e-2)]);
        assert!(grows(&criteria, &before, &gap(&[about(1.3e-2)])));
        assert!(!grows(&criteria, &before, &gap(&[about(0.9e-2)])));
        // One window that is five times as large is scatter.
        let mut one = about(1e-2);
        one[2] *= 5.0;
        assert!(!grows(&criteria, &before, &gap(&[one])));
    }

    #[test]
    fn a_decrease_that_scatters_as_much_as_it_is_large_is_chance() {
        let same = about(1.0);
        let mixed = [0.5, 1.9, 0.6, 1.7, 1.0, 0.9];
        assert!(certainty(&same, &mixed).abs() < 1.64);
        assert!(certainty(&same, &about(0.5)) > 10.0);
    }
}
