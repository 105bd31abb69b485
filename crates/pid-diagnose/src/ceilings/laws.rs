//! One flexible law for every class of cause: a function of one quantity, of any shape.
//!
//! A law is a sum of hats (C. de Boor, A Practical Guide to Splines, 2001, chapter III), one for each
//! knot, whose heights are its parameters; with all of them zero it is absent. Heights are shares of the
//! joint's typical torque, input or range. A level of dry friction does not fall below zero.

use std::sync::LazyLock;

use crate::case::{Case, Scale};
use crate::constants::Constants;
use crate::effect::{
    After, Class, Commands, Forces, Friction, Info, Kind, Law, Model, Parameter, Site, Unit,
    parameter,
};
use crate::scalar::Scalar;

/// Speeds at which a friction is given, over the largest speed: dense where friction bends.
const SPEEDS: [f64; 5] = [0.0, 0.05, 0.15, 0.4, 1.0];
/// Loads, over the typical torque. At no load a friction over the load is one over the speed.
const LOADS: [f64; 4] = [0.0, 0.3, 0.6, 1.0];
/// Distances since the reversal, over the range of motion. Further on it is a friction over the speed.
const DISTANCES: [f64; 5] = [0.0, 0.005, 0.02, 0.08, 0.3];
/// Numbers of knots over the position, the error of its reading, the input, and the time.
const POSITIONS: usize = 17;
const READINGS: usize = 9;
const INPUTS: usize = 9;
const TIMES: usize = 6;
/// Quantities of another joint: its position, its velocity and its load.
const OF_ANOTHER: usize = 3;
/// Largest number of parameters.
const MOST: usize = 96;

const HEIGHT: Parameter = parameter("height", "1", Unit::One, -2.0, 2.0);
static HEIGHTS: [Parameter; MOST] = [HEIGHT; MOST];

/// Descriptions by number of parameters.
static INFOS: LazyLock<Vec<Info>> = LazyLock::new(|| {
    let info = |count: usize| Info {
        id: "class_law",
        title: "A law of a class of causes",
        equation: "f = Σ e_k φ_k",
        source: "C. de Boor, A Practical Guide to Splines, 2001, chapter III",
        kind: Kind::Force,
        class: Class::Position,
        has_joint: true,
        parameters: &HEIGHTS[..count],
        starts: &[],
        amplitudes: &[],
        confusions: &[],
        regime: "",
        equals: &[],
        mujoco: None,
        isaac: None,
        urdf: None,
    };
    (0..=MOST).map(info).collect()
});

/// A flexible law of one class at one joint.
#[derive(Debug, Clone)]
pub(super) struct ClassLaw {
    class: Class,
    joint: usize,
    info: &'static Info,
    /// Typical sizes of all joints.
    scale: Vec<Scale>,
    /// Middle of the motion of all joints.
    middle: Vec<f64>,
    /// Length of the records, s.
    length: f64,
}

impl ClassLaw {
    /// The law of a class at joint `j`; `None` of a class that is no sum of hats, or where the joint has
    /// no other to be coupled with.
    pub(super) fn new(case: &Case, class: Class, j: usize) -> Option<Self> {
        let n = case.n();
        let count = match class {
            Class::Velocity => 2 * SPEEDS.len(),
            Class::Load => 2 * (LOADS.len() - 1) + INPUTS,
            Class::Position => POSITIONS + READINGS,
            Class::Reversal => DISTANCES.len() - 1,
            Class::Time => 2 * TIMES,
            Class::Coupling if n > 1 => OF_ANOTHER * (n - 1),
            _ => return None,
        };
        let middle = |j: usize| {
            let all = case.records.iter().flat_map(|r| &r.smooth_q[j]);
            let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &x| {
                (low.min(x), high.max(x))
            });
            0.5 * (low + high)
        };
        let ends = case.records.iter().map(|r| r.begin + r.h * r.len() as f64);
        Some(ClassLaw {
            class,
            joint: j,
            info: INFOS.get(count)?,
            scale: case.scale.clone(),
            middle: (0..n).map(middle).collect(),
            length: ends.fold(1e-3, f64::max),
        })
    }

    /// Place of joint `i` in its range: −1 to 1.
    fn place<D: Scalar>(&self, i: usize, q: D) -> D {
        (q - self.middle[i]) * (2.0 / self.scale[i].range)
    }

    fn own(&self) -> &Scale {
        &self.scale[self.joint]
    }
}

/// Σ e_k φ_k(x) over knots; beyond the ends the value of the last.
fn over<D: Scalar>(knots: &[f64], e: impl Fn(usize) -> D, x: D) -> D {
    let cell = knots[1..knots.len() - 1].partition_point(|&k| k <= x.value());
    let s = (x - knots[cell]) / (knots[cell + 1] - knots[cell]);
    let s = s.limit(D::nil(), D::constant(1.0));
    e(cell) + (e(cell + 1) - e(cell)) * s
}

/// The same over equal distances from −1 to 1, and its slope: none beyond the ends.
fn equal<D: Scalar>(e: &[D], x: D) -> (D, D) {
    let cells = e.len() - 1;
    let inside = f64::from(u8::from(x.value().abs() <= 1.0));
    let place = (x.limit(D::constant(-1.0), D::constant(1.0)) + 1.0) * (0.5 * cells as f64);
    let cell = (place.value() as usize).min(cells - 1);
    let step = e[cell + 1] - e[cell];
    (
        e[cell] + step * (place - cell as f64),
        step * (0.5 * cells as f64 * inside),
    )
}

/// Adds to both levels of dry friction; none falls below zero.
fn add<D: Scalar>(f: &mut Friction<D>, forward: D, backward: D) {
    let most = D::constant(f64::MAX);
    f.forward = (f.forward + forward).limit(D::nil(), most);
    f.backward = (f.backward + backward).limit(D::nil(), most);
}

impl Model for ClassLaw {
    fn info(&self) -> &'static Info {
        self.info
    }
    fn memory(&self) -> usize {
        // Distance since the reversal, and the direction since.
        2 * usize::from(self.class == Class::Reversal)
    }
}

impl<D: Scalar> Law<D> for ClassLaw {
    fn input(&self, e: &[D], u: D, at: &Commands<'_>, _memory: &mut [D]) -> D {
        match self.class {
            Class::Load => {
                let size = self.own().input;
                u + equal(&e[2 * (LOADS.len() - 1)..], u / size).0 * size
            }
            Class::Time => {
                let t = D::constant(2.0 * (at.begin + at.t) / self.length - 1.0);
                u * (equal(&e[..TIMES], t).0 + 1.0)
            }
            _ => u,
        }
    }

    fn friction(&self, e: &[D], at: &Site<'_, D>, memory: &[D], f: &mut Friction<D>) {
        let torque = self.own().torque;
        match self.class {
            Class::Velocity => {
                let x = at.v[at.joint].magnitude() / self.own().speed;
                let forward = over(&SPEEDS, |k| e[k], x);
                let backward = over(&SPEEDS, |k| e[SPEEDS.len() + k], x);
                add(f, forward * torque, backward * torque);
            }
            Class::Load => {
                let load = at.load[at.joint] / torque;
                let side = load.value().signum();
                // No height stands at no load.
                let height = |from: usize| {
                    move |k: usize| match k {
                        0 => D::nil(),
                        _ => e[from + k - 1],
                    }
                };
                let even = over(&LOADS, height(0), load * side) * torque;
                let odd = over(&LOADS, height(LOADS.len() - 1), load * side) * (torque * side);
                add(f, even + odd, even - odd);
            }
            Class::Reversal => {
                let since = memory[0] / self.own().range;
                // None stands at the last distance.
                let height = |k: usize| e.get(k).copied().unwrap_or(D::nil());
                let extra = over(&DISTANCES, height, since) * torque;
                add(f, extra, extra);
            }
            Class::Time => {
                let t = D::constant(2.0 * at.t / self.length - 1.0);
                let extra = equal(&e[TIMES..], t).0 * torque;
                add(f, extra, extra);
            }
            _ => {}
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
        let torque = self.own().torque;
        match self.class {
            Class::Position => {
                let place = self.place(at.joint, at.q[at.joint]);
                f.value[at.joint] += equal(&e[..POSITIONS], place).0 * torque;
            }
            Class::Coupling => {
                let others = (0..at.q.len()).filter(|&i| i != at.joint);
                for (i, e) in others.zip(e.chunks_exact(OF_ANOTHER)) {
                    let speed = at.v[i] / self.scale[i].speed;
                    let load = at.load[i] / self.scale[i].torque;
                    let sum = e[0] * self.place(i, at.q[i]) + e[1] * speed + e[2] * load;
                    f.value[at.joint] += sum * torque;
                }
            }
            _ => {}
        }
    }

    fn advance(&self, _e: &[D], after: &After<D>, memory: &mut [D]) {
        if self.class == Class::Reversal {
            let v = after.v.value();
            if v * memory[1].value() < 0.0 {
                memory[0] = D::nil();
            }
            memory[0] += after.v.magnitude() * after.dt;
            if v != 0.0 {
                memory[1] = D::constant(v.signum());
            }
        }
    }

    fn sense(&self, e: &[D], q: D, v: D) -> (D, D) {
        if self.class != Class::Position {
            return (q, v);
        }
        let (error, slope) = equal(&e[POSITIONS..], self.place(self.joint, q));
        (q + error * self.own().range, v + v * slope * 2.0)
    }
}
