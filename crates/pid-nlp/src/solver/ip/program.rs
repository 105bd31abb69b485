//! The form in which the method works: equations c(x) = 0 and bounds.

use super::iterate::Iterate;
use crate::nlp::Nlp;

/// A problem with equations only, with the functions that the method needs beyond [`Nlp`].
pub(super) trait Program: Nlp {
    /// Factor from the user's objective to this one.
    fn scale(&self) -> f64 {
        1.0
    }

    /// ‖c‖∞ in the user's units.
    fn violation(&self, c: &[f64]) -> f64 {
        c.iter().fold(0.0, |a, c| a.max(c.abs()))
    }

    /// Number of leading variables that are the user's.
    fn visible(&self) -> usize {
        self.n()
    }

    /// Moves the slacks of a trial point to the values of their rows, as far as the bounds and the
    /// current point allow, and corrects c and θ. Returns false if there are none or nothing
    /// changed.
    fn reset_slacks(&mut self, trial: &mut Iterate, current: &[f64], tau: f64) -> bool {
        let _ = (trial, current, tau);
        false
    }

    /// A point without constraint violation that differs from `x` in auxiliary variables only, if
    /// one exists.
    fn close(&mut self, x: &mut [f64], c: &[f64], mu: f64) -> bool {
        let _ = (x, c, mu);
        false
    }

    /// Objective and constraints of the problem behind a feasibility problem, at its variables.
    fn probe(&mut self, x: &[f64], out: &mut Iterate) {
        out.x.copy_from_slice(x);
        out.evaluate(self);
    }
}
