//! The inputs with which drives make up for gravity and inertia, with their derivatives: bias at rest and mass matrix
//! of the robot that the drives know, at the positions that they read.

use std::sync::{Mutex, PoisonError};

use pid_interpret::links;

use crate::constants::Constants;
use crate::nominal::{DriveKnowledge, Nominal};
use crate::scalar::Scalar;
use crate::smooth::Smooth;

/// The robot that the drives know.
pub(super) struct Known {
    nominal: Nominal,
    /// Whether its mass matrix is wanted.
    inertia: bool,
    /// Memory of evaluations, one per thread that evaluates at a time.
    idle: Mutex<Vec<Fed>>,
}

/// What a feed-forward depends on, as an argument of a loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Read {
    /// The position that the loop of a joint reads, which moves by a factor of the argument.
    Position(usize, f64),
    /// The acceleration of the target of a joint.
    Acceleration(usize),
}

/// How many derivatives are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Order {
    Value,
    Slope,
    Curve,
}

/// Quantities with their derivatives by positions.
struct Curved {
    n: usize,
    value: Vec<f64>,
    /// By the positions, quantity by quantity.
    slope: Vec<f64>,
    /// By pairs of positions, quantity by quantity.
    curve: Vec<f64>,
}

impl Curved {
    fn new(quantities: usize, n: usize) -> Self {
        Self {
            n,
            value: vec![0.0; quantities],
            slope: vec![0.0; quantities * n],
            curve: vec![0.0; quantities * n * n],
        }
    }

    /// Notes quantities with the derivatives by the positions `i` and `k`.
    fn note(&mut self, all: &[Smooth], (i, k): (usize, usize)) {
        for (e, Smooth(x)) in all.iter().enumerate() {
            let own = e * self.n;
            self.value[e] = x.re;
            self.slope[own + i] = x.eps1;
            self.curve[(own + i) * self.n + k] = x.eps1eps2;
            self.curve[(own + k) * self.n + i] = x.eps1eps2;
        }
    }

    /// A quantity with the derivatives by one argument and by another.
    fn of(&self, e: usize, a: Option<Read>, b: Option<Read>) -> Smooth {
        let by = |read: Option<Read>| match read {
            Some(Read::Position(i, factor)) => Some((i, factor)),
            _ => None,
        };
        let (a, b) = (by(a), by(b));
        let slope = |by: Option<(usize, f64)>| {
            by.map_or(0.0, |(i, factor)| factor * self.slope[e * self.n + i])
        };
        let mut out = Smooth::constant(self.value[e]);
        (out.0.eps1, out.0.eps2) = (slope(a), slope(b));
        if let (Some((i, f)), Some((k, g))) = (a, b) {
            out.0.eps1eps2 = f * g * self.curve[(e * self.n + i) * self.n + k];
        }
        out
    }
}

/// Inputs of all joints, and the memory that they take.
pub(super) struct Fed {
    links: links::Work<Smooth>,
    known: DriveKnowledge<Smooth>,
    q: Vec<Smooth>,
    still: Vec<Smooth>,
    bias: Vec<Smooth>,
    /// Forces that hold the robot, per joint.
    held: Curved,
    /// The lower triangle of the mass matrix, row by row; empty where it is not wanted.
    mass: Curved,
    /// Accelerations of the targets.
    acceleration: Vec<f64>,
}

impl Known {
    pub(super) fn new(nominal: Nominal, inertia: bool) -> Self {
        Self {
            nominal,
            inertia,
            idle: Mutex::default(),
        }
    }

    /// Number of joints.
    pub(super) fn n(&self) -> usize {
        self.nominal.n()
    }

    /// Calls with the inputs at what the loop of each joint reads: its position and the acceleration of its target.
    pub(super) fn at<R>(
        &self,
        reads: impl Fn(usize) -> (f64, f64),
        order: Order,
        work: impl FnOnce(&Fed) -> R,
    ) -> R {
        let idle = || self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = idle().pop();
        let mut own = kept.unwrap_or_else(|| Fed::new(&self.nominal, self.inertia));
        for j in 0..own.q.len() {
            let (q, acceleration) = reads(j);
            (own.q[j], own.acceleration[j]) = (Smooth::constant(q), acceleration);
        }
        own.evaluate(&self.nominal, order);
        let out = work(&own);
        idle().push(own);
        out
    }
}

impl Fed {
    fn new(nominal: &Nominal, inertia: bool) -> Self {
        let n = nominal.n();
        let (links, known) = Constants::known_to_drives(nominal);
        let none = || vec![Smooth::constant(0.0); n];
        let entries = if inertia { n * (n + 1) / 2 } else { 0 };
        Self {
            links,
            known,
            q: none(),
            still: none(),
            bias: none(),
            held: Curved::new(n, n),
            mass: Curved::new(entries, n),
            acceleration: vec![0.0; n],
        }
    }

    fn evaluate(&mut self, nominal: &Nominal, order: Order) {
        let last = |i: usize| if order == Order::Curve { i } else { 0 };
        let rows = if order == Order::Value {
            1
        } else {
            self.q.len()
        };
        let seed = if order == Order::Value { 0.0 } else { 1.0 };
        for i in 0..rows {
            self.q[i].0.eps1 = seed;
            for k in 0..=last(i) {
                self.q[k].0.eps2 = seed;
                self.at_rest(nominal);
                self.held.note(&self.bias, (i, k));
                let entries = self.mass.value.len();
                self.mass.note(&self.links.mass()[..entries], (i, k));
                self.q[k].0.eps2 = 0.0;
            }
            self.q[i].0.eps1 = 0.0;
        }
    }

    /// Forces that hold the robot at rest, and its mass matrix.
    fn at_rest(&mut self, nominal: &Nominal) {
        let at = links::At {
            q: &self.q,
            v: &self.still,
            force: None,
        };
        let programs = &nominal.links;
        programs.evaluate(&mut self.links, &at, Smooth::sine_cosine, &mut self.bias);
    }

    /// Input of a joint that holds it against gravity, with derivatives by one argument and by another.
    pub(super) fn gravity(&self, joint: usize, a: Option<Read>, b: Option<Read>) -> Smooth {
        self.held.of(joint, a, b) / self.known.gains[joint]
    }

    /// Input of a joint that accelerates it as the targets are, with derivatives by one argument and by another.
    pub(super) fn inertia(&self, joint: usize, a: Option<Read>, b: Option<Read>) -> Smooth {
        let acceleration = |i: usize| {
            let mut out = Smooth::constant(self.acceleration[i]);
            let own = |by: Option<Read>| f64::from(u8::from(by == Some(Read::Acceleration(i))));
            (out.0.eps1, out.0.eps2) = (own(a), own(b));
            out
        };
        let mut force = acceleration(joint) * self.known.rotors[joint];
        for i in 0..self.acceleration.len() {
            let (row, column) = (i.max(joint), i.min(joint));
            force += self.mass.of(row * (row + 1) / 2 + column, a, b) * acceleration(i);
        }
        force / self.known.gains[joint]
    }
}
