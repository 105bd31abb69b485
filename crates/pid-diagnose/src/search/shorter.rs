//! Whether a gear explains more than the shorter substeps that it brings.
//!
//! Position loops and sticking friction leave an error that grows with the length of a substep. With a gear substeps
//! are shorter: a spring too stiff to give way would be named for that alone.

use super::settings::Settings;
use crate::case::Case;
use crate::effect::Term;
use crate::fit::{Basis, Effort, Fit, fit};

/// A fit at the substeps of a gear, where `other` has a gear and it has neither a gear nor such substeps.
pub(super) fn as_short(
    case: &Case,
    basis: &Basis,
    settings: &Settings,
    at: &Fit,
    other: &Fit,
) -> Option<Fit> {
    let known = &case.known.hypothesis.terms;
    let geared = |fit: &Fit| {
        let mut all = known.iter().chain(&fit.hypothesis.terms);
        all.any(Term::splits_joint)
    };
    if geared(at) || !geared(other) || case.run(&at.hypothesis).short {
        return None;
    }
    let mut hypothesis = at.hypothesis.clone();
    hypothesis.run.short = true;
    let effort = Effort::full(settings.budget.touch);
    Some(fit(case, basis, &hypothesis, at.point.clone(), effort))
}
