//! Exchange check of forward selection (A. J. Miller, Subset Selection in Regression, 2002, chapter
//! 3): of two causes the first was chosen while the second was missing, and may have been taken for
//! another.

use super::candidates::listed;
use super::measure::{Reached, noise_scale};
use super::refit::{Refit, refit};
use super::settings::Settings;
use crate::case::Case;
use crate::fit::{Basis, Effort, Fit, Point, fit};
use crate::screen::screen;

/// Candidates for the place of the first effect.
pub(super) struct Exchange {
    /// All effects, the new one first; `None` if the old one stays.
    pub(super) fit: Option<Fit>,
    /// Best first, each beside the later effects.
    pub(super) tried: Vec<Refit>,
}

/// Looks for an effect that explains more than the first one does, beside the later ones, whose fit
/// is `without`.
pub(super) fn exchange(
    case: &Case,
    basis: &Basis,
    settings: &Settings,
    (current, without): (&Fit, &Fit),
) -> Exchange {
    let list = listed(case, basis, settings, without);
    let (best, slopes) = screen(case, basis, without, &list, &settings.budget);
    let tried = refit(case, basis, settings, without, (&best, &slopes), list.len());
    let (scale, number) = (noise_scale(current), current.train.number());
    let present = Reached::new(case, current);
    let better = |fit: &Fit| {
        Reached::new(case, fit).gain(&present, scale, number) > settings.criteria.replaces()
    };
    let first = current.hypothesis.terms[0].label();
    let fit = tried
        .first()
        .filter(|rival| rival.term.label() != first && better(&rival.fit))
        .map(|rival| leading(case, basis, settings, &rival.fit))
        .filter(better);
    Exchange { fit, tried }
}

/// The same fit with its last effect in the first place.
fn leading(case: &Case, basis: &Basis, settings: &Settings, at: &Fit) -> Fit {
    let mut hypothesis = at.hypothesis.clone();
    let mut e = at.point.e.clone();
    let Some(last) = hypothesis.terms.pop() else {
        return at.clone();
    };
    e.rotate_right(last.effect.info().parameters.len());
    hypothesis.terms.insert(0, last);
    let point = Point {
        theta: at.point.theta.clone(),
        e,
    };
    fit(
        case,
        basis,
        &hypothesis,
        point,
        Effort::full(settings.budget.steps),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, named, pendulum};
    use crate::diagnosis::Verdict;
    use crate::fit::basis;
    use crate::search::backward::without_each;
    use crate::search::diagnose;

    fn exchanged(hidden: (&[&str], &[f64]), taken: (&[&str], &[f64])) -> Option<(Fit, Vec<Refit>)> {
        let case = pendulum(&named(hidden.0), hidden.1, 6.0, &|_| {});
        let directions = basis(&case);
        let settings = Settings::default();
        let at = Point {
            theta: vec![0.0; SIZE],
            e: taken.1.to_vec(),
        };
        let current = fit(
            &case,
            &directions,
            &named(taken.0),
            at,
            Effort::full(settings.budget.steps),
        );
        let without = without_each(&case, &directions, &settings, &current);
        let found = exchange(&case, &directions, &settings, (&current, &without[0]));
        Some((found.fit?, found.tried))
    }

    #[test]
    fn a_first_effect_that_stood_for_another_is_exchanged() {
        // A spring far from its rest is a constant torque.
        let (fit, tried) = exchanged(
            (&["current_offset", "quadratic_drag"], &[0.1, 0.05]),
            (&["spring", "quadratic_drag"], &[0.01, 0.0, 0.05]),
        )
        .expect("a spring is not the cause");
        let ids: Vec<_> = fit
            .hypothesis
            .terms
            .iter()
            .map(|t| t.effect.info().id)
            .collect();
        assert_eq!(ids, ["current_offset", "quadratic_drag"]);
        assert_eq!(tried[0].term.effect.info().id, "current_offset");
        let e = &fit.point.e;
        assert!((e[0].abs() - 0.1).abs() < 0.01, "{e:?}");
        assert!((e[1] - 0.05).abs() < 0.01, "{e:?}");
    }

    #[test]
    fn a_first_effect_that_is_the_cause_stays() {
        let both = ["spring", "quadratic_drag"];
        let e = [0.9, 0.2, 0.05];
        assert!(exchanged((&both, &e), (&both, &e)).is_none());
    }

    #[test]
    fn friction_that_rises_over_low_speed_is_told_from_friction_that_falls() {
        // Of the second the ratio of static to Coulomb friction is shown.
        for (id, e, shown) in [
            ("saturating_friction", [0.8, 0.3], [0.8, 0.3]),
            ("stribeck", [1.2, 0.3], [2.2, 0.3]),
        ] {
            let case = pendulum(&named(&[id]), &e, 8.0, &|_| {});
            let found = diagnose(&case, &Settings::default());
            let expected = Verdict::Effect {
                id: id.to_owned(),
                joint: Some(1),
            };
            assert_eq!(found.verdict, expected, "{found:?}");
            for (parameter, truth) in found.effects[0].parameters.iter().zip(shown) {
                let off = (parameter.value / truth - 1.0).abs();
                assert!(off < 0.1, "{parameter:?}");
            }
        }
    }
}
