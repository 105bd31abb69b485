//! What is simulated and fitted: the effects beside the nominal structure.

use crate::effect::Term;

/// A hypothesis: the effects present beside the nominal structure, and how it is run.
#[derive(Debug, Clone, Default)]
pub struct Hypothesis {
    /// The effects, in order.
    pub terms: Vec<Term>,
    /// How it is run.
    pub run: Run,
}

/// How a hypothesis is run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    /// Factor on the number of substeps; 1 unless a fit is finished with finer ones.
    pub finer: usize,
    /// Whether substeps are as short as those of a gear.
    pub short: bool,
    /// Whether the states at the start that no sensor reads are estimated.
    pub initial_states: bool,
}

impl Default for Run {
    fn default() -> Self {
        Run {
            finer: 1,
            short: false,
            initial_states: false,
        }
    }
}

impl Run {
    /// As usual with the shortness of its substeps.
    pub fn plain(self) -> Run {
        Run {
            short: self.short,
            ..Run::default()
        }
    }

    /// As fine as either of two asks for.
    pub fn beside(self, other: Run) -> Run {
        Run {
            finer: self.finer.max(other.finer),
            short: self.short || other.short,
            initial_states: self.initial_states || other.initial_states,
        }
    }
}

impl Hypothesis {
    /// Of effects, run as usual.
    pub fn new(terms: Vec<Term>) -> Self {
        Hypothesis {
            terms,
            run: Run::default(),
        }
    }

    /// Position of the first parameter of each term, and their number.
    pub fn offsets(&self) -> (Vec<usize>, usize) {
        let mut next = 0;
        let starts = self
            .terms
            .iter()
            .map(|t| {
                let at = next;
                next += t.effect.info().parameters.len();
                at
            })
            .collect();
        (starts, next)
    }
}
