//! How much of the gap each of several effects explains.
//!
//! Effects interact: what is lost without one is not what it explains alone. With the squared gaps
//! G² of the nominal structure, of all effects, of all but one and of one alone, each with its parameters
//! fitted again, and the squared floor F²,
//!
//! ```text
//! left out = (G²(all but e) − G²(all)) / (G²(none) − F²)
//! left in  = (G²(none) − G²(e)) / (G²(none) − F²)
//! share(e) = explained · (left out + left in) / Σ (left out + left in)
//! ```
//!
//! so that the shares add up to what all effects explain together. Of two effects the mean of both
//! is the value of L. S. Shapley, Annals of Mathematics Studies 28, 1953. Intervals come from drawing the
//! windows of the free runs anew, the same ones for all gaps.

use rayon::prelude::*;

use super::candidates::directions;
use super::evidence::Evidence;
use super::measure::{measured, share};
use super::settings::Settings;
use crate::case::Case;
use crate::fit::{Basis, Effort, Fit, Point, fit, fit_nominal_to_free_runs};
use crate::gap::{FEW_WINDOWS, Gap, draws, within};
use crate::hypothesis::Hypothesis;

/// Seed of the draws of windows: the same ones for all gaps.
const SEED: u64 = 0x5a4e;

/// Gaps with and without one effect.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Parts {
    /// With all but this one.
    pub(super) without: Gap,
    /// With this one alone.
    pub(super) alone: Gap,
}

/// The share of an effect with its interval of 95 %, where the windows tell one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Portion {
    pub(super) share: f64,
    pub(super) interval: Option<(f64, f64)>,
}

impl Portion {
    /// A share, and its values in draws of the windows; none where there are too few windows.
    fn new(share: f64, drawn: impl Iterator<Item = f64>) -> Self {
        let mut drawn = drawn.peekable();
        let some = drawn.peek().is_some();
        Self {
            share,
            interval: some.then(|| within(drawn)),
        }
    }
}

/// A part of the effects of a fit, their nominal parameters fitted again in so many steps.
pub(super) fn with(
    case: &Case,
    basis: &Basis,
    steps: usize,
    at: &Fit,
    keep: impl Fn(usize) -> bool,
) -> Fit {
    let (starts, _) = at.hypothesis.offsets();
    let (mut terms, mut e) = (Vec::new(), Vec::new());
    for (i, term) in at.hypothesis.terms.iter().enumerate() {
        if keep(i) {
            let k = term.effect.info().parameters.len();
            e.extend_from_slice(&at.point.e[starts[i]..starts[i] + k]);
            terms.push(term.clone());
        }
    }
    let hypothesis = Hypothesis {
        run: at.hypothesis.run,
        ..Hypothesis::new(terms)
    };
    let point = Point {
        theta: at.point.theta.clone(),
        e,
    };
    fit(case, basis, &hypothesis, point, Effort::full(steps))
}

/// The fit without the `i`-th effect.
pub(super) fn without(case: &Case, basis: &Basis, settings: &Settings, at: &Fit, i: usize) -> Fit {
    with(case, basis, settings.budget.steps, at, |k| k != i)
}

/// The same with all other parameters where they are.
pub(super) fn taken_out(case: &Case, basis: &Basis, at: &Fit, i: usize) -> Fit {
    with(case, basis, 0, at, |k| k != i)
}

/// What the parameters are fitted to where effects are left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fitted {
    /// Predictions.
    Predictions,
    /// These, or the nominal parameters to free runs with the effects as they are, whichever leaves less: predictions
    /// can be good with parameters that let free runs without an effect diverge.
    Least,
}

/// [`Parts`] of every effect of a fit; `before` and `after` are the gaps without any and with all.
pub(super) fn parts(
    case: &Case,
    basis: &Basis,
    settings: &Settings,
    at: &Fit,
    (fitted, before, after): (Fitted, &Gap, &Gap),
) -> Vec<Parts> {
    let free = fitted == Fitted::Least && !settings.watch.stopped();
    if free {
        let step = "shares of the gap: each effect alone, and without it";
        settings.watch.step(step);
    }
    each(at.hypothesis.terms.len(), (before, after), &|keep| {
        let predicted = with(case, basis, settings.budget.steps, at, keep);
        let own = measured(case, &predicted);
        if !free {
            return own;
        }
        let held = with(case, basis, 0, at, keep);
        let mut moved = held.clone();
        moved.point.theta = predicted.point.theta;
        let fits = [held, moved].into_par_iter();
        let fits = fits.filter_map(|from| fit_nominal_to_free_runs(case, basis, &from));
        let gaps: Vec<Gap> = fits.map(|fit| measured(case, &fit)).collect();
        let less = |a: Gap, b: Gap| if b.total < a.total { b } else { a };
        gaps.into_iter().fold(own, less)
    })
}

/// Whether an effect of a fit is kept.
type Kept<'a> = &'a dyn Fn(usize) -> bool;

/// [`Parts`] of so many effects from the gap of some of them.
fn each(
    count: usize,
    (before, after): (&Gap, &Gap),
    gap: &(dyn Fn(Kept<'_>) -> Gap + Sync),
) -> Vec<Parts> {
    let all = |keep: &(dyn Fn(usize, usize) -> bool + Sync)| -> Vec<Gap> {
        let each = (0..count).into_par_iter();
        each.map(|i| gap(&|k| keep(i, k))).collect()
    };
    let (without, alone) = match count {
        1 => (vec![before.clone()], vec![after.clone()]),
        // Without one of two the other is alone.
        2 => {
            let alone = all(&|i, k| k == i);
            (alone.iter().rev().cloned().collect(), alone)
        }
        _ => (all(&|i, k| k != i), all(&|i, k| k == i)),
    };
    let pairs = without.into_iter().zip(alone);
    pairs
        .map(|(without, alone)| Parts { without, alone })
        .collect()
}

/// Shares of the squared gap beyond the floor, with the gaps of all windows and of those of draws.
pub(super) fn shares(parts: &[Parts], before: &Gap, after: &Gap, floor: f64) -> Vec<Portion> {
    let (all, drawn) = with_draws(parts, before, after, floor);
    let own = |i: usize| Portion::new(all[i], drawn.iter().map(|shares| shares[i]));
    (0..parts.len()).map(own).collect()
}

/// What several of the effects have of the gap together.
pub(super) fn together(
    parts: &[Parts],
    before: &Gap,
    after: &Gap,
    floor: f64,
    among: impl Fn(usize) -> bool,
) -> Portion {
    let (all, drawn) = with_draws(parts, before, after, floor);
    let sum = |shares: &Vec<f64>| {
        let own = shares.iter().enumerate().filter(|(i, _)| among(*i));
        own.map(|(_, s)| s).sum::<f64>()
    };
    Portion::new(sum(&all), drawn.iter().map(sum))
}

/// What is explained with something that is missing in the gap `without`.
pub(super) fn beyond(before: &Gap, without: &Gap, after: &Gap, floor: f64) -> Portion {
    let of = |square: &dyn Fn(&Gap) -> f64| {
        let explained = |gap: &Gap| share(square(before).sqrt(), square(gap).sqrt(), floor);
        explained(after) - explained(without)
    };
    let n = before.windows.len();
    let draws = (n >= FEW_WINDOWS).then(|| draws(n, SEED));
    Portion::new(
        of(&|gap| gap.total * gap.total),
        draws
            .into_iter()
            .flatten()
            .map(|draw| of(&|gap| gap.square_of(&draw))),
    )
}

/// Shares of the effects with the gaps of all windows, and with those of draws, where the windows tell.
fn with_draws(parts: &[Parts], before: &Gap, after: &Gap, floor: f64) -> (Vec<f64>, Vec<Vec<f64>>) {
    let of = |square: &dyn Fn(&Gap) -> f64| -> Vec<f64> {
        let pairs: Vec<(f64, f64)> = (parts.iter())
            .map(|p| (square(&p.without), square(&p.alone)))
            .collect();
        split(&pairs, square(before), square(after), floor * floor)
    };
    let all = of(&|gap| gap.total * gap.total);
    let n = before.windows.len();
    let drawn: Vec<Vec<f64>> = match n < FEW_WINDOWS {
        true => Vec::new(),
        false => draws(n, SEED)
            .map(|draw| of(&|gap| gap.square_of(&draw)))
            .collect(),
    };
    (all, drawn)
}

/// Shares from squared gaps: without and with each effect alone, before, after, and the floor.
fn split(parts: &[(f64, f64)], before: f64, after: f64, floor: f64) -> Vec<f64> {
    let all = share(before.sqrt(), after.sqrt(), floor.sqrt());
    let whole = (before - floor).max(1e-300);
    let size = |(without, alone): &(f64, f64)| {
        let (out, alone) = ((without - after) / whole, (before - alone) / whole);
        0.5 * (out.clamp(0.0, 1.0) + alone.clamp(0.0, 1.0))
    };
    let sizes: Vec<f64> = parts.iter().map(size).collect();
    let sum: f64 = sizes.iter().sum();
    let own = |s: &f64| if sum > 0.0 { all * s / sum } else { 0.0 };
    sizes.iter().map(own).collect()
}

/// Gives the effects of a search their shares, where it did not tell them one from another by free runs.
pub(super) fn with_shares(mut evidence: Evidence, settings: &Settings) -> Evidence {
    let e = &mut evidence;
    let terms = &e.fit.hypothesis.terms;
    let same = terms.len() == e.effects.len()
        && (terms.iter().zip(&e.effects))
            .all(|(t, n)| t.effect.info().id == n.effect && t.shown_joint() == n.joint);
    if e.part.is_some() || !same || terms.is_empty() || settings.watch.stopped() {
        return evidence;
    }
    let basis = directions(&e.case, &e.fit);
    let gaps = (Fitted::Least, &e.before, &e.after);
    let parts = parts(&e.case, &basis, settings, &e.fit, gaps);
    let portions = shares(&parts, &e.before, &e.after, e.floor.min(e.after.total));
    for (named, portion) in e.effects.iter_mut().zip(portions) {
        named.share = Some(portion.share);
        named.share_interval = portion.interval;
    }
    evidence
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, named, pendulum};
    use crate::fit::basis;

    /// A gap whose windows have these squares.
    fn gap(windows: &[f64]) -> Gap {
        let mean = windows.iter().sum::<f64>() / windows.len() as f64;
        Gap {
            total: mean.sqrt(),
            joints: vec![(mean.sqrt(), None)],
            windows: windows.to_vec(),
            joint_windows: vec![windows.to_vec()],
        }
    }

    /// Free runs lead to less than predictions somewhere, and nowhere is more left than these leave.
    #[test]
    fn the_least_of_both_fits_is_no_more_than_predictions_leave() {
        let both = named(&["spring", "quadratic_drag"]);
        let e = [0.2, 0.05, 0.02];
        let case = pendulum(&both, &e, 6.0, &|_| {});
        let settings = Settings::default();
        let own = basis(&case);
        let truth = Point {
            theta: vec![0.0; SIZE],
            e: e.to_vec(),
        };
        let at = fit(&case, &own, &both, truth, Effort::full(0));
        let after = measured(&case, &at);
        let of = |fitted| {
            let gaps = (fitted, &after, &after);
            let parts = parts(&case, &own, &settings, &at, gaps);
            // Without one of two the other is alone.
            assert_eq!(parts[0].without, parts[1].alone);
            assert_eq!(parts[1].without, parts[0].alone);
            [0, 1].map(|i| parts[i].alone.total)
        };
        let (predicted, least) = (of(Fitted::Predictions), of(Fitted::Least));
        let mut pairs = least.iter().zip(&predicted);
        assert!(
            pairs.all(|(least, most)| least <= most),
            "{least:?} {predicted:?}"
        );
        // Without the spring, parameters that predict well let free runs drift away.
        assert!(least[1] < 0.5 * predicted[1], "{least:?} {predicted:?}");
        assert!(least.iter().all(|l| *l > after.total), "{least:?}");
    }

    #[test]
    fn shares_of_effects_that_add_up_are_their_own_squares() {
        // Squares: floor 1, effects 6 and 3 beside it.
        let found = split(&[(7.0, 4.0), (4.0, 7.0)], 10.0, 1.0, 1.0);
        assert!((found[0] - 2.0 / 3.0).abs() < 1e-12, "{found:?}");
        assert!((found.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn an_interval_is_as_wide_as_the_windows_differ() {
        // Effects of 6 and 3 beside a floor of 1 in every window: nothing scatters.
        let even = |x: f64| gap(&[x; 8]);
        let parts = |gap: &dyn Fn(f64, f64) -> Gap| {
            let pair = |own: f64, other: f64| Parts {
                without: gap(other, own),
                alone: gap(own, other),
            };
            vec![pair(4.0, 7.0), pair(7.0, 4.0)]
        };
        let found = shares(
            &parts(&|without, _| even(without)),
            &even(10.0),
            &even(1.0),
            1.0,
        );
        let (low, high) = found[0].interval.expect("enough windows");
        assert!(high - low < 1e-9, "{found:?}");
        // One effect acts in half of the windows only, the other one in the rest.
        let halves = |first: f64, second: f64| {
            let mut windows = [first; 8];
            windows[4..].fill(second);
            gap(&windows)
        };
        let mixed = [
            Parts {
                without: halves(1.0, 7.0),
                alone: halves(7.0, 1.0),
            },
            Parts {
                without: halves(7.0, 1.0),
                alone: halves(1.0, 7.0),
            },
        ];
        let found = shares(&mixed, &halves(7.0, 7.0), &halves(1.0, 1.0), 1.0);
        let (low, high) = found[0].interval.expect("enough windows");
        assert!((found[0].share - 0.5).abs() < 1e-9, "{found:?}");
        // Of eight draws 2 to 6 fall into one half with a probability of 93 %, 1 to 7 with 99 %.
        assert!(low < 0.26 && high > 0.74, "{low} {high}");
        assert!(low > 0.1 && high < 0.9, "{low} {high}");
        // Three windows tell none.
        let few = |x: f64| gap(&[x; 3]);
        let found = shares(
            &parts(&|without, _| few(without)),
            &few(10.0),
            &few(1.0),
            1.0,
        );
        assert_eq!(found[0].interval, None);
    }

    #[test]
    fn a_group_has_what_its_effects_have() {
        let parts = [(7.0, 4.0), (4.0, 7.0), (2.0, 9.0)].map(|(without, alone)| Parts {
            without: gap(&[without, 1.1 * without, 0.9 * without, without]),
            alone: gap(&[alone; 4]),
        });
        let (before, after) = (gap(&[10.0, 9.0, 11.0, 10.0]), gap(&[1.0; 4]));
        let own = shares(&parts, &before, &after, 1.0);
        let group = together(&parts, &before, &after, 1.0, |i| i != 1);
        assert!((group.share - own[0].share - own[2].share).abs() < 1e-12);
        let rest = together(&parts, &before, &after, 1.0, |i| i == 1);
        assert_eq!(rest, own[1]);
        // All is explained in every draw, so that what one has the others lack.
        let (group, rest) = (group.interval.unwrap(), rest.interval.unwrap());
        assert!((group.0 + rest.1 - 1.0).abs() < 1e-9, "{group:?} {rest:?}");
    }

    #[test]
    fn what_something_adds_is_told_by_the_gap_without_it() {
        // Squares beyond a floor of 1: 9 of the gap, 5 left without, none left with it.
        let added = beyond(&gap(&[10.0; 4]), &gap(&[6.0; 4]), &gap(&[1.0; 4]), 1.0);
        assert!((added.share - 5.0 / 9.0).abs() < 1e-12, "{added:?}");
        let (low, high) = added.interval.expect("four windows");
        assert!((low - high).abs() < 1e-12, "{added:?}");
        assert_eq!(
            beyond(&gap(&[10.0; 3]), &gap(&[6.0; 3]), &gap(&[1.0; 3]), 1.0).interval,
            None
        );
    }

    #[test]
    fn one_effect_has_all_that_is_explained() {
        let found = split(&[(0.25, 0.04)], 0.25, 0.04, 0.01);
        assert!((found[0] - share(0.5, 0.2, 0.1)).abs() < 1e-12);
    }
}
