//! Laws without a fixed shape: a force over the position of a joint, and a gain of its drive over
//! the time.
//!
//! Values at equal distances with straight lines between them give both (C. de Boor, A Practical
//! Guide to Splines, 2001, chapter III). They have no name in the library: if they describe the
//! records better than its effects, the cause is none of these.

use crate::case::Case;
use crate::constants::Constants;
use crate::effect::{
    Class, Commands, Forces, Info, Kind, Law, Model, Parameter, Site, Unit, parameter,
};
use crate::scalar::Scalar;

/// Numbers of positions at which a force is given: few find a faint force, many a sharp one.
const FEW: usize = 13;
const MANY: usize = 25;
/// Times at which a gain is given.
const TIMES: usize = 9;

const FORCE: Parameter = parameter("force", "N*m", Unit::Torque, -10.0, 10.0);
const GAIN: Parameter = parameter("gain", "1", Unit::One, -0.95, 5.0);

static FORCE_OVER_POSITION: Info = Info {
    id: "free_force",
    title: "A force over the position",
    equation: "additional force f(q), straight between its values at equal distances",
    source: "C. de Boor, A Practical Guide to Splines, 2001, chapter III",
    kind: Kind::Force,
    class: Class::Position,
    has_joint: true,
    parameters: &[FORCE; FEW],
    starts: &[&[0.0; FEW]],
    amplitudes: &first::<FEW>(),
    confusions: &[],
    regime: "the positions at which it acts",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

static FINE_FORCE: Info = Info {
    id: "fine_free_force",
    parameters: &[FORCE; MANY],
    starts: &[&[0.0; MANY]],
    amplitudes: &first::<MANY>(),
    ..FORCE_OVER_POSITION
};

static GAIN_OVER_TIME: Info = Info {
    id: "free_gain",
    title: "A gain over the time",
    equation: "u_a = u (1 + g(t)), straight between its values at equal distances",
    kind: Kind::Channel,
    class: Class::Time,
    parameters: &[GAIN; TIMES],
    starts: &[&[0.0; TIMES]],
    amplitudes: &first::<TIMES>(),
    regime: "the trend over t, repeated in every record",
    ..FORCE_OVER_POSITION
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

/// Kind and abscissa of a free law.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Form {
    /// A force on the joint, N m or N, over its position, rad or m.
    ForceOverPosition,
    /// The relative change of its drive's gain over the time since the start of a record, s.
    GainOverTime,
}

/// A free law at any joint.
#[derive(Debug, Clone)]
pub(crate) struct FreeLaw {
    info: &'static Info,
    pub(crate) form: Form,
    /// First and last knot of every joint.
    ends: Vec<(f64, f64)>,
}

/// Smallest interval that holds all of some numbers.
fn hull(x: impl Iterator<Item = f64>) -> (f64, f64) {
    x.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
        (low.min(x), high.max(x))
    })
}

impl FreeLaw {
    /// All of them, with knots over what the records pass through.
    pub(crate) fn all(case: &Case) -> [FreeLaw; 3] {
        let positions: Vec<(f64, f64)> = (0..case.n())
            .map(|j| {
                hull(
                    case.records
                        .iter()
                        .flat_map(|r| r.smooth_q[j].iter().copied()),
                )
            })
            .collect();
        let span = hull(
            case.records
                .iter()
                .flat_map(|r| [r.begin, r.begin + r.h * r.len() as f64]),
        );
        let law = |info, form, ends| FreeLaw { info, form, ends };
        [
            law(
                &FORCE_OVER_POSITION,
                Form::ForceOverPosition,
                positions.clone(),
            ),
            law(&FINE_FORCE, Form::ForceOverPosition, positions),
            law(&GAIN_OVER_TIME, Form::GainOverTime, vec![span; case.n()]),
        ]
    }

    /// The law with an identifier.
    pub(crate) fn by_id(case: &Case, id: &str) -> Option<FreeLaw> {
        FreeLaw::all(case).into_iter().find(|l| l.info.id == id)
    }

    /// Number of cells between the knots.
    fn cells(&self) -> usize {
        self.info.parameters.len() - 1
    }

    /// The knots of a joint.
    pub(crate) fn knots(&self, joint: usize) -> impl Iterator<Item = f64> + use<> {
        let ((first, last), cells) = (self.ends[joint], self.cells());
        (0..=cells).map(move |i| first + (last - first) * i as f64 / cells as f64)
    }

    /// Value of the law; beyond the ends it keeps its last slope.
    fn at<D: Scalar>(&self, e: &[D], (first, last): (f64, f64), x: D) -> D {
        let cells = self.cells();
        let x = (x - first) * (cells as f64 / (last - first).max(1e-9));
        let cell = (x.value().max(0.0) as usize).min(cells - 1);
        e[cell] + (e[cell + 1] - e[cell]) * (x - cell as f64)
    }
}

impl Model for FreeLaw {
    fn info(&self) -> &'static Info {
        self.info
    }
}

impl<D: Scalar> Law<D> for FreeLaw {
    fn input(&self, e: &[D], u: D, at: &Commands<'_>, _memory: &mut [D]) -> D {
        match self.form {
            Form::ForceOverPosition => u,
            Form::GainOverTime => {
                let t = at.begin + at.t + 0.5 * at.dt;
                u * (self.at(e, self.ends[0], D::constant(t)) + 1.0)
            }
        }
    }
    fn force(
        &self,
        e: &[D],
        at: &Site<'_, D>,
        _memory: &[D],
        f: &mut Forces<'_, D>,
        _constants: &Constants<D>,
    ) {
        if self.form == Form::ForceOverPosition {
            f.value[at.joint] += self.at(e, self.ends[at.joint], at.q[at.joint]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, pendulum};
    use crate::hypothesis::Hypothesis;
    use num_dual::Dual64;

    #[test]
    fn slopes_of_the_force_agree_with_differences() {
        let case = pendulum(&Hypothesis::default(), &[], 2.0, &|_| {});
        let law = FreeLaw::all(&case)[0].clone();
        let (first, last) = law.ends[0];
        let e: Vec<f64> = (0..FEW).map(|i| (i as f64).sin()).collect();
        let constants = Constants::<Dual64>::new(&case.nominal, &[Dual64::from(0.0); SIZE]);
        let at = |q: f64, seed: f64| {
            let q = [Dual64::new(q, seed)];
            let nothing = [Dual64::from(0.0)];
            let lifted: Vec<_> = e.iter().map(|&x| Dual64::from(x)).collect();
            let mut value = [Dual64::from(0.0)];
            let mut rate = value;
            let site = Site {
                joint: 0,
                q: &q,
                v: &nothing,
                load: &nothing,
                t: 0.0,
                dt: 1e-3,
                rest: None,
            };
            let mut forces = Forces {
                value: &mut value,
                rate: &mut rate,
            };
            law.force(&lifted, &site, &[], &mut forces, &constants);
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
