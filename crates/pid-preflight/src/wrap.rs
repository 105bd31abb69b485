//! Angles that jump by whole turns.

use std::f64::consts::TAU;

use pid_data::{Dataset, Experiment};

use crate::columns::{quantile, spread};
use crate::criteria::Criteria;
use crate::finding::{Channel, Finding, FindingKind, Severity, number};

/// Jumps of a whole turn, of 2π or of 360 where the column is in degrees.
pub(crate) fn check(data: &Dataset, criteria: &Criteria) -> Vec<Finding> {
    let mut out = Vec::new();
    for j in 0..data.nq() {
        if data.joints[j].prismatic {
            continue;
        }
        for turn in [TAU, 360.0] {
            let mut jumps = 0;
            let mut first = None;
            for e in &data.experiments {
                let found = jumps_of(e, j, turn, criteria);
                if let (None, Some(&row)) = (&first, found.first()) {
                    first = Some((e, row));
                }
                jumps += found.len();
            }
            let Some((e, row)) = first else { continue };
            let unit = if turn > 10.0 { "degrees" } else { "rad" };
            let place = format!("record `{}`, row {row}", e.name);
            out.push(
                Finding::new(
                    FindingKind::Wrapped { turn, jumps },
                    Severity::Wrong,
                    format!(
                        "q{} jumps by a whole turn ({} {unit}) {jumps} times: the angle wraps (first: {place})",
                        j + 1,
                        number(turn)
                    ),
                    "unwrap the angle; `--fix` does it",
                )
                .of(&[j + 1], Channel::Position)
                .with("jumps", jumps as f64, "1")
                .with("first jump at", e.t[row], "s"),
            );
            break;
        }
    }
    out
}

/// Rows at which the channel has jumped by about a turn from the reading before, far more than it moves
/// from row to row elsewhere.
fn jumps_of(e: &Experiment, j: usize, turn: f64, criteria: &Criteria) -> Vec<usize> {
    let known = known(e, j);
    let mut steps: Vec<f64> = known.windows(2).map(|w| (w[1].1 - w[0].1).abs()).collect();
    if steps.len() < 10 {
        return Vec::new();
    }
    let step = |k: usize| known.get(k + 1).map_or(0.0, |next| next.1 - known[k].1);
    let whole = |k: usize| (step(k).abs() - turn).abs() < criteria.wrap_share * turn;
    // A fast motion takes several long steps one way, as one in degrees does that is read in rad; a wrap is alone.
    let goes_on = |k: usize, beside: usize| step(beside) * step(k).signum() > 0.5 * turn;
    let alone = |k: usize| !goes_on(k, k + 1) && (k == 0 || !goes_on(k, k - 1));
    let jumps = (0..known.len() - 1)
        .filter(|&k| whole(k) && alone(k))
        .map(|k| known[k + 1].0)
        .collect();
    // A joint that turns half a turn from row to row cannot be told from one that wraps.
    let middle = steps.len() * 9 / 10;
    let usual = *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
    if usual > criteria.wrap_share * turn {
        Vec::new()
    } else {
        jumps
    }
}

/// Rows before which a position jumps and stays: far faster than the joint ever moves, over a part of its
/// range.
pub(crate) fn breaks(e: &Experiment, j: usize, criteria: &Criteria) -> Vec<usize> {
    let q = pid_data::signal::column(&e.q, e.nq, j);
    let speed = |i: usize| ((q[i] - q[i - 1]) / (e.t[i] - e.t[i - 1])).abs();
    let speeds: Vec<f64> = (1..q.len()).map(speed).collect();
    let moving: Vec<f64> = speeds.iter().copied().filter(|s| *s > 0.0).collect();
    let fast = criteria.jump_speed * quantile(&moving, 0.995);
    let far = criteria.jump_way * spread(&q);
    let stays = |i: usize| (1..4).all(|k| q.get(i + k).is_none_or(|x| (x - q[i - 1]).abs() > far));
    let jumps = |i: &usize| speeds[i - 1] > fast && (q[*i] - q[i - 1]).abs() > far && stays(*i);
    (1..q.len()).filter(jumps).collect()
}

/// Says that positions jump.
pub(crate) fn jumps(data: &Dataset, criteria: &Criteria) -> Vec<Finding> {
    let mut out = Vec::new();
    for j in 0..data.nq() {
        let all: Vec<(&Experiment, usize)> = data
            .experiments
            .iter()
            .flat_map(|e| breaks(e, j, criteria).into_iter().map(move |i| (e, i)))
            .collect();
        let Some(&(e, row)) = all.first() else {
            continue;
        };
        let (count, size) = (all.len(), e.q[row * e.nq + j] - e.q[(row - 1) * e.nq + j]);
        out.push(
            Finding::new(
                FindingKind::Jump { count },
                Severity::Doubtful,
                format!("q{} jumps {count} times and stays (first: record `{}`, row {row})", j + 1, e.name),
                "cut the record there: an encoder that was referenced anew, or records that were joined",
            )
            .of(&[j + 1], Channel::Position)
            .with("first jump", size, data.joints[j].unit())
            .with("at", e.t[row], "s"),
        );
    }
    out
}

/// Rows and readings of a position.
fn known(e: &Experiment, j: usize) -> Vec<(usize, f64)> {
    let q = e.q.iter().skip(j).step_by(e.nq).copied().enumerate();
    q.filter(|(_, q)| q.is_finite()).collect()
}

/// Takes the jumps out of a position; returns how many there were.
pub(crate) fn unwrap(e: &mut Experiment, j: usize, turn: f64) -> usize {
    let (mut jumps, mut shift) = (0, 0.0);
    let mut before: Option<f64> = None;
    for i in 0..e.len() {
        let q = &mut e.q[i * e.nq + j];
        if !q.is_finite() {
            continue;
        }
        if let Some(before) = before {
            let turns = ((*q - before) / turn).round();
            if turns != 0.0 {
                shift -= turns * turn;
                jumps += 1;
            }
        }
        before = Some(*q);
        *q += shift;
    }
    jumps
}
