//! Where a search that takes effects in part stands.

use crate::case::Case;
use crate::fit::{Basis, Fit};
use crate::gap::Gap;

/// Where the taking of effects stands.
#[derive(Debug, Clone)]
pub(super) struct Stand {
    /// With the levels of the errors of the model at hand.
    pub(super) case: Case,
    pub(super) directions: Basis,
    /// The model at hand and its gap.
    pub(super) fit: Fit,
    pub(super) gap: Gap,
}

/// Where the search for effects that pay in predictions ended, before all parameters were fitted to free
/// runs, and the levels of the readings.
#[derive(Debug, Clone)]
pub(super) struct Sought {
    pub(super) stand: Stand,
    pub(super) sensors: Vec<(f64, f64)>,
}
