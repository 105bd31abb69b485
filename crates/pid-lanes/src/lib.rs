//! Four numbers at once: the vectors of loops over samples.
//!
//! A [`Lane`] holds one component of [`LANES`] samples. The functions of [`kernel`] work on lanes
//! with the widest vectors that the processor has when the program runs.

pub mod kernel;

/// Number of samples evaluated at once.
pub const LANES: usize = 4;

/// One component of [`LANES`] samples.
pub type Lane = [f64; LANES];
