//! What a regression can be asked for.

use pid_runtime::dynamics::Dynamics;
use pid_runtime::memory::Memory;

use crate::ident::assumptions::Assumptions;
use crate::regress::record::Filtering;
use crate::regress::solution::JointWeights;
use crate::regress::unknowns::Payload;
use crate::transcribe::Loss;
use crate::wrap::controllers::Controllers;

/// What can be chosen.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Filters.
    pub filtering: Filtering,
    /// Whether the cut-off is chosen by left-out training records; that of `filtering` then does not count.
    pub choose_filter: bool,
    /// Names of parameters held at their start.
    pub hold: Vec<String>,
    /// Linear parameters of which every training record has its own value; `*` stands for any
    /// characters. Other records take the mean.
    pub private: Vec<String>,
    /// A body fixed to a link in some records.
    pub payload: Option<Payload>,
    /// Standard deviation of the gain of each joint's drive, as a share of it; empty where they are
    /// known. It enters the deviations of the combinations, not the intervals of the bootstrap.
    pub gains: Vec<f64>,
    /// How the joints are weighed.
    pub weights: JointWeights,
    /// Loss of residuals in units of their own deviation (1.4826 of their median).
    pub loss: Loss,
    /// Prior knowledge: parameter of the model (or `payload_m` …), mean, standard deviation.
    pub priors: Vec<(String, f64, f64)>,
    /// A joint rests below this multiple of the transition velocity v₀; its rows are then left out
    /// of the fit, but not of the judgement. 0 keeps all rows. `None` is 2, or 0 with friction that
    /// has a memory: rows at rest tell it from Coulomb friction.
    pub rest: Option<f64>,
    /// States of friction with a memory, which the model takes as its last inputs
    /// ([`pid_runtime::extend::Extended::memories`]).
    pub memories: Vec<Memory>,
    /// The controllers of the records, for instrumental variables in place of least squares.
    pub instruments: Option<Controllers>,
    /// Further values of all parameters to judge in the same way, with their names.
    pub judge: Vec<(String, Vec<f64>)>,
    /// Whether shape parameters (Stribeck velocities) are sought, or held at their start.
    pub shapes: bool,
    /// Whether physically consistent values are sought.
    pub consistent: bool,
    /// Random poses for the check of the mass matrix.
    pub poses: usize,
    /// Draws of the block bootstrap; 0 for none.
    pub bootstrap: usize,
    /// Seed of poses and bootstrap.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            filtering: Filtering::default(),
            choose_filter: false,
            hold: Vec::new(),
            private: Vec::new(),
            payload: None,
            gains: Vec::new(),
            weights: JointWeights::Variance,
            loss: Loss::Square,
            priors: Vec::new(),
            rest: None,
            memories: Vec::new(),
            instruments: None,
            judge: Vec::new(),
            shapes: true,
            consistent: true,
            poses: 10_000,
            bootstrap: 0,
            seed: 0,
        }
    }
}

impl Options {
    /// Takes over held values, priors and the loss of assumptions; stated values go to `start`.
    pub fn assume(&mut self, assumed: Assumptions, model: &dyn Dynamics, start: &mut [f64]) {
        let name = |j: usize| model.params()[j].name.to_string();
        self.hold.extend(assumed.hold.iter().map(|&j| name(j)));
        self.loss = assumed.likelihood.loss;
        let stated = assumed.likelihood.priors.iter();
        self.priors
            .extend(stated.map(|p| (name(p.parameter), p.mean, p.deviation)));
        for (j, value) in assumed.values {
            start[j] = value;
        }
    }
}
