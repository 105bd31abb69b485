//! Tests across the crates: oracles, end-to-end runs, published figures.
//!
//! Shared by the tests: the records beside the workspace, if there are any, the starts of the
//! paper's problem, and simulated records that no model fits.

pub mod derivatives;
pub mod mismatched;
pub mod two_link;

use pid_data::Experiment;
use pid_fit::transcribe::Track;
pub use pid_records::{beside, shared};
use pid_runtime::dynamics::ParamInfo;

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

/// Name in this project of a column of the peers' table of starts.
fn parameter_of(column: &str) -> String {
    match column {
        "k1_1" => "dry_shoulder".into(),
        "k1_2" => "dry_elbow".into(),
        "k2_1" => "viscous_shoulder".into(),
        "k2_2" => "viscous_elbow".into(),
        "k3_1" => "gain_shoulder".into(),
        "k3_2" => "gain_elbow".into(),
        "a_1" => "sharp_shoulder".into(),
        "a_2" => "sharp_elbow".into(),
        other => other.to_lowercase(),
    }
}

/// The starts of a table with a column per parameter, in the model's order; `None` if a column is
/// missing or unreadable.
pub fn starts(table: &str, params: &[ParamInfo]) -> Option<Vec<Vec<f64>>> {
    let mut lines = table.lines();
    let head: Vec<String> = lines.next()?.split(',').map(parameter_of).collect();
    let columns: Option<Vec<usize>> = params
        .iter()
        .map(|p| head.iter().position(|h| *h == p.name))
        .collect();
    let columns = columns?;
    lines
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            columns
                .iter()
                .map(|&c| cells.get(c)?.parse().ok())
                .collect()
        })
        .collect()
}
