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
//! by more than the scatter between their windows.

use pid_data::Role;
use rayon::prelude::*;

use super::candidates::{directions, listed};
use super::evidence::{Evidence, Part, leads};
use super::magnitude::{name, sizes};
use super::measure::{measured, share};
use super::nameless::{described, free_laws, imitated_in_part};
use super::odds::plain;
use super::refit::{Refit, refit};
use super::settings::Settings;
use crate::case::Case;
use crate::criteria::Budget;
use crate::diagnosis::Remainder;
use crate::effect::Unit;
use crate::fit::{Basis, Effort, Fit, basis, fit, ranges};
use crate::gap::Gap;
use crate::hypothesis::Run;
use crate::levels::{errors, follow_slowly, left, settle};
use crate::screen::screen;

/// Fewest windows with a scatter of their own.
const FEW: usize = 4;

/// What the library explains, and what it is judged against.
struct Partial {
    /// The case with the levels of the model's errors.
    case: Case,
    /// The nominal structure, tuned.
    base: Fit,
    /// Its gap.
    before: Gap,
    /// With the effects that pay.
    fit: Fit,
    /// Its gap.
    after: Gap,
    /// The gap with the first of them alone.
    first: f64,
    /// Candidates of all rounds, best first; those taken lead.
    ranking: Vec<Refit>,
    /// How many of them are taken.
    taken: usize,
    /// Refits made.
    refits: usize,
    /// A free law in place of the effects that describes the records better, and its gap.
    law: Option<(Refit, f64)>,
}

/// Where the taking of effects stands.
struct Stand {
    /// With the levels of the errors of the model at hand.
    case: Case,
    directions: Basis,
    /// The model at hand and its gap.
    fit: Fit,
    gap: Gap,
}

/// The nominal structure under the levels of its own errors; `sensors` are those of the readings.
fn tuned(case: &Case, settings: &Settings, nominal: &Fit, sensors: &[(f64, f64)]) -> Stand {
    let mut case = case.clone();
    follow_slowly(&mut case);
    let mut fitted = nominal.clone();
    fitted.hypothesis.run = Run::default();
    let mut directions = basis(&case);
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

/// One round: the candidates on top of what is taken, best first, and the first of them that pays,
/// with where it leads.
fn round(
    now: &Stand,
    settings: &Settings,
    sensors: &[(f64, f64)],
) -> (Vec<Refit>, Option<(usize, Stand)>) {
    let (criteria, gap) = (&settings.criteria, &now.gap);
    let list = listed(&now.case, &now.directions, settings, &now.fit);
    let (best, slopes) = screen(
        &now.case,
        &now.directions,
        &now.fit,
        &list,
        &settings.budget,
    );
    let many = Settings {
        budget: Budget {
            refits: settings.budget.partial_refits,
            ..settings.budget.clone()
        },
        ..settings.clone()
    };
    let mut tried = refit(
        &now.case,
        &now.directions,
        &many,
        &now.fit,
        (&best, &slopes),
        list.len(),
    );
    let unseen = judge(&now.case, &now.fit, &mut tried, list.len());
    let gaps: Vec<Gap> = tried
        .par_iter()
        .map(|r| measured(&now.case, &r.fit))
        .collect();
    let pays = |i: usize| {
        let (own, held_out) = (&gaps[i], unseen(&tried[i]));
        let shrinks = own.total < (1.0 - 0.5 * criteria.least_shrink) * gap.total
            && certainty(gap, own) > criteria.decrease();
        // What few windows or another joint hide: the slow predictions of motions never fitted are
        // beyond doubt.
        let beyond_doubt =
            held_out > criteria.beyond_doubt * criteria.margin && own.total < gap.total;
        tried[i].score > criteria.margin && held_out > 0.0 && (shrinks || beyond_doubt)
    };
    let taken = (0..tried.len()).filter(|&i| pays(i)).find_map(|i| {
        let mut case = now.case.clone();
        let (next, directions) = renewed(&mut case, settings, &tried[i].fit, sensors);
        let after = measured(&case, &next);
        (after.total < gap.total
            && !at_an_end(&case, &next)
            && sizes(&case, criteria, &next).iter().all(|s| *s > 1.0))
        .then_some((
            i,
            Stand {
                case,
                directions,
                fit: next,
                gap: after,
            },
        ))
    });
    (tried, taken)
}

/// Tunes the nominal structure and takes the effects that pay; `floor` is the gap that noise alone leaves.
fn partial(case: &Case, settings: &Settings, nominal: &Fit, floor: f64) -> Partial {
    let criteria = &settings.criteria;
    let sensors: Vec<(f64, f64)> = case.noise.iter().map(|n| (n.q, n.v)).collect();
    let mut now = tuned(case, settings, nominal, &sensors);
    let (base, before) = (now.fit.clone(), now.gap.clone());
    let mut ranking: Vec<Refit> = Vec::new();
    let (mut taken, mut refits) = (0, 0);
    let mut first = before.total;
    // As many as can be a verdict are named; a further one denies them that.
    let mut most = criteria.together + 1;
    while taken < most {
        let (mut tried, pays) = round(&now, settings, &sensors);
        refits += tried.len();
        let Some((i, next)) = pays else {
            if taken == 0 {
                ranking = tried;
            }
            break;
        };
        let best = tried.remove(i);
        if taken == 0 {
            ranking = tried;
            first = next.gap.total;
        }
        ranking.insert(taken, best);
        taken += 1;
        now = next;
        let explained = share(before.total, first, floor);
        if taken == 1 && !leads(criteria, explained, plain(&ranking, 1)[0].probability) {
            most = criteria.together;
        }
    }
    let laws = free_laws(&now.case, &now.directions, settings, &base, |_| true);
    refits += laws.len();
    let law = laws.into_iter().next().and_then(|law| {
        let gained = gained(&now.case, &sums_of(&now.case, &now.fit), &law.fit);
        let all = gained.train + gained.test;
        imitated_in_part(criteria, (&now.fit, &law), all, gained.number)
            .then(|| measured(&now.case, &law.fit).total)
            .map(|gap| (law, gap))
    });
    Partial {
        case: now.case,
        base,
        before,
        fit: now.fit,
        after: now.gap,
        first,
        ranking,
        taken,
        refits,
        law,
    }
}

/// Whether an amplitude of the last effect, or its number of periods, ended at the end of its
/// range: the effect then stands for something else.
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
fn sums_of(case: &Case, fit: &Fit) -> [Vec<(f64, f64)>; 2] {
    [Role::Train, Role::Test].map(|role| sums(case, fit, role))
}

/// What a fit gains over another, `Σ N′ ln(S₀/S₁)`, and the number of samples N′ that rests on.
struct Gained {
    train: f64,
    test: f64,
    number: f64,
}

/// What a fit gains over one with the sums of squares `old`.
fn gained(case: &Case, old: &[Vec<(f64, f64)>; 2], fit: &Fit) -> Gained {
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

/// Scores the refits and orders them; returns what a refit gains on the records never fitted.
fn judge(
    case: &Case,
    current: &Fit,
    tried: &mut [Refit],
    candidates: usize,
) -> impl Fn(&Refit) -> f64 + use<> {
    let old = sums_of(case, current);
    let mut unseen: Vec<(String, f64)> = Vec::new();
    for r in tried.iter_mut() {
        let Gained {
            train,
            test,
            number,
        } = gained(case, &old, &r.fit);
        let k = r.term.effect.info().parameters.len() as f64;
        r.score = train + test - k * number.max(2.0).ln() - 2.0 * (candidates as f64).ln();
        unseen.push((r.term.label(), test));
    }
    tried.sort_by(|a, b| b.score.total_cmp(&a.score));
    move |r: &Refit| {
        let label = r.term.label();
        unseen.iter().find(|u| u.0 == label).map_or(0.0, |u| u.1)
    }
}

/// Mean decrease of the logarithm of the squared error from window to window, in its standard
/// errors: each window counts alike, however lively its motion.
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

/// Adds to the evidence of a search that explains nothing what the library explains in part.
pub(super) fn add_part(evidence: Evidence, settings: &Settings) -> Evidence {
    let floor = evidence.floor;
    let Partial {
        case,
        base,
        before,
        fit,
        after,
        first,
        ranking,
        taken,
        refits,
        law,
    } = partial(&evidence.case, settings, &evidence.base, floor);
    let criteria = &settings.criteria;
    let explained = |gap: f64| share(before.total, gap, floor);
    let nameless = law
        .as_ref()
        .map(|(law, gap)| (law, explained(*gap)))
        .filter(|(_, explained)| *explained > criteria.majority)
        .and_then(|(law, explained)| described(&case, criteria, law, explained));
    Evidence {
        effects: name(&case, criteria, &fit),
        ranking: plain(&ranking, taken),
        part: Some(Part {
            first: explained(first),
            all: explained(after.total),
            left: after.total / floor,
            nameless: law.is_some(),
        }),
        remainder: Some(Remainder {
            explained: explained(after.total),
            own_error: true,
            missing_force: Vec::new(),
            nameless,
        }),
        rivals: ranking.into_iter().map(|r| r.fit).collect(),
        refits: evidence.refits + refits,
        case,
        base,
        fit,
        before,
        after,
        ..evidence
    }
}
