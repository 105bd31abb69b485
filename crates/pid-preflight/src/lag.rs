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
    let curves = Curves::new(motion, (rigid, friction, gain), active, criteria)?;
    let all: Vec<usize> = (0..active.len()).collect();
    let together = curves.judge(&all).filter(|found| {
        // One clock moves the inputs of all joints alike.
        let near = (curves.each.iter())
            .filter(|s| (**s - found.late).abs() < 0.4 * found.late.abs() + curves.step);
        2 * near.count() > curves.each.len()
    });
    together.or_else(|| {
        let alone = all.iter().filter_map(|&k| curves.judge(&[k]));
        alone
            .max_by(|a, b| a.gain.total_cmp(&b.gain))
            .filter(|_| active.len() > 1)
    })
}

/// Rigid torque, friction and gain of all joints.
type Torques<'a> = (&'a [f64], &'a [Vec<[f64; 2]>], &'a [f64]);

/// Shares left at every active joint over the shifts of its input.
struct Curves<'a> {
    motion: &'a Motion,
    torques: Torques<'a>,
    active: &'a [usize],
    criteria: &'a Criteria,
    /// Longest sample time of the records, s.
    native: f64,
    /// Step of the shifts, s.
    step: f64,
    /// Shifts that are tried, s; the middle one is zero.
    shifts: Vec<f64>,
    /// Share left over the shifts, joint by joint.
    left: Vec<Vec<f64>>,
    /// Best shift of each joint, s.
    each: Vec<f64>,
}

impl<'a> Curves<'a> {
    /// `None` without samples or joints.
    fn new(
        motion: &'a Motion,
        torques: Torques<'a>,
        active: &'a [usize],
        criteria: &'a Criteria,
    ) -> Option<Self> {
        let native = motion.steps.iter().copied().fold(0.0, f64::max);
        if native <= 0.0 || active.is_empty() {
            return None;
        }
        let step = native.max(STEP);
        let count = (FARTHEST / step) as i64;
        let mut curves = Self {
            motion,
            torques,
            active,
            criteria,
            native,
            step,
            shifts: (-count..=count).map(|k| k as f64 * step).collect(),
            left: Vec::new(),
            each: Vec::new(),
        };
        let shifts = &curves.shifts;
        let curve = |&j: &usize| shifts.iter().map(|&s| curves.left_at(j, s)).collect();
        curves.left = active.iter().map(curve).collect();
        curves.each = (curves.left.iter())
            .map(|c| curves.shifts[curves.best_of(c)])
            .collect();
        Some(curves)
    }

    /// Place of no shift.
    fn zero(&self) -> usize {
        self.shifts.len() / 2
    }

    /// Share left at joint `j` with its input taken `late` seconds after the motion.
    fn left_at(&self, j: usize, late: f64) -> f64 {
        let (rigid, friction, gain) = self.torques;
        left_at(
            self.motion,
            (rigid, &friction[j], gain[j]),
            j,
            late,
            self.criteria,
        )
    }

    /// Place of the least value.
    fn best_of(&self, curve: &[f64]) -> usize {
        (0..curve.len())
            .min_by(|&a, &b| curve[a].total_cmp(&curve[b]))
            .unwrap_or(self.zero())
    }

    /// The best shift around a step, at the rate of the record, s.
    fn refined(&self, places: &[usize], around: f64) -> f64 {
        let finest = (self.step / self.native).ceil() as i64;
        let middle = (around / self.native).round() as i64;
        let near = (middle - finest..=middle + finest).map(|k| k as f64 * self.native);
        let sum = |s: f64| -> f64 {
            let at = |k: usize| self.left_at(self.active[k], s).max(f64::MIN_POSITIVE).ln();
            places.iter().map(|&k| at(k)).sum()
        };
        near.map(|s| (sum(s), s))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(around, |(_, s)| s)
    }

    /// One shift of the inputs of several joints, given by their places among the active ones.
    fn judge(&self, places: &[usize]) -> Option<Late> {
        let criteria = self.criteria;
        let log = |x: f64| x.max(FLOOR).ln();
        let sum: Vec<f64> = (0..self.shifts.len())
            .map(|s| places.iter().map(|&k| log(self.left[k][s])).sum())
            .collect();
        let best = self.best_of(&sum);
        let late = self.shifts[best];
        let fall = sum[self.zero()] - sum[best];
        let enough = if late > 0.0 {
            criteria.late
        } else {
            criteria.early
        };
        if late.abs() < enough.max(criteria.lag_rows * self.native) {
            return None;
        }
        let late = self.refined(places, late);
        let gain = fall - criteria.lag_margin * places.len() as f64;
        let left = places
            .iter()
            .map(|&k| self.left[k][best])
            .fold(0.0, f64::max);
        let joints = places.iter().map(|&k| self.active[k]).collect();
        (gain > 0.0).then(|| Late {
            late,
            gain,
            left,
            joints,
            each: self.each.clone(),
            step: self.native,
        })
    }
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
