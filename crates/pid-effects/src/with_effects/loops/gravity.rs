//! The inputs with which drives make up for gravity, with their derivatives by the positions: the bias at rest of the
//! robot that the drives know.

use std::sync::{Mutex, PoisonError};

use pid_interpret::links;

use crate::constants::Constants;
use crate::nominal::{DriveKnowledge, Nominal};
use crate::scalar::Scalar;
use crate::smooth::Smooth;

/// The robot that the drives know.
pub(super) struct Known {
    nominal: Nominal,
    /// Memory of evaluations, one per thread that evaluates at a time.
    idle: Mutex<Vec<Weights>>,
}

/// Inputs of all joints, and the memory that they take.
pub(super) struct Weights {
    links: links::Work<Smooth>,
    known: DriveKnowledge<Smooth>,
    q: Vec<Smooth>,
    still: Vec<Smooth>,
    bias: Vec<Smooth>,
    /// Per joint.
    value: Vec<f64>,
    /// By the positions, joint by joint.
    slope: Vec<f64>,
    /// By pairs of positions, joint by joint.
    curve: Vec<f64>,
}

/// How many derivatives are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Order {
    Value,
    Slope,
    Curve,
}

impl Known {
    pub(super) fn new(nominal: Nominal) -> Self {
        Self {
            nominal,
            idle: Mutex::default(),
        }
    }

    /// Number of joints.
    pub(super) fn n(&self) -> usize {
        self.nominal.n()
    }

    /// Calls with the inputs at positions; further coordinates are none of the robot's joints.
    pub(super) fn at<R>(&self, q: &[f64], order: Order, work: impl FnOnce(&Weights) -> R) -> R {
        let idle = || self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = idle().pop();
        let mut own = kept.unwrap_or_else(|| Weights::new(&self.nominal));
        own.evaluate(&self.nominal, q, order);
        let out = work(&own);
        idle().push(own);
        out
    }
}

impl Weights {
    fn new(nominal: &Nominal) -> Self {
        let n = nominal.n();
        let (links, known) = Constants::known_to_drives(nominal);
        let none = || vec![Smooth::constant(0.0); n];
        Self {
            links,
            known,
            q: none(),
            still: none(),
            bias: none(),
            value: vec![0.0; n],
            slope: vec![0.0; n * n],
            curve: vec![0.0; n * n * n],
        }
    }

    fn evaluate(&mut self, nominal: &Nominal, q: &[f64], order: Order) {
        let n = self.q.len();
        for (own, q) in self.q.iter_mut().zip(q) {
            *own = Smooth::constant(*q);
        }
        if order == Order::Value {
            self.weigh(nominal);
            for j in 0..n {
                self.value[j] = self.bias[j].0.re / self.known.gains[j];
            }
            return;
        }
        for i in 0..n {
            self.q[i].0.eps1 = 1.0;
            let last = if order == Order::Curve { i } else { 0 };
            for k in 0..=last {
                self.q[k].0.eps2 = 1.0;
                self.weigh(nominal);
                for j in 0..n {
                    let (x, gain) = (self.bias[j].0, self.known.gains[j]);
                    self.value[j] = x.re / gain;
                    self.slope[j * n + i] = x.eps1 / gain;
                    self.curve[(j * n + i) * n + k] = x.eps1eps2 / gain;
                    self.curve[(j * n + k) * n + i] = x.eps1eps2 / gain;
                }
                self.q[k].0.eps2 = 0.0;
            }
            self.q[i].0.eps1 = 0.0;
        }
    }

    /// Forces that hold the robot at rest.
    fn weigh(&mut self, nominal: &Nominal) {
        let at = links::At {
            q: &self.q,
            v: &self.still,
            force: None,
        };
        let programs = &nominal.links;
        programs.evaluate(&mut self.links, &at, Smooth::sine_cosine, &mut self.bias);
    }

    /// Input of a joint, with derivatives by one position and by another.
    pub(super) fn of(&self, joint: usize, i: Option<usize>, k: Option<usize>) -> Smooth {
        let n = self.value.len();
        let slope = |i: Option<usize>| i.map_or(0.0, |i| self.slope[joint * n + i]);
        let mut out = Smooth::constant(self.value[joint]);
        (out.0.eps1, out.0.eps2) = (slope(i), slope(k));
        if let (Some(i), Some(k)) = (i, k) {
            out.0.eps1eps2 = self.curve[(joint * n + i) * n + k];
        }
        out
    }
}
