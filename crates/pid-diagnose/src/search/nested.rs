//! What is accepted with all that a candidate has beside its effect.
//!
//! A candidate starts its refit at other nominal values than those at which what is accepted came to rest, and where
//! motion sticks and slips there are many optima. With a gear its substeps are shorter, and position loops and sticking
//! friction leave an error that grows with the length of a substep: a spring too stiff to give way would be named for
//! that alone. Models are compared that differ in the effect only.

use rayon::prelude::*;

use super::settings::Settings;
use crate::case::Case;
use crate::effect::Term;
use crate::fit::{Basis, Effort, Fit, Point, fit};

/// A fit from the nominal values of another one, which has an effect more, and at the substeps of that.
pub(super) fn nested(
    case: &Case,
    basis: &Basis,
    settings: &Settings,
    at: &Fit,
    other: &Fit,
) -> Fit {
    let known = &case.known.hypothesis.terms;
    let geared = |fit: &Fit| {
        let mut all = known.iter().chain(&fit.hypothesis.terms);
        all.any(Term::splits_joint)
    };
    let mut hypothesis = at.hypothesis.clone();
    let mut starts = vec![Point {
        theta: other.point.theta.clone(),
        e: at.point.e.clone(),
    }];
    if geared(other) && !geared(at) && !case.run(&at.hypothesis).short {
        hypothesis.run.short = true;
        starts.push(at.point.clone());
    }
    let effort = Effort::full(settings.budget.steps);
    let fits = starts
        .into_par_iter()
        .map(|start| fit(case, basis, &hypothesis, start, effort));
    let best = fits.min_by(|a, b| a.train.evidence().total_cmp(&b.train.evidence()));
    best.unwrap_or_else(|| at.clone())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, named, pendulum};
    use crate::fit::basis;
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
        let beside = |a: &Fit, b: &Fit| nested(&case, &basis, &settings, a, b);
        let short = beside(&long, &geared);
        assert!(
            short.train.evidence() < long.train.evidence(),
            "{} {}",
            short.train.evidence(),
            long.train.evidence()
        );
        let is_short = |a: &Fit, b: &Fit| beside(a, b).hypothesis.run.short;
        assert!(short.hypothesis.run.short);
        assert!(is_short(&short, &geared), "they stay short");
        assert!(!is_short(&geared, &geared), "a gear has them");
        assert!(!is_short(&long, &long), "no gear is to be judged");
    }

    #[test]
    fn a_better_optimum_of_the_nominal_values_is_no_effect() {
        let nothing = Hypothesis::default();
        let case = pendulum(&nothing, &[], 3.0, &|_| {});
        let (basis, settings) = (basis(&case), Settings::default());
        let at = |hypothesis: &Hypothesis, e: Vec<f64>, first: f64, steps: usize| {
            let mut theta = vec![0.0; SIZE];
            theta[0] = first;
            let point = Point { theta, e };
            fit(&case, &basis, hypothesis, point, Effort::full(steps))
        };
        // Stands in for an optimum that is not the lowest.
        let stuck = at(&nothing, Vec::new(), 0.6, 0);
        let other = at(&named(&["spring"]), vec![0.0, 0.0], 0.0, 10);
        let found = nested(&case, &basis, &settings, &stuck, &other);
        assert!(found.hypothesis.terms.is_empty());
        assert!(other.train.evidence() < stuck.train.evidence() - 10.0);
        assert!(found.train.evidence() < other.train.evidence() + 1.0);
    }
}
