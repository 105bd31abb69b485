//! A term at its joint.

use crate::dynamics::{At, Dims};
use crate::term::{ARGUMENTS, Law, SHAPE};

/// A term at its joint.
#[derive(Debug, Clone)]
pub(super) struct Term {
    pub(super) law: Law,
    /// One joint, or two whose sum the motor turns with.
    pub(super) joints: Vec<usize>,
    /// Position of the input in `u`.
    pub(super) input: Option<usize>,
    pub(super) rest: f64,
    /// Position of the coefficient and of the shape parameter in `p`.
    pub(super) coefficient: usize,
    pub(super) shape: Option<usize>,
}

impl Term {
    /// The arguments of φ.
    pub(super) fn arguments(&self, at: &At<'_>) -> [f64; ARGUMENTS] {
        let sum = |x: &[f64]| self.joints.iter().map(|&j| x[j]).sum::<f64>();
        let depends = self.law.depends();
        [
            if depends[0] { sum(at.v) } else { 0.0 },
            if depends[1] { sum(at.a) } else { 0.0 },
            match self.input {
                Some(i) if depends[2] => at.u[i],
                _ => 0.0,
            },
            self.shape.map_or(0.0, |s| at.p[s]),
        ]
    }

    /// Positions in z of an argument of φ, each with derivative 1.
    pub(super) fn places(&self, argument: usize, dims: Dims) -> Vec<usize> {
        match argument {
            0 => self.joints.iter().map(|j| dims.v() + j).collect(),
            1 => self.joints.iter().map(|j| dims.a() + j).collect(),
            2 => self.input.iter().map(|i| dims.u() + i).collect(),
            _ => self.shape.iter().map(|s| dims.p() + s).collect(),
        }
    }

    /// The force against the motion, N or N·m.
    pub(super) fn force(&self, at: &At<'_>) -> f64 {
        at.p[self.coefficient] * self.law.value(self.arguments(at), self.rest)
    }
}

/// Position of the shape parameter among φ's arguments.
const _: () = assert!(SHAPE == ARGUMENTS - 1);
