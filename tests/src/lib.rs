//! Tests across the crates: oracles, end-to-end runs, published figures.
//!
//! Shared by the tests: the records beside the workspace, if there are any, the problem of the
//! paper, and simulated records that no model fits.

pub mod derivatives;
pub mod mismatched;
pub mod two_link;

use pid_data::Experiment;
use pid_fit::transcribe::Track;
pub use pid_records::{beside, shared};

/// A window over a whole record of positions and velocities, to start from the readings, all
/// weights one; `None` without velocities.
pub fn recorded(e: &Experiment) -> Option<Track> {
    let nq = e.q.len() / e.t.len();
    let rows = e.q.chunks_exact(nq).zip(e.v.as_ref()?.chunks_exact(nq));
    let states: Vec<f64> = rows.flat_map(|(q, v)| [q, v].concat()).collect();
    Some(Track {
        t: e.t.clone(),
        measured: states.clone(),
        guess: states,
        u: e.u.clone(),
        weights: vec![1.0; 2 * nq],
    })
}
