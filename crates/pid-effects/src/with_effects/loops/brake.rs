//! Motors that brake by the voltage they induce: with a back-EMF k and a motor gain g of a joint its viscous friction is
//!
//! ```text
//! d + g k,     d alone while the drive is off
//! ```
//!
//! It acts behind effects between drive and motor, as the motor does.

use pid_runtime::chain::Group;
use pid_runtime::dynamics::{At, Dims, Hessian};

use super::super::arguments::widened;
use super::drive::{BACK_EMF, Loop, ON};

/// A motor that brakes.
pub(super) struct Brake {
    /// Viscous friction and motor gain among the parameters.
    viscous: usize,
    gain: usize,
    /// The back-EMF, and the input that is zero while the drive is off, in z.
    back_emf: usize,
    on: Option<usize>,
}

/// Number of arguments: friction, gain, back-EMF, and whether the drive is on.
const ARGUMENTS: usize = 4;

impl Brake {
    /// Of a loop, around a model that has friction and gain of its joint as parameters; `None` without a back-EMF.
    pub(super) fn of(own: &Loop, inner: &dyn Hessian) -> Option<Self> {
        let joint = &inner.joints()[own.joint].name;
        let place = |what: &str| {
            let name = format!("{what}_{joint}");
            inner.params().iter().position(|p| p.name == name)
        };
        Some(Self {
            viscous: place("viscous")?,
            gain: place("gain")?,
            back_emf: own.places[BACK_EMF]?,
            on: own.places[ON],
        })
    }

    /// The friction as a function of the outer variables; `before` are the sizes of the model within.
    pub(super) fn group(&self, before: &Dims, dims: &Dims) -> Group {
        let outer = |parameter: usize| Some(widened(before, dims, before.p() + parameter));
        let arguments = vec![
            outer(self.viscous),
            outer(self.gain),
            Some(self.back_emf),
            self.on,
        ];
        Group {
            replaces: vec![before.p() + self.viscous],
            arguments,
        }
    }

    /// Gain, back-EMF, and 1 while the drive is on.
    fn at(&self, at: &At<'_>, dims: &Dims) -> [f64; 3] {
        let on = self.on.map_or(1.0, |z| at.u[z - dims.u()]);
        [at.p[self.gain], at.p[self.back_emf - dims.p()], on]
    }

    /// Adds what the motor brakes by to the friction among the parameters of the model within.
    pub(super) fn put(&self, at: &At<'_>, dims: &Dims, p: &mut [f64]) {
        let [gain, k, on] = self.at(at, dims);
        p[self.viscous] += gain * k * on;
    }

    /// Slopes of the friction by its arguments.
    pub(super) fn gradient(&self, at: &At<'_>, dims: &Dims) -> [f64; ARGUMENTS] {
        let [gain, k, on] = self.at(at, dims);
        [1.0, k * on, gain * on, gain * k]
    }

    /// Second derivatives times a weight, the lower triangle.
    pub(super) fn curvature(
        &self,
        at: &At<'_>,
        dims: &Dims,
        weight: f64,
    ) -> [f64; ARGUMENTS * ARGUMENTS] {
        let [gain, k, on] = self.at(at, dims);
        let mut out = [0.0; ARGUMENTS * ARGUMENTS];
        for (row, column, x) in [(2, 1, on), (3, 1, k), (3, 2, gain)] {
            out[row * ARGUMENTS + column] = weight * x;
        }
        out
    }
}
