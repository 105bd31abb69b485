//! Backward check of forward selection (M. A. Efroymson 1960): an effect that was taken first may
//! be superfluous beside a later one.

use super::measure::{Reached, noise_scale};
use super::settings::Settings;
use crate::case::Case;
use crate::fit::{Basis, Effort, Fit, fit};

/// The fits without each of the effects but the last, in their order.
pub(super) fn without_each(
    case: &Case,
    basis: &Basis,
    settings: &Settings,
    current: &Fit,
) -> Vec<Fit> {
    let (starts, _) = current.hypothesis.offsets();
    (0..current.hypothesis.terms.len().saturating_sub(1))
        .map(|i| {
            let mut hypothesis = current.hypothesis.clone();
            let k = hypothesis.terms.remove(i).effect.info().parameters.len();
            let mut point = current.point.clone();
            point.e.drain(starts[i]..starts[i] + k);
            fit(
                case,
                basis,
                &hypothesis,
                point,
                Effort::full(settings.budget.steps),
            )
        })
        .collect()
}

/// The effect that the others have made superfluous, if there is one whose removal costs less than
/// an effect must gain; `without` has a fit without each, as [`without_each`] gives them.
pub(super) fn superfluous(
    case: &Case,
    settings: &Settings,
    current: &Fit,
    without: &[Fit],
) -> Option<usize> {
    let (scale, number) = (noise_scale(current), current.train.number());
    let whole = Reached::new(case, current);
    let cost = |without: &Fit| whole.gain(&Reached::new(case, without), scale, number);
    (0..without.len())
        .map(|i| (i, cost(&without[i])))
        .filter(|(_, cost)| *cost < settings.criteria.margin())
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(i, _)| i)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, named, pendulum};
    use crate::fit::{Point, basis};

    /// Both effects fitted from a start to records of some, and what the check drops.
    fn checked(
        (hidden, e): (&[&str], &[f64]),
        (both, start): (&[&str], &[f64]),
    ) -> Option<(Fit, usize)> {
        let case = pendulum(&named(hidden), e, 6.0, &|_| {});
        let directions = basis(&case);
        let settings = Settings::default();
        let at = Point {
            theta: vec![0.0; SIZE],
            e: start.to_vec(),
        };
        let current = fit(
            &case,
            &directions,
            &named(both),
            at,
            Effort::full(settings.budget.steps),
        );
        let mut without = without_each(&case, &directions, &settings, &current);
        let dropped = superfluous(&case, &settings, &current, &without)?;
        Some((without.swap_remove(dropped), dropped))
    }

    #[test]
    fn an_effect_that_a_later_one_makes_superfluous_is_dropped() {
        let (left, dropped) = checked(
            (&["spring"], &[0.9, 0.2]),
            (&["current_offset", "spring"], &[0.02, 0.5, 0.1]),
        )
        .expect("one too many");
        assert_eq!(dropped, 0, "the offset, which was first");
        assert_eq!(left.hypothesis.terms.len(), 1);
        assert_eq!(left.hypothesis.terms[0].effect.info().id, "spring");
        assert!((left.point.e[0] - 0.9).abs() < 0.09, "{:?}", left.point.e);
    }

    #[test]
    fn an_effect_that_is_there_beside_a_later_one_stays() {
        let both = ["quadratic_drag", "spring"];
        let dropped = checked((&both, &[0.05, 0.9, 0.2]), (&both, &[0.02, 0.5, 0.1]));
        assert!(dropped.is_none());
    }
}
