//! Effects that pay although something is left that none of them explains.
//!
//! Where the verdict is `unknown`, the innovations are the model's errors and no measure of noise. The nominal parameters are then
//! fitted again to slow predictions (see [`levels`](crate::levels)), and effects are taken one after the other, each judged by
//!
//! ```text
//! score = Σ over joints, channels, roles  N′ ln(S₀/S₁)  −  k ln N′  −  2 ln(candidates)
//! ```
//!
//! with the sums of squares S without and with it and the number N′ of independent samples of what it leaves: twice the gain in
//! profile likelihood with the level unknown (L. Ljung, System Identification, 1999, section 7.4). It must also shrink the
//! free-run gap on motions never fitted by more than the scatter between their windows.

use pid_data::Role;
use rayon::prelude::*;

use super::magnitude::{name, sizes};
use super::refit::{Refit, refit};
use super::search::{BEYOND_DOUBT, NEAR, TOUCH, directions, listed};
use super::unnamed::{Nameless, free_laws, imitated_in_part};
use super::{Diagnosis, Ranked, Remainder, Settings, measured};
use crate::case::Case;
use crate::effect::Unit;
use crate::fit::{Basis, Effort, Fit, basis, fit, ranges};
use crate::gap::Gap;
use crate::levels::{errors, left, settle, slow};
use crate::screen::screen;

/// Most effects taken: two are named or listed, a third denies them a verdict.
const MOST: usize = 3;
/// Candidates refitted in each round.
const REFITS: usize = 9;
/// Fewest windows with a scatter of their own.
const FEW: usize = 4;
/// Mean decrease over the windows, in its standard errors (one-sided 5 %).
const CERTAIN: f64 = 1.645;
/// Turns of fit and levels at the start.
const TURNS: usize = 3;

/// What the library explains, and what it is judged against.
pub(super) struct Partial {
    /// The case with the levels of the model's errors.
    pub(super) case: Case,
    /// The nominal structure, tuned.
    pub(super) base: Fit,
    /// Its gap.
    pub(super) before: Gap,
    /// With the effects that pay.
    pub(super) fit: Fit,
    /// Its gap.
    pub(super) after: Gap,
    /// The gap with the first of them alone.
    pub(super) first: f64,
    /// Candidates of all rounds, best first; those taken lead.
    pub(super) ranking: Vec<Refit>,
    /// How many of them are taken.
    pub(super) taken: usize,
    /// Refits made.
    pub(super) refits: usize,
    /// A free law in place of the effects, its gap, and whether it describes the records better.
    law: Option<(Refit, f64, bool)>,
}

/// Tunes the nominal structure and takes the effects that pay; `floor` is the gap that noise alone leaves.
pub(super) fn partial(case: &Case, settings: &Settings, nominal: &Fit, floor: f64) -> Partial {
    let sensors: Vec<(f64, f64)> = case.noise.iter().map(|n| (n.q, n.v)).collect();
    let mut case = case.clone();
    slow(&mut case);
    let mut base = nominal.clone();
    let mut directions = basis(&case);
    for _ in 0..TURNS {
        base = fit(
            &case,
            &directions,
            &base.hypothesis,
            base.point.clone(),
            Effort::full(settings.steps),
        );
        (base, directions) = renewed(&mut case, &base, &sensors);
    }
    let before = measured(&case, &base);
    let mut current = base.clone();
    let mut gap = before.clone();
    let mut ranking: Vec<Refit> = Vec::new();
    let (mut taken, mut refits) = (0, 0);
    let mut alone = before.total;
    let few = Settings {
        refits: REFITS,
        ..settings.clone()
    };
    let mut most = MOST;
    while taken < most {
        let list = listed(&case, &directions, settings, &current);
        let (best, slopes) = screen(&case, &directions, &current, &list);
        let mut tried = refit(
            &case,
            &directions,
            &few,
            &current,
            (&best, &slopes),
            list.len(),
        );
        refits += tried.len();
        let unseen = judge(&case, &current, &mut tried, list.len());
        let gaps: Vec<Gap> = tried.par_iter().map(|r| measured(&case, &r.fit)).collect();
        let pays = (0..tried.len()).filter(|&i| {
            let (own, held_out) = (&gaps[i], unseen(&tried[i]));
            let shrinks = own.total < (1.0 - 0.5 * settings.least_shrink) * gap.total
                && certainty(&gap, own) > CERTAIN;
            // What few windows or another joint hide: the slow predictions of motions never fitted are beyond doubt.
            let beyond_doubt = held_out > BEYOND_DOUBT * settings.margin && own.total < gap.total;
            tried[i].score > settings.margin && held_out > 0.0 && (shrinks || beyond_doubt)
        });
        let taken_now = pays.into_iter().find_map(|i| {
            let mut case = case.clone();
            let (next, directions) = renewed(&mut case, &tried[i].fit, &sensors);
            let after = measured(&case, &next);
            (after.total < gap.total
                && !at_an_end(&case, &next)
                && sizes(&case, &next).iter().all(|s| *s > 1.0))
            .then_some((i, case, next, directions, after))
        });
        let Some((i, itself, next, ways, after)) = taken_now else {
            if taken == 0 {
                ranking = tried;
            }
            break;
        };
        let first = tried.remove(i);
        if taken == 0 {
            ranking = tried;
            alone = after.total;
        }
        ranking.insert(taken, first);
        taken += 1;
        (case, current, directions, gap) = (itself, next, ways, after);
        if taken == 1
            && !leads(
                share(before.total, alone, floor),
                odds(&ranking, 1)[0].probability,
            )
        {
            most = TOGETHER;
        }
    }
    let laws = free_laws(&case, &directions, settings, &base, |_| true);
    refits += laws.len();
    let law = laws.into_iter().next().map(|law| {
        let [gain, number] = gained(&case, &current, &law.fit);
        let better = imitated_in_part(&current, &law, gain, number);
        let gap = measured(&case, &law.fit).total;
        (law, gap, better)
    });
    Partial {
        case,
        base,
        before,
        fit: current,
        after: gap,
        first: alone,
        ranking,
        taken,
        refits,
        law,
    }
}

/// Whether an amplitude of the last effect, or its number of periods, ended at the end of its range: the effect then stands for
/// something else.
fn at_an_end(case: &Case, fit: &Fit) -> bool {
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
        let edge = 1e-3 * (high - low);
        // Zero is where the effect is absent.
        (x < low + edge && low != 0.0) || x > high - edge
    })
}

/// Levels that a fit leaves, and the fit under them with the directions they determine.
fn renewed(case: &mut Case, at: &Fit, sensors: &[(f64, f64)]) -> (Fit, Basis) {
    settle(case, at, sensors);
    let directions = directions(case, at);
    let next = fit(
        case,
        &directions,
        &at.hypothesis,
        at.point.clone(),
        Effort::full(TOUCH),
    );
    (next, directions)
}

/// Sums of squares of every joint and channel under a fit, and numbers of independent samples, on the records of a role.
fn sums(case: &Case, fit: &Fit, role: Role) -> Vec<(f64, f64)> {
    left(&errors(case, fit, role))
        .iter()
        .flatten()
        .filter(|l| l.number > 0.0)
        .map(|l| (l.square.max(1e-300), l.independent))
        .collect()
}

/// What a fit gains over another, `Σ N′ ln(S₀/S₁)` on the records of all roles, and the number of samples N′ it rests on.
fn gained(case: &Case, current: &Fit, fit: &Fit) -> [f64; 2] {
    [Role::Train, Role::Test]
        .iter()
        .flat_map(|&role| {
            let old = sums(case, current, role);
            sums(case, fit, role).into_iter().zip(old)
        })
        .fold([0.0; 2], |[gain, number], ((s1, independent), (s0, _))| {
            [gain + independent * (s0 / s1).ln(), number + independent]
        })
}

/// Scores the refits and orders them; returns what a refit gains on the records never fitted.
fn judge(
    case: &Case,
    current: &Fit,
    tried: &mut [Refit],
    candidates: usize,
) -> impl Fn(&Refit) -> f64 + use<> {
    let old = [Role::Train, Role::Test].map(|role| sums(case, current, role));
    let mut unseen: Vec<(String, f64)> = Vec::new();
    for r in tried.iter_mut() {
        let mut gains = [0.0; 2];
        let mut number = 0.0;
        for ((role, old), gain) in [Role::Train, Role::Test].iter().zip(&old).zip(&mut gains) {
            for ((s1, independent), (s0, _)) in sums(case, &r.fit, *role).iter().zip(old) {
                *gain += independent * (s0 / s1).ln();
                number += independent;
            }
        }
        let k = r.term.effect.info().parameters.len() as f64;
        r.score = gains[0] + gains[1] - k * number.max(2.0).ln() - 2.0 * (candidates as f64).ln();
        unseen.push((r.term.label(), gains[1]));
    }
    tried.sort_by(|a, b| b.score.total_cmp(&a.score));
    move |r: &Refit| {
        let label = r.term.label();
        unseen.iter().find(|u| u.0 == label).map_or(0.0, |u| u.1)
    }
}

/// Mean decrease of the logarithm of the squared error from window to window, in its standard errors: each window counts alike,
/// however lively its motion.
fn certainty(before: &Gap, after: &Gap) -> f64 {
    let d: Vec<f64> = before
        .windows
        .iter()
        .zip(&after.windows)
        .filter(|(a, b)| **a > 0.0 && **b > 0.0)
        .map(|(a, b)| (a / b).ln())
        .collect();
    let n = d.len() as f64;
    let mean = d.iter().sum::<f64>() / n.max(1.0);
    if d.len() < FEW {
        // Too few windows for a scatter: the gap itself decides.
        return if mean > 0.0 { f64::INFINITY } else { 0.0 };
    }
    let variance = d.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    mean / (variance / n).sqrt().max(1e-300)
}

/// Probability below which a candidate is no longer mentioned as one that explains the same.
const MENTIONED: f64 = 0.05;
/// Shares of the gap's square beyond the floor that make the first effect the verdict: its own, and that of all effects taken.
const MAJORITY: (f64, f64) = (0.7, 0.8);
/// Effects that are a verdict beside an unknown rest, at most: three and more together imitate what the library lacks.
const TOGETHER: usize = 2;
/// Probability of the first effect among its rivals from which it is: where all of them leave much, odds are worth less.
const LEADS: f64 = 0.95;
/// Confidence in a verdict beside which something is left, at most; and in `unknown`.
const HIGHEST: f64 = 0.9;

/// Share of the squared gap beyond the floor that effects with the gap `after` explain.
pub(super) fn share(before: f64, after: f64, floor: f64) -> f64 {
    let possible = before * before - floor * floor;
    if possible > 0.0 {
        ((before * before - after * after) / possible).clamp(0.0, 1.0)
    } else {
        0.0
    }
}

/// Whether the first effect explains most by itself, and its rivals nearly never: what any verdict beside an unknown rest needs.
fn leads(explained: f64, probability: f64) -> bool {
    explained > MAJORITY.0 && probability > LEADS
}

/// Whether free runs leave no more than noise beside the effects taken, and the first of them is more likely than its rivals
/// together: these explain the same then, and stand in the confusion set.
fn nothing_left(after: f64, floor: f64, probability: f64) -> bool {
    after < NEAR * floor && probability > 0.5
}

impl Partial {
    /// Says in a diagnosis what the effects explain and what is left.
    pub(super) fn describe(&self, diagnosis: &mut Diagnosis) {
        let (before, after) = (self.before.total, self.after.total);
        let floor = diagnosis.gap_floor;
        let explained = share(before, after, floor);
        diagnosis.effects = name(&self.case, &self.fit);
        (diagnosis.gap_before, diagnosis.gap_after) = (before, after);
        diagnosis.gap_intervals = (self.before.interval(), self.after.interval());
        diagnosis.gap_joints = self.after.joints.clone();
        diagnosis.gap_joints_before = self.before.joints.clone();
        diagnosis.ranking = odds(&self.ranking, self.taken);
        diagnosis.refits += self.refits;
        diagnosis.confusion_set = diagnosis
            .ranking
            .iter()
            .skip(self.taken)
            .filter(|l| l.probability > MENTIONED)
            .map(Ranked::label)
            .collect();
        let law = self.law.as_ref().filter(|(_, _, better)| *better);
        diagnosis.remainder = Some(Remainder {
            explained,
            own_error: true,
            missing_force: Vec::new(),
            nameless: law
                .map(|(law, gap, _)| (law, share(before, *gap, floor)))
                .filter(|(_, explained)| *explained > MAJORITY.0)
                .and_then(|(law, explained)| Nameless::new(&self.case, law, explained)),
        });
        let Some(first) = diagnosis.effects.first() else {
            return;
        };
        let probability = diagnosis.ranking[0].probability;
        let most = leads(share(before, self.first, floor), probability) && explained > MAJORITY.1;
        if diagnosis.effects.len() <= TOGETHER
            && law.is_none()
            && (most || nothing_left(after, floor, probability))
        {
            diagnosis.effect = first.effect.clone();
            diagnosis.joint = first.joint;
            diagnosis.regime = first.regime.clone();
            diagnosis.confidence = probability.min(HIGHEST);
        }
    }
}

/// A ranking, of which the first `taken` are taken, with odds: those of the first round among each other, the later ones in their own.
fn odds(ranking: &[Refit], taken: usize) -> Vec<Ranked> {
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
        .map(|(i, r)| Ranked {
            effect: r.term.effect.info().id.to_owned(),
            joint: r.term.shown_joint(),
            score: r.score,
            probability: if own(i) {
                weight(score(i)) / sum
            } else {
                1.0 - weight(0.0).min(1.0)
            },
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_explained_share_is_that_of_squares_beyond_the_floor() {
        // Half of the square between 0.5² and 0.1².
        let half = f64::sqrt(0.5 * (0.25 + 0.01));
        assert!((share(0.5, half, 0.1) - 0.5).abs() < 1e-12);
        assert_eq!(share(0.5, 0.05, 0.1), 1.0);
        assert_eq!(share(0.5, 0.6, 0.1), 0.0);
        // Nothing to explain.
        assert_eq!(share(0.1, 0.05, 0.1), 0.0);
    }

    #[test]
    fn a_first_effect_leads_by_its_own_share_and_by_its_odds() {
        assert!(leads(0.75, 0.97));
        // Of two rivals that explain the same, neither is the verdict, however much both explain.
        assert!(!leads(0.99, 0.5));
        assert!(!leads(0.6, 1.0));
    }

    #[test]
    fn rivals_that_explain_the_same_do_not_deny_a_verdict_where_nothing_is_left() {
        assert!(nothing_left(0.0016, 0.0012, 0.85));
        // Something is left.
        assert!(!nothing_left(0.0020, 0.0012, 0.85));
        // The others together are as likely.
        assert!(!nothing_left(0.0012, 0.0012, 0.45));
    }
}
