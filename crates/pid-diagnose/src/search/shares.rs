//! How much of the gap each of several effects explains.
//!
//! Effects interact: what is lost without one is not what it explains alone. With the squared gaps
//! G² of the nominal structure, of all effects, of all but one and of one alone, each with the
//! nominal parameters and the other effects fitted again, and the squared floor F²,
//!
//! ```text
//! left out = (G²(all but e) − G²(all)) / (G²(none) − F²)
//! left in  = (G²(none) − G²(e)) / (G²(none) − F²)
//! share(e) = explained · (left out + left in) / Σ (left out + left in)
//! ```
//!
//! so that the shares add up to what all effects explain together. Of two effects the mean of both
//! is the value of L. S. Shapley, Annals of Mathematics Studies 28, 1953.

use rayon::prelude::*;

use super::measure::{measured, share};
use super::settings::Settings;
use crate::case::Case;
use crate::fit::{Basis, Effort, Fit, Point, fit};
use crate::hypothesis::Hypothesis;

/// Gaps with and without one effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Parts {
    /// With all but this one.
    pub(super) without: f64,
    /// With this one alone.
    pub(super) alone: f64,
}

/// A part of the effects of a fit, their nominal parameters fitted again in so many steps.
fn with(case: &Case, basis: &Basis, steps: usize, at: &Fit, keep: impl Fn(usize) -> bool) -> Fit {
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

/// [`Parts`] of every effect of a fit; `before` and `after` are the gaps without any and with all.
pub(super) fn parts(
    case: &Case,
    basis: &Basis,
    settings: &Settings,
    at: &Fit,
    (before, after): (f64, f64),
) -> Vec<Parts> {
    let count = at.hypothesis.terms.len();
    if count == 1 {
        return vec![Parts {
            without: before,
            alone: after,
        }];
    }
    let gap = |fit: Fit| measured(case, &fit).total;
    (0..count)
        .into_par_iter()
        .map(|i| Parts {
            without: gap(without(case, basis, settings, at, i)),
            alone: gap(with(case, basis, settings.budget.steps, at, |k| k == i)),
        })
        .collect()
}

/// Shares of the squared gap beyond the floor.
pub(super) fn shares(parts: &[Parts], before: f64, after: f64, floor: f64) -> Vec<f64> {
    let all = share(before, after, floor);
    let whole = (before * before - floor * floor).max(1e-300);
    let sizes: Vec<f64> = parts
        .iter()
        .map(|p| {
            let out = (p.without * p.without - after * after) / whole;
            let alone = (before * before - p.alone * p.alone) / whole;
            0.5 * (out.clamp(0.0, 1.0) + alone.clamp(0.0, 1.0))
        })
        .collect();
    let sum: f64 = sizes.iter().sum();
    sizes
        .iter()
        .map(|s| if sum > 0.0 { all * s / sum } else { 0.0 })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_of_effects_that_add_up_are_their_own_squares() {
        // Squared gaps: floor 1, effects 6 and 3 beside it.
        let [before, after] = [10.0_f64, 1.0].map(f64::sqrt);
        let parts = [(7.0_f64, 4.0_f64), (4.0, 7.0)].map(|(without, alone)| Parts {
            without: without.sqrt(),
            alone: alone.sqrt(),
        });
        let found = shares(&parts, before, after, 1.0);
        assert!((found[0] - 2.0 / 3.0).abs() < 1e-12, "{found:?}");
        assert!((found.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn one_effect_has_all_that_is_explained() {
        let parts = [Parts {
            without: 0.5,
            alone: 0.2,
        }];
        let found = shares(&parts, 0.5, 0.2, 0.1);
        assert!((found[0] - share(0.5, 0.2, 0.1)).abs() < 1e-12);
    }
}
