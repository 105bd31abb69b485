//! What a round of the search tries, and along which directions the nominal parameters move beside it.

use crate::case::Case;
use crate::effect::{Kind, Term, Unit};
use crate::fit::{Basis, Fit, basis, basis_beside, ranges};
use crate::screen::candidates;
use crate::windows;

use super::settings::Settings;

/// All candidates on top of a fit, with their starts.
pub(super) fn listed(
    case: &Case,
    basis: &Basis,
    settings: &Settings,
    current: &Fit,
) -> Vec<(Term, Vec<Vec<f64>>)> {
    let mut list = candidates(case, &settings.effects, &current.hypothesis);
    for (term, starts) in &mut list {
        starts.extend(windows::starts(case, basis, current, term));
    }
    list
}

/// Whether a term brings states of its own.
pub(super) fn has_state(term: &Term) -> bool {
    term.effect.info().kind == Kind::State
}

/// Share of a range from its end that counts as its end.
pub(super) const END: f64 = 1e-3;

/// Whether the gear of the last effect is damped as much as its range allows: it then filters the
/// motion, and is neither a spring nor a play.
pub(super) fn overdamped(case: &Case, fit: &Fit) -> bool {
    let Some(term) = fit.hypothesis.terms.last() else {
        return false;
    };
    let info = term.effect.info();
    let first = fit.point.e.len() - info.parameters.len();
    let own = &fit.point.e[first..];
    let ranges = ranges(case, &fit.hypothesis);
    let mut all = info.parameters.iter().zip(own).zip(&ranges[first..]);
    term.effect.plain().gear(own).is_some()
        && all.any(|((p, x), (low, high))| p.unit == Unit::Time && *x > high - END * (high - low))
}

/// Directions of the nominal parameters that the records determine: a gear that gives way shows more of them.
pub(crate) fn directions(case: &Case, fit: &Fit) -> Basis {
    if fit.hypothesis.terms.iter().any(has_state) {
        basis_beside(case, &fit.hypothesis, &fit.point)
    } else {
        basis(case)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, named, pendulum};
    use crate::fit::{Effort, Point, fit};

    #[test]
    fn a_gear_at_the_end_of_its_damping_is_no_spring() {
        let elastic = named(&["joint_elasticity"]);
        let case = pendulum(&elastic, &[0.01, 1e-3], 1.0, &|_| {});
        let at = |damping_time: f64| {
            let point = Point {
                theta: vec![0.0; SIZE],
                e: vec![0.01, damping_time],
            };
            fit(&case, &basis(&case), &elastic, point, Effort::full(0))
        };
        assert!(!overdamped(&case, &at(1e-3)));
        assert!(overdamped(&case, &at(0.03)));
    }
}
