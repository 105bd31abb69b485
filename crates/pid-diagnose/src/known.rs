//! Effects of a nominal description as the diagnosis takes them.

use pid_interpret::nominal::{self as description, NominalError};

use crate::described::described;
use crate::hypothesis::Hypothesis;

/// Effects that are taken as known: part of every hypothesis, their parameters held.
#[derive(Debug, Clone, Default)]
pub struct Known {
    /// The effects.
    pub hypothesis: Hypothesis,
    /// Their parameters, SI.
    pub e: Vec<f64>,
}

impl Known {
    /// The effects of a description, as the library has them.
    ///
    /// # Errors
    /// If the library has no such effect, a joint or a parameter is missing or too many, a unit is
    /// another, or a value is outside its range: file, line, key, value, mend.
    pub fn of(nominal: &description::Nominal) -> Result<Self, NominalError> {
        let mut known = Known::default();
        for (term, e) in described(nominal)? {
            known.hypothesis.terms.push(term);
            known.e.extend(e);
        }
        Ok(known)
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.hypothesis.terms.is_empty()
    }

    /// The parameters of the effect with an identifier at a joint, if it is known.
    pub fn parameters(&self, id: &str, joint: usize) -> Option<&[f64]> {
        let (starts, _) = self.hypothesis.offsets();
        let mut terms = self.hypothesis.terms.iter().zip(starts);
        let own = terms.find(|(t, _)| t.effect.info().id == id && t.joint == joint);
        own.map(|(t, at)| &self.e[at..at + t.effect.info().parameters.len()])
    }
}
