//! What the numerics of a diagnosis did not bring to an end, in words.

use rayon::prelude::*;

use crate::case::Case;
use crate::fit::Fit;

/// Warnings on the fit that a verdict rests on: iterations that ended at their limit. Empty where
/// all of them settled.
pub(crate) fn warnings(case: &Case, fit: &Fit) -> Vec<String> {
    let mut out = Vec::new();
    let blind: Vec<String> = (0..case.n())
        .filter(|&j| fit.gains.iter().any(|g| !g[j].settled))
        .map(|j| (j + 1).to_string())
        .collect();
    if !blind.is_empty() {
        out.push(format!(
            "the observer's covariance does not settle at joint {}: its sensors do not see all of its motion, and its innovations are weighed by a guess",
            blind.join(", ")
        ));
    }
    if fit.unsettled > 0 {
        out.push(format!(
            "{} trial steps of the fit are no minimiser of their quadratic model: the parameters may have stopped early",
            fit.unsettled
        ));
    }
    let unsettled = sticking(case, fit);
    if unsettled > 0 {
        out.push(format!(
            "in {unsettled} integration steps of the prediction the joints did not settle between sticking and sliding: the gap there is partly one of integration"
        ));
    }
    out
}

/// Integration steps of the one-step prediction of all records whose dry friction did not settle.
fn sticking(case: &Case, fit: &Fit) -> usize {
    let records = case.records.par_iter().zip(&fit.gains);
    records
        .map(|(record, gains)| {
            let mut runner = fit.runner(case, record);
            runner.predict(gains, &mut |_, _, _, _| {}, &mut |_, _| {});
            runner.machine.unsettled
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, named, pendulum};
    use crate::fit::{Effort, Point, basis, fit};

    #[test]
    fn what_did_not_settle_is_told_and_nothing_else() {
        let nothing = named(&[]);
        let case = pendulum(&nothing, &[], 2.0, &|_| {});
        let start = Point {
            theta: vec![0.0; SIZE],
            e: Vec::new(),
        };
        let mut found = fit(&case, &basis(&case), &nothing, start, Effort::full(3));
        assert_eq!(warnings(&case, &found), Vec::<String>::new());
        found.gains[0][0].settled = false;
        found.unsettled = 2;
        let told = warnings(&case, &found);
        assert_eq!(told.len(), 2, "{told:?}");
        assert!(told[0].contains("joint 1:") && told[1].starts_with("2 trial steps"));
    }
}
