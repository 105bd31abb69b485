//! A cause without a name: a force that depends on the position of one joint, in any way.
//!
//! Stops, hard points of a cable or a table that is touched are forces over the position that no effect of the library describes; two
//! effects together imitate them well. The force is given by its values at 13 or 25 positions and straight lines between them
//! (C. de Boor, A Practical Guide to Splines, 2001, chapter III), without a word on its shape. Springs, offsets of the torque and
//! ripples of long periods are such forces too, with fewer parameters: where one of them is the cause, they score higher. Where the
//! force over the position scores higher than what is named, it is named wrongly.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::magnitude::name;
use super::refit::{Refit, refit};
use super::{Settings, test_value};
use crate::case::Case;
use crate::effect::{
    Effect, Forces, Info, Kind, Law, Model, Parameter, Site, Term, Unit, parameter,
};
use crate::fit::{Basis, Fit};
use crate::plant::Plant;
use crate::scalar::Scalar;
use crate::screen::{candidates, screen};

/// Positions at which the force is given: few find a faint force, many a sharp one.
const FEW: usize = 13;
const MANY: usize = 25;
const VALUE: Parameter = parameter("force", "N*m", Unit::Torque, -10.0, 10.0);

static COARSE: Info = Info {
    id: "position_law",
    title: "A force over the position",
    equation: "additional force f(q), straight between its values at equal distances",
    source: "C. de Boor, A Practical Guide to Splines, 2001, chapter III",
    kind: Kind::Force,
    has_joint: true,
    parameters: &[VALUE; FEW],
    starts: &[&[0.0; FEW]],
    amplitudes: &first::<FEW>(),
    confusions: &[],
    regime: "the positions at which it acts",
    simulator_field: None,
};

static FINE: Info = Info {
    id: "fine_position_law",
    parameters: &[VALUE; MANY],
    starts: &[&[0.0; MANY]],
    amplitudes: &first::<MANY>(),
    ..COARSE
};

/// The first whole numbers.
const fn first<const N: usize>() -> [usize; N] {
    let mut out = [0; N];
    let mut i = 0;
    while i < N {
        out[i] = i;
        i += 1;
    }
    out
}

/// A force over the position of a joint.
#[derive(Debug, Clone)]
struct PositionLaw {
    info: &'static Info,
    /// First and last knot of every joint.
    ends: Vec<(f64, f64)>,
}

impl PositionLaw {
    /// With knots over the positions of all records.
    fn new(case: &Case, info: &'static Info) -> Self {
        let ends = (0..case.n())
            .map(|j| {
                let q = case.records.iter().flat_map(|r| &r.smooth_q[j]);
                q.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &q| {
                    (low.min(q), high.max(q))
                })
            })
            .collect();
        PositionLaw { info, ends }
    }

    /// How many cells the knots bound.
    fn cells(&self) -> usize {
        self.info.parameters.len() - 1
    }

    /// The knots of a joint.
    fn knots(&self, joint: usize) -> impl Iterator<Item = f64> + use<> {
        let ((first, last), cells) = (self.ends[joint], self.cells());
        (0..=cells).map(move |i| first + (last - first) * i as f64 / cells as f64)
    }
}

impl Model for PositionLaw {
    fn info(&self) -> &'static Info {
        self.info
    }
}

impl<D: Scalar> Law<D> for PositionLaw {
    fn force(
        &self,
        e: &[D],
        at: &Site<'_, D>,
        _memory: &[D],
        f: &mut Forces<'_, D>,
        _plant: &Plant<D>,
    ) {
        let (first, last) = self.ends[at.joint];
        let cells = self.cells();
        let x = (at.q[at.joint] - first) * (cells as f64 / (last - first).max(1e-9));
        let cell = (x.value().max(0.0) as usize).min(cells - 1);
        // Beyond the ends it keeps its last slope.
        f.value[at.joint] += e[cell] + (e[cell + 1] - e[cell]) * (x - cell as f64);
    }
}

/// Twice the gain in log-likelihood over what is named, penalties counted, from which the force over the position is the better
/// description.
const BETTER: f64 = 6.0;

/// Refits of the force over the position of each joint, in place of all effects, on top of the nominal structure; best first.
pub(super) fn over_position(
    case: &Case,
    basis: &Basis,
    settings: &Settings,
    base: &Fit,
    joints: impl Fn(usize) -> bool,
) -> Vec<Refit> {
    let library =
        [&COARSE, &FINE].map(|info| -> Arc<dyn Effect> { Arc::new(PositionLaw::new(case, info)) });
    let mut list = candidates(case, &library, &base.hypothesis);
    list.retain(|(term, _)| joints(term.joint));
    let (best, slopes) = screen(case, basis, base, &list);
    let few = Settings {
        refits: library.len(),
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

/// Whether the force over the position describes the records better than the effects named: only the likelihood and the number of
/// parameters decide, on all records.
pub(super) fn imitated(case: &Case, named: &Fit, law: &Refit) -> bool {
    let number = named.train.number();
    let scale = (named.train.objective() / number).max(1.0);
    let cost = |fit: &Fit| {
        (fit.train.evidence() + test_value(case, fit)) / scale
            + fit.point.e.len() as f64 * number.ln()
    };
    cost(&law.fit) < cost(named) - BETTER
}

/// The same for models whose own errors are counted in place of noise; `gain`: Σ N′ ln(S/S₁) over the records of all roles, with
/// the number N′ of independent samples.
pub(super) fn imitated_in_part(named: &Fit, law: &Refit, gain: f64, number: f64) -> bool {
    let more = law.fit.point.e.len() as f64 - named.point.e.len() as f64;
    gain - more * number.max(2.0).ln() > BETTER
}

/// What describes the records better than the effects that imitate it.
pub(super) struct Imitated {
    /// The force over the position.
    pub(super) refit: Refit,
    /// Its gap.
    pub(super) gap: f64,
}

/// A force over the position of a joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PositionForce {
    /// Joint from 1.
    pub joint: usize,
    /// Positions, SI.
    pub positions: Vec<f64>,
    /// Forces there, straight between them, SI.
    pub forces: Vec<f64>,
    /// Standard deviations; `None` where the records do not determine a force.
    pub stds: Vec<Option<f64>>,
    /// Share of the squared gap beyond the floor that it explains on the test records.
    pub explained: f64,
}

impl PositionForce {
    /// As fitted.
    pub(super) fn new(case: &Case, law: &Refit, explained: f64) -> Self {
        let joint = law.term.joint;
        let named = name(case, &law.fit).pop();
        let values = named.map_or_else(Vec::new, |n| n.parameters);
        PositionForce {
            joint: joint + 1,
            positions: PositionLaw::new(case, law.term.effect.info())
                .knots(joint)
                .collect(),
            forces: values.iter().map(|m| m.value).collect(),
            stds: values.iter().map(|m| m.std).collect(),
            explained,
        }
    }

    /// Where it bends most, for certain: the position at which the change of its slope is the largest number of its deviations.
    pub fn bend(&self) -> Option<f64> {
        let bent = |i: usize| {
            let [a, b, c] = [0, 1, 2].map(|k| self.stds[i + k]);
            let f = &self.forces[i..i + 3];
            let std = (a?.powi(2) + 4.0 * b?.powi(2) + c?.powi(2)).sqrt();
            Some((i + 1, (f[2] - 2.0 * f[1] + f[0]).abs() / std.max(1e-300)))
        };
        (0..self.forces.len().saturating_sub(2))
            .filter_map(bent)
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(i, _)| self.positions[i])
    }

    /// In words: which joint, and where it bends.
    pub fn words(&self) -> String {
        let bend = self
            .bend()
            .map_or_else(String::new, |q| format!(", bending most at {q:.3}"));
        format!("a force over the position of joint {}{bend}", self.joint)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{named, pendulum_under};
    use crate::fit::{Effort, Point, basis, fit};
    use crate::plant::PER_JOINT;
    use crate::simulate::Hypothesis;

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
                theta: vec![0.0; PER_JOINT],
                e: e.to_vec(),
            };
            let effort = Effort::full(settings.steps);
            fit(&case, &directions, hypothesis, at, effort)
        };
        let base = fitted(&Hypothesis::default(), &[]);
        let effects = fitted(named.0, named.1);
        let law = over_position(&case, &directions, &settings, &base, |_| true).remove(0);
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
        ..COARSE
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
            _plant: &Plant<D>,
        ) {
            let inside = at.q[at.joint] - e[1];
            if inside.value() > 0.0 {
                f.value[at.joint] += -e[0] * inside;
            }
        }
    }
    fn stop() -> Hypothesis {
        Hypothesis {
            terms: vec![Term {
                effect: Arc::new(Stop),
                joint: 0,
            }],
        }
    }

    #[test]
    fn a_stop_is_a_force_over_the_position_and_no_spring() {
        let (k, from) = (3.0, 0.3);
        let spring = named(&["spring"]);
        let (case, effects, law) = beside(&stop(), &[k, from], (&spring, &[0.1, 0.0]));
        assert!(imitated(&case, &effects, &law));
        let force = PositionForce::new(&case, &law, 1.0);
        let width = force.positions[1] - force.positions[0];
        let bend = force.bend().expect("a stop bends");
        assert!((bend - from).abs() < width, "{bend}: {force:?}");
        let [.., a, _, b] = force.forces[..] else {
            panic!("{force:?}");
        };
        let slope = (b - a) / (2.0 * width);
        assert!((slope / -k - 1.0).abs() < 0.1, "{slope}");
    }

    #[test]
    fn a_stop_is_unknown_and_its_force_is_shown() {
        let (k, from) = (3.0, 0.3);
        let case = swung(&stop(), &[k, from]);
        let d = crate::diagnose::investigate(&case, &Settings::default()).diagnosis;
        assert_eq!((d.effect.as_str(), d.joint), ("unknown", None));
        let law = d.remainder.and_then(|r| r.over_position);
        let law = law.expect("a force over the position");
        assert_eq!(law.joint, 1);
        assert!(law.explained > 0.97, "{law:?}");
        let free = law.positions.iter().zip(&law.forces).zip(&law.stds);
        for ((q, force), std) in free.filter(|((q, _), _)| **q < from) {
            let allowed = 4.0 * std.unwrap_or(f64::INFINITY) + 0.1;
            assert!(force.abs() < allowed, "{force} ± {std:?} at {q}");
        }
    }

    #[test]
    fn a_force_over_the_position_that_has_a_name_keeps_it() {
        for (cause, e) in [("spring", &[0.9, 0.2][..]), ("current_offset", &[0.1][..])] {
            let cause = named(&[cause]);
            let (case, effects, law) = beside(&cause, e, (&cause, e));
            assert!(!imitated(&case, &effects, &law), "{cause:?}");
        }
    }

    #[test]
    fn slopes_of_the_force_agree_with_differences() {
        let case = swung(&Hypothesis::default(), &[]);
        let law = PositionLaw::new(&case, &COARSE);
        let (first, last) = law.ends[0];
        let e: Vec<f64> = (0..FEW).map(|i| (i as f64).sin()).collect();
        let plant = Plant::<num_dual::Dual64>::new(
            &case.nominal,
            &[num_dual::Dual64::from(0.0); PER_JOINT],
        );
        let at = |q: f64, seed: f64| {
            let q = [num_dual::Dual64::new(q, seed)];
            let nothing = [num_dual::Dual64::from(0.0)];
            let lifted: Vec<_> = e.iter().map(|&x| num_dual::Dual64::from(x)).collect();
            let mut value = [num_dual::Dual64::from(0.0)];
            let mut rate = value;
            let site = Site {
                joint: 0,
                q: &q,
                v: &nothing,
                load: &nothing,
                t: 0.0,
                dt: 1e-3,
            };
            let mut forces = Forces {
                value: &mut value,
                rate: &mut rate,
            };
            law.force(&lifted, &site, &[], &mut forces, &plant);
            value[0]
        };
        // Beyond both ends too; never over a knot.
        for i in -2..=(2 * FEW as i32) {
            let q = first + (last - first) * (0.5 * f64::from(i) + 0.26) / (FEW - 1) as f64;
            let h = 1e-5 * (last - first);
            let difference = (at(q + h, 0.0).re - at(q - h, 0.0).re) / (2.0 * h);
            let exact = at(q, 1.0).eps;
            assert!(
                (exact - difference).abs() < 1e-6 * (1.0 + exact.abs()),
                "{q}: {exact} {difference}"
            );
        }
    }
}
