//! What may be set of a search.

use std::sync::Arc;

use super::watch::Watch;
use crate::criteria::{Budget, Criteria};
use crate::effect::Effect;

/// What may be set.
#[derive(Clone)]
pub struct Settings {
    /// The effects considered; [`effects::all`](crate::effects::all) and the user's own.
    pub effects: Vec<Arc<dyn Effect>>,
    /// Whether every candidate is refitted to its end, whatever screening says of it: what
    /// screening is measured against.
    pub refit_all: bool,
    /// Length of the train records that is fitted, s times the number of joints, and half that of
    /// the test records that it is judged by; the parts that decide are taken from longer ones (see
    /// [`excerpt`](crate::excerpt)).
    pub joint_seconds: f64,
    /// What decides the verdict.
    pub criteria: Criteria,
    /// Effort that is spent on it.
    pub budget: Budget,
    /// Who hears of its steps. If asked to stop, a search ends before its next round with what it
    /// has.
    pub watch: Watch,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            effects: crate::effects::all(),
            refit_all: false,
            joint_seconds: 150.0,
            criteria: Criteria::default(),
            budget: Budget::default(),
            watch: Watch::default(),
        }
    }
}
