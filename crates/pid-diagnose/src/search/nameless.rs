//! A cause without a name: a force over the position of one joint or a gain of its drive over the
//! time, of any shape.
//!
//! Stops, hard points of a cable or a table that is touched are forces over the position that no
//! effect of the library describes; two effects together imitate them well. A drive that fades
//! while its magnets warm up or its supply sags looks like an inertia. Springs, offsets of the
//! torque and ripples of long periods are such laws too, with fewer parameters: where one of them
//! is the cause, they score higher. Where a [`FreeLaw`] scores higher than what is named, it is
//! named wrongly.

use std::sync::Arc;

use super::magnitude::name;
use super::measure::{Reached, noise_scale};
use super::refit::{Refit, refit};
use super::settings::Settings;
use crate::case::Case;
use crate::criteria::{Budget, Criteria};
use crate::diagnosis::Nameless;
use crate::effect::{Effect, Term};
use crate::fit::{Basis, Fit};
use crate::free::FreeLaw;
use crate::screen::{candidates, screen};

/// Refits of the free laws that promise most, in place of all effects, on top of the nominal
/// structure; best first.
pub(super) fn free_laws(
    case: &Case,
    basis: &Basis,
    settings: &Settings,
    base: &Fit,
    joints: impl Fn(usize) -> bool,
) -> Vec<Refit> {
    let library = FreeLaw::all(case).map(|law| -> Arc<dyn Effect> { Arc::new(law) });
    let mut list = candidates(case, &library, &base.hypothesis);
    list.retain(|(term, _)| joints(term.joint));
    let (best, slopes) = screen(case, basis, base, &list, &settings.budget);
    let few = Settings {
        budget: Budget {
            refits: library.len(),
            ..settings.budget.clone()
        },
        ..settings.clone()
    };
    refit(case, basis, &few, base, (&best, &slopes), list.len())
}

/// Whether a joint may be where effects act: theirs, or any if one of them has none.
pub(super) fn concerned(terms: &[Term]) -> impl Fn(usize) -> bool + use<> {
    let own: Option<Vec<usize>> = terms
        .iter()
        .map(|t| t.shown_joint().map(|j| j - 1))
        .collect();
    move |joint| own.as_ref().is_none_or(|own| own.contains(&joint))
}

/// Whether a free law describes the records better than the effects named: only the likelihood and
/// the number of parameters decide, on all records.
pub(super) fn imitated(case: &Case, criteria: &Criteria, named: &Fit, law: &Refit) -> bool {
    let (scale, number) = (noise_scale(named), named.train.number());
    let present = Reached::new(case, named);
    Reached::new(case, &law.fit).gain(&present, scale, number) > criteria.replaces()
}

/// The same for models whose own errors are counted in place of noise; `gain`: Σ N′ ln(S/S₁) over
/// the records of all roles, with the number N′ of independent samples.
pub(super) fn imitated_in_part(
    criteria: &Criteria,
    (named, law): (&Fit, &Refit),
    gain: f64,
    number: f64,
) -> bool {
    let more = law.fit.point.e.len() as f64 - named.point.e.len() as f64;
    gain - more * number.max(2.0).ln() > criteria.replaces()
}

/// What describes the records better than the effects that imitate it.
#[derive(Debug, Clone)]
pub(super) struct Imitated {
    /// The free law.
    pub(super) refit: Refit,
    /// Its gap.
    pub(super) gap: f64,
}

/// A free law as fitted; `None` for what is no free law.
pub(super) fn described(
    case: &Case,
    criteria: &Criteria,
    refit: &Refit,
    explained: f64,
) -> Option<Nameless> {
    let joint = refit.term.joint;
    let law = FreeLaw::by_id(case, refit.term.effect.info().id)?;
    let values = name(case, criteria, &refit.fit).pop()?.parameters;
    Some(Nameless {
        form: law.form,
        joint: joint + 1,
        at: law.knots(joint).collect(),
        values: values.iter().map(|m| m.value).collect(),
        stds: values.iter().map(|m| m.std).collect(),
        explained,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, among_a_dozen, named, pendulum_under};
    use crate::constants::Constants;
    use crate::diagnosis::Verdict;
    use crate::effect::{Class, Commands, Forces, Info, Kind, Law, Model, Site, Unit, parameter};
    use crate::fit::{Effort, Point, basis, fit};
    use crate::free::Form;
    use crate::hypothesis::Hypothesis;
    use crate::scalar::Scalar;

    /// A pendulum that swings and does not turn over.
    fn swung(cause: &Hypothesis, e: &[f64]) -> Case {
        let drive = |record: usize, t: f64| {
            let w = 1.0 + 0.37 * record as f64;
            0.4 * (2.1 * w * t).sin() + 0.3 * (5.3 * w * t).sin() + 0.2 * (9.7 * t).sin()
        };
        pendulum_under(cause, e, 6.0, &|_| {}, &drive)
    }

    /// Records of a cause of the test, effects fitted to them, and the force over the position.
    fn beside(cause: &Hypothesis, e: &[f64], named: (&Hypothesis, &[f64])) -> (Case, Fit, Refit) {
        let case = swung(cause, e);
        let directions = basis(&case);
        let settings = Settings::default();
        let fitted = |hypothesis: &Hypothesis, e: &[f64]| {
            let at = Point {
                theta: vec![0.0; SIZE],
                e: e.to_vec(),
            };
            let effort = Effort::full(settings.budget.steps);
            fit(&case, &directions, hypothesis, at, effort)
        };
        let base = fitted(&Hypothesis::default(), &[]);
        let effects = fitted(named.0, named.1);
        let law = free_laws(&case, &directions, &settings, &base, |_| true).remove(0);
        (case, effects, law)
    }

    /// −k (q − a) beyond a.
    #[derive(Debug)]
    struct Stop;
    static STOP: Info = Info {
        id: "stop",
        parameters: &[
            parameter("stiffness", "N*m/rad", Unit::Stiffness, 0.0, 100.0),
            parameter("from", "rad", Unit::Range, -1.0, 1.0),
        ],
        amplitudes: &[0],
        starts: &[&[0.0, 0.0]],
        title: "",
        equation: "",
        source: "",
        kind: Kind::Force,
        class: Class::Position,
        has_joint: true,
        confusions: &[],
        regime: "",
        equals: &[],
        mujoco: None,
        isaac: None,
        urdf: None,
    };
    impl Model for Stop {
        fn info(&self) -> &'static Info {
            &STOP
        }
    }
    impl<D: Scalar> Law<D> for Stop {
        fn force(
            &self,
            e: &[D],
            at: &Site<'_, D>,
            _memory: &[D],
            f: &mut Forces<'_, D>,
            _constants: &Constants<D>,
        ) {
            let inside = at.q[at.joint] - e[1];
            if inside.value() > 0.0 {
                f.value[at.joint] += -e[0] * inside;
            }
        }
    }
    fn stop() -> Hypothesis {
        Hypothesis::new(vec![Term {
            effect: Arc::new(Stop),
            joint: 0,
        }])
    }

    #[test]
    fn a_stop_is_a_force_over_the_position_and_no_spring() {
        let (k, from) = (3.0, 0.3);
        let spring = named(&["spring"]);
        let (case, effects, law) = beside(&stop(), &[k, from], (&spring, &[0.1, 0.0]));
        assert!(imitated(&case, &Criteria::default(), &effects, &law));
        let force = described(&case, &Criteria::default(), &law, 1.0).expect("a free law");
        let width = force.at[1] - force.at[0];
        let bend = force.bend().expect("a stop bends");
        assert!((bend - from).abs() < width, "{bend}: {force:?}");
        let [.., a, _, b] = force.values[..] else {
            panic!("{force:?}");
        };
        let slope = (b - a) / (2.0 * width);
        assert!((slope / -k - 1.0).abs() < 0.1, "{slope}");
    }

    #[test]
    fn a_stop_is_unknown_and_its_force_is_shown() {
        let (k, from) = (3.0, 0.3);
        let case = swung(&stop(), &[k, from]);
        let d = crate::search::diagnose(&case, &among_a_dozen());
        assert_eq!(d.verdict, Verdict::Unknown);
        let law = d.remainder.and_then(|r| r.nameless);
        let law = law.expect("a force over the position");
        assert_eq!(law.joint, 1);
        assert!(law.explained > 0.97, "{law:?}");
        let free = law.at.iter().zip(&law.values).zip(&law.stds);
        for ((q, force), std) in free.filter(|((q, _), _)| **q < from) {
            let allowed = 4.0 * std.unwrap_or(f64::INFINITY) + 0.1;
            assert!(force.abs() < allowed, "{force} ± {std:?} at {q}");
        }
    }

    /// u (1 − loss (1 − exp(−t/T))).
    #[derive(Debug)]
    struct Fade;
    static FADE: Info = Info {
        id: "fade",
        parameters: &[
            parameter("loss", "1", Unit::One, 0.0, 1.0),
            parameter("time_constant", "s", Unit::Time, 0.1, 100.0),
        ],
        kind: Kind::Channel,
        class: Class::Time,
        ..STOP
    };
    impl Model for Fade {
        fn info(&self) -> &'static Info {
            &FADE
        }
    }
    impl<D: Scalar> Law<D> for Fade {
        fn input(&self, e: &[D], u: D, at: &Commands<'_>, _memory: &mut [D]) -> D {
            let left = (-(e[1].inverse() * at.t)).exponential();
            u * (e[0] * (left - 1.0) + 1.0)
        }
    }

    #[test]
    fn a_drive_that_fades_is_unknown_and_its_gain_is_shown() {
        let (loss, constant) = (0.3, 2.0);
        let fade = Hypothesis::new(vec![Term {
            effect: Arc::new(Fade),
            joint: 0,
        }]);
        let case = swung(&fade, &[loss, constant]);
        let d = crate::search::diagnose(&case, &Settings::default());
        assert_eq!(d.verdict, Verdict::Unknown);
        let law = d.remainder.and_then(|r| r.nameless);
        let law = law.expect("a gain over the time");
        assert_eq!((law.form, law.joint), (Form::GainOverTime, 1));
        assert!(law.explained > 0.97, "{law:?}");
        let faded = |t: f64| loss * (1.0 - (-t / constant).exp());
        let (first, last) = (law.at[0], law.at[law.at.len() - 1]);
        let found = law.values[0] - law.values[law.values.len() - 1];
        let drawn = faded(last) - faded(first);
        assert!((found - drawn).abs() < 0.1 * drawn, "{law:?}");
    }

    #[test]
    fn a_force_over_the_position_that_has_a_name_keeps_it() {
        for (cause, e) in [("spring", &[0.9, 0.2][..]), ("current_offset", &[0.1][..])] {
            let cause = named(&[cause]);
            let (case, effects, law) = beside(&cause, e, (&cause, e));
            assert!(
                !imitated(&case, &Criteria::default(), &effects, &law),
                "{cause:?}"
            );
        }
    }
}
