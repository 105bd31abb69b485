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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, named, pendulum};
    use crate::fit::{Point, basis};
    use crate::hypothesis::Hypothesis;

    #[test]
    fn what_short_substeps_explain_is_no_gear() {
        let mut truth = Hypothesis::default();
        truth.run.short = true;
        let case = pendulum(&truth, &[], 3.0, &|_| {});
        let (basis, settings) = (basis(&case), Settings::default());
        let at = |hypothesis: &Hypothesis, e: Vec<f64>, steps: usize| {
            let theta = vec![0.0; SIZE];
            let point = Point { theta, e };
            fit(&case, &basis, hypothesis, point, Effort::full(steps))
        };
        let long = at(&Hypothesis::default(), Vec::new(), 10);
        let geared = at(&named(&["joint_elasticity"]), vec![0.01, 1e-3], 0);
        let beside = |a: &Fit, b: &Fit| as_short(&case, &basis, &settings, a, b);
        let short = beside(&long, &geared).expect("shorter substeps");
        assert!(
            short.train.evidence() < long.train.evidence(),
            "{} {}",
            short.train.evidence(),
            long.train.evidence()
        );
        assert!(beside(&short, &geared).is_none(), "they are short already");
        assert!(beside(&geared, &geared).is_none(), "a gear has them");
        assert!(beside(&long, &short).is_none(), "no gear is to be judged");
    }
}
