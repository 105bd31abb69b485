//! Clocks: inputs that are stamped late or early against the motion.

use crate::criteria::Criteria;
use crate::finding::{Channel, Finding, FindingKind, Severity, joints_text, number};
use crate::motion::Motion;
use crate::torque::Sums;

/// Largest shift that is tried, s.
const FARTHEST: f64 = 0.4;
/// Finest step of shifts, s; a record of a lower rate has its own.
const STEP: f64 = 0.004;
/// Share left below which shifts are not compared: that of noise.
const FLOOR: f64 = 1e-3;

/// A shift of the inputs.
#[derive(Debug, Clone)]
pub(crate) struct Late {
    /// Inputs are late by this, s.
    pub(crate) late: f64,
    /// Fall of the sum of logarithms, less the price.
    pub(crate) gain: f64,
    /// Largest share left at the joints it is about.
    pub(crate) left: f64,
    /// Joints, from 0.
    pub(crate) joints: Vec<usize>,
    /// Best shift of each joint, s.
    pub(crate) each: Vec<f64>,
    /// Median sample time, s.
    pub(crate) step: f64,
}

/// The shift of the inputs of all joints, or of one, that explains the torques best, where it is a fault.
pub(crate) fn find(
    motion: &Motion,
    rigid: &[f64],
    friction: &[Vec<[f64; 2]>],
    gain: &[f64],
    active: &[usize],
    criteria: &Criteria,
) -> Option<Late> {
    let native = motion.steps.iter().copied().fold(0.0, f64::max);
    if native <= 0.0 || active.is_empty() {
        return None;
    }
    let step = native.max(STEP);
    let count = (FARTHEST / step) as i64;
    let shifts: Vec<f64> = (-count..=count).map(|k| k as f64 * step).collect();
    let curves: Vec<Vec<f64>> = active
        .iter()
        .map(|&j| {
            shifts
                .iter()
                .map(|&s| left_at(motion, (rigid, &friction[j], gain[j]), j, s, criteria))
                .collect()
        })
        .collect();
    let log = |x: f64| x.max(FLOOR).ln();
    let zero = count as usize;
    let best_of = |curve: &[f64]| {
        (0..curve.len())
            .min_by(|&a, &b| curve[a].total_cmp(&curve[b]))
            .unwrap_or(zero)
    };
    let each: Vec<f64> = curves.iter().map(|c| shifts[best_of(c)]).collect();
    // Around the best step, at the rate of the record.
    let refined = |places: &[usize], around: f64| {
        let finest = (step / native).ceil() as i64;
        let middle = (around / native).round() as i64;
        let near = (middle - finest..=middle + finest).map(|k| k as f64 * native);
        let sum = |s: f64| -> f64 {
            let at = |k: usize| {
                let j = active[k];
                left_at(motion, (rigid, &friction[j], gain[j]), j, s, criteria)
                    .max(f64::MIN_POSITIVE)
                    .ln()
            };
            places.iter().map(|&k| at(k)).sum()
        };
        near.map(|s| (sum(s), s))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(around, |(_, s)| s)
    };
    let judge = |places: &[usize]| -> Option<Late> {
        let sum: Vec<f64> = (0..shifts.len())
            .map(|s| places.iter().map(|&k| log(curves[k][s])).sum())
            .collect();
        let best = best_of(&sum);
        let late = shifts[best];
        let fall = sum[zero] - sum[best];
        let enough = if late > 0.0 {
            criteria.late
        } else {
            criteria.early
        };
        if late.abs() < enough.max(criteria.lag_rows * native) {
            return None;
        }
        let late = refined(places, late);
        let gain = fall - criteria.lag_margin * places.len() as f64;
        let left = places.iter().map(|&k| curves[k][best]).fold(0.0, f64::max);
        let joints = places.iter().map(|&k| active[k]).collect();
        (gain > 0.0).then(|| Late {
            late,
            gain,
            left,
            joints,
            each: each.clone(),
            step: native,
        })
    };
    let all: Vec<usize> = (0..active.len()).collect();
    let together = judge(&all).filter(|found| {
        // One clock moves the inputs of all joints alike.
        let near = each
            .iter()
            .filter(|s| (**s - found.late).abs() < 0.4 * found.late.abs() + step);
        2 * near.count() > each.len()
    });
    together.or_else(|| {
        let alone = all.iter().filter_map(|&k| judge(&[k]));
        alone
            .max_by(|a, b| a.gain.total_cmp(&b.gain))
            .filter(|_| active.len() > 1)
    })
}

/// Share of the torque left at joint `j` with its input taken `late` seconds after the motion.
fn left_at(
    motion: &Motion,
    (rigid, friction, gain): (&[f64], &[[f64; 2]], f64),
    j: usize,
    late: f64,
    criteria: &Criteria,
) -> f64 {
    let n = motion.n;
    let mut sums = Sums::default();
    for (i, &(k, row)) in motion.at.iter().enumerate() {
        let inputs = &motion.inputs[k];
        let rows = (late / motion.steps[k]).round() as i64;
        let Ok(at) = usize::try_from(row as i64 + rows) else {
            continue;
        };
        let Some(u) = inputs.get(at * n + j) else {
            continue;
        };
        let (r, [c, v]) = (rigid[i * n + j], friction[i]);
        if r.is_finite() && u.is_finite() {
            sums.add([r, c, v, 1.0], gain * u);
        }
    }
    sums.fit(criteria.rigid_factor, criteria.offset).left
}

/// Says it.
pub(crate) fn finding(found: &Late, n: usize) -> Finding {
    let joints: Vec<usize> = found.joints.iter().map(|j| j + 1).collect();
    let rows = found.late.abs() / found.step;
    let whole = joints.len() == n || joints.len() > 1;
    let (word, severity) = match (found.late > 0.0, whole) {
        (true, true) => ("later", Severity::Wrong),
        (true, false) => ("later", Severity::Doubtful),
        (false, _) => ("earlier", Severity::Doubtful),
    };
    let who = if whole {
        "the inputs".to_owned()
    } else {
        format!("the input of {}", joints_text(&joints))
    };
    let why = if found.late > 0.0 {
        "two clocks: nothing in a robot makes its input late"
    } else {
        "two clocks, or a long delay between command and motion"
    };
    Finding::new(
        FindingKind::InputClock { late: found.late },
        severity,
        format!(
            "{who} of the record are stamped {} s ({} rows) {word} than the motion: {why}",
            number(found.late.abs()),
            number(rows)
        ),
        format!(
            "move the columns u by {} s, or record with one clock; `--fix` does it",
            number(-found.late)
        ),
    )
    .of(&joints, Channel::Input)
    .with("late by", found.late, "s")
    .with(
        "least of the joints",
        found.each.iter().copied().fold(f64::INFINITY, f64::min),
        "s",
    )
    .with(
        "most of the joints",
        found.each.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        "s",
    )
}
