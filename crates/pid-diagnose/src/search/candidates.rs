//! What a round of the search tries, and along which directions the nominal parameters move beside it.

use crate::case::Case;
use crate::effect::{Kind, Term};
use crate::fit::{Basis, Fit, basis, basis_beside};
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

/// Directions of the nominal parameters that the records determine: a gear that gives way shows more of them.
pub(super) fn directions(case: &Case, fit: &Fit) -> Basis {
    if fit.hypothesis.terms.iter().any(has_state) {
        basis_beside(case, &fit.hypothesis, &fit.point)
    } else {
        basis(case)
    }
}
