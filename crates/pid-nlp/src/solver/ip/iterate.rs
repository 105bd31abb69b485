//! A point with its objective and constraints.

use crate::nlp::Nlp;

/// A point, its objective and its constraint values.
#[derive(Debug, Clone)]
pub(super) struct Iterate {
    pub(super) x: Vec<f64>,
    pub(super) f: f64,
    pub(super) c: Vec<f64>,
    /// ‖c‖₁.
    pub(super) theta: f64,
}

impl Iterate {
    pub(super) fn new(n: usize, m: usize) -> Self {
        Self {
            x: vec![0.0; n],
            f: 0.0,
            c: vec![0.0; m],
            theta: 0.0,
        }
    }

    pub(super) fn evaluate<P: Nlp + ?Sized>(&mut self, problem: &mut P) {
        self.f = problem.objective(&self.x);
        problem.constraints(&self.x, &mut self.c);
        self.theta = self.c.iter().map(|c| c.abs()).sum();
    }

    pub(super) fn is_finite(&self) -> bool {
        self.f.is_finite() && self.theta.is_finite()
    }
}
