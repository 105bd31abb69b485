//! Faults that are planted into clean records. Shared by the test and by `pid-studies faults`.

use std::f64::consts::{PI, TAU};

use pid_data::{Dataset, Experiment};
use pid_interpret::nominal::Nominal;
use pid_preflight::{Channel, Finding, FindingKind, Severity};

/// Kinds of planted faults.
pub(crate) const KINDS: [&str; 15] = [
    "swapped inputs",
    "swapped motion",
    "flipped input",
    "flipped position",
    "flipped velocity",
    "flipped motion",
    "degrees",
    "milliseconds",
    "frozen channel",
    "offset clock",
    "wrapped angle",
    "wrong gravity",
    "milli-units",
    "zero effort",
    "joint order",
];

/// Pseudo-random numbers (splitmix64 of Vigna), so that a case depends on its seed alone.
pub(crate) struct Draws(pub(crate) u64);

impl Draws {
    /// Below `n`.
    pub(crate) fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as usize % n
    }

    /// In 0..1.
    pub(crate) fn share(&mut self) -> f64 {
        self.below(1 << 30) as f64 / f64::from(1u32 << 30)
    }
}

/// What was planted.
pub(crate) struct Planted {
    /// Its kind, of [`KINDS`].
    pub(crate) kind: &'static str,
    /// Its joints, from 1; empty: all.
    pub(crate) joints: Vec<usize>,
    /// Where it is, if not throughout.
    pub(crate) place: String,
    /// The records with it.
    pub(crate) data: Dataset,
    /// The description with it.
    pub(crate) nominal: String,
}

/// Joints that move by more than 0.05 rad or m, from 0.
fn moving(data: &Dataset) -> Vec<usize> {
    let range = |j: usize| {
        let of = |e: &Experiment| {
            let q = e.q.iter().skip(j).step_by(e.nq).copied();
            q.clone().fold(f64::MIN, f64::max) - q.fold(f64::MAX, f64::min)
        };
        data.experiments.iter().map(of).fold(0.0, f64::max)
    };
    (0..data.nq()).filter(|&j| range(j) > 0.05).collect()
}

fn each(x: &mut [f64], n: usize, j: usize, f: impl Fn(&mut f64)) {
    x.iter_mut().skip(j).step_by(n).for_each(f);
}

/// Plants a fault; `None` where the robot or the record cannot have it.
pub(crate) fn plant(
    kind: &'static str,
    clean: &Dataset,
    nominal: &str,
    draws: &mut Draws,
) -> Option<Planted> {
    let n = clean.nq();
    let mut data = clean.clone();
    let mut text = nominal.to_owned();
    let movers = moving(clean);
    let one = *movers.get(draws.below(movers.len().max(1)))?;
    let other = (n > 1).then(|| (one + 1 + draws.below(n - 1)) % n);
    let mut joints = vec![one + 1];
    let mut place = String::new();
    let has_velocity = clean.experiments.iter().all(|e| e.v.is_some());
    match kind {
        "swapped inputs" | "swapped motion" => {
            let other = other?;
            joints = vec![one.min(other) + 1, one.max(other) + 1];
            for e in &mut data.experiments {
                let channels: Vec<&mut Vec<f64>> = if kind == "swapped inputs" {
                    vec![&mut e.u]
                } else {
                    [&mut e.q].into_iter().chain(e.v.as_mut()).collect()
                };
                for x in channels {
                    x.chunks_exact_mut(n).for_each(|row| row.swap(one, other));
                }
            }
        }
        "joint order" => {
            // Two joints or all: a log in the order of the alphabet.
            let other = other?;
            let mut order: Vec<usize> = (0..n).collect();
            order.swap(one, other);
            if n > 2 && draws.below(2) == 0 {
                order.rotate_left(1);
            }
            joints = (0..n).filter(|&j| order[j] != j).map(|j| j + 1).collect();
            for e in &mut data.experiments {
                for x in [&mut e.q, &mut e.u].into_iter().chain(e.v.as_mut()) {
                    for row in x.chunks_exact_mut(n) {
                        let old = row.to_vec();
                        order.iter().enumerate().for_each(|(j, &k)| row[j] = old[k]);
                    }
                }
            }
        }
        "flipped input" => data
            .experiments
            .iter_mut()
            .for_each(|e| each(&mut e.u, n, one, |u| *u = -*u)),
        "flipped position" | "flipped motion" | "flipped velocity" => {
            if kind != "flipped motion" && !has_velocity {
                return None;
            }
            for e in &mut data.experiments {
                if kind != "flipped velocity" {
                    each(&mut e.q, n, one, |q| *q = -*q);
                }
                if let (true, Some(v)) = (kind != "flipped position", e.v.as_mut()) {
                    each(v, n, one, |v| *v = -*v);
                }
            }
        }
        "degrees" => {
            joints = (0..n)
                .filter(|&j| !clean.joints[j].prismatic)
                .map(|j| j + 1)
                .collect();
            for e in &mut data.experiments {
                for x in [&mut e.q].into_iter().chain(e.v.as_mut()) {
                    joints
                        .iter()
                        .for_each(|j| each(x, n, j - 1, |q| *q *= 180.0 / PI));
                }
            }
        }
        "milliseconds" => {
            joints.clear();
            data.experiments
                .iter_mut()
                .for_each(|e| e.t.iter_mut().for_each(|t| *t *= 1e3));
        }
        "frozen channel" => place = freeze(&mut data, one, draws)?,
        "offset clock" => {
            joints.clear();
            // Late by 20 rows or 25 ms at least; early (a delay looks alike up to 30 ms) by 60 ms at least.
            let late = draws.below(3) > 0;
            let seconds = (if late { 0.025 } else { 0.06 }) + 0.1 * draws.share();
            for e in &mut data.experiments {
                let rows = ((seconds / e.sample_time()).round() as usize).max(20);
                let old = e.u.clone();
                let last = e.len() - 1;
                for i in 0..=last {
                    let from = if late {
                        i.saturating_sub(rows)
                    } else {
                        (i + rows).min(last)
                    };
                    e.u[i * n..(i + 1) * n].copy_from_slice(&old[from * n..(from + 1) * n]);
                }
            }
        }
        "wrapped angle" => {
            let hinges = movers.iter().filter(|&&j| !clean.joints[j].prismatic);
            let hinges: Vec<usize> = hinges.copied().collect();
            let one = *hinges.get(draws.below(hinges.len().max(1)))?;
            joints = vec![one + 1];
            // The seam lies within the motion.
            let all = clean
                .experiments
                .iter()
                .flat_map(|e| e.q.iter().skip(one).step_by(n));
            let (low, high) = all.fold((f64::MAX, f64::MIN), |(l, h), &q| (l.min(q), h.max(q)));
            let seam = low + (0.2 + 0.6 * draws.share()) * (high - low);
            for e in &mut data.experiments {
                each(&mut e.q, n, one, |q| {
                    *q = (*q - seam).rem_euclid(TAU) + seam - TAU
                });
            }
        }
        "wrong gravity" => {
            joints.clear();
            let wrong = [
                "[0.0, 0.0, 9.81]",
                "[0.0, 0.0, 9.81]",
                "[9.81, 0.0, 0.0]",
                "[0.0, 9.81, 0.0]",
            ][draws.below(4)];
            text = text.replace("gravity = [0.0, 0.0, -9.81]", &format!("gravity = {wrong}"));
            if text == nominal {
                return None;
            }
        }
        "milli-units" => {
            joints.clear();
            let factor = [1e3, 1e-3][draws.below(2)];
            data.experiments
                .iter_mut()
                .for_each(|e| e.u.iter_mut().for_each(|u| *u *= factor));
        }
        "zero effort" => {
            joints.clear();
            data.experiments.iter_mut().for_each(|e| e.u.fill(0.0));
        }
        _ => return None,
    }
    Some(Planted {
        kind,
        joints,
        place,
        data,
        nominal: text,
    })
}

/// Holds one value of a position, a velocity or an input for 0.3 s of motion in one record, and says where.
fn freeze(data: &mut Dataset, j: usize, draws: &mut Draws) -> Option<String> {
    let n = data.nq();
    let k = draws.below(data.experiments.len());
    let e = &mut data.experiments[k];
    let rows = ((0.3 / e.sample_time()) as usize).max(30);
    let q: Vec<f64> = e.q.iter().skip(j).step_by(n).copied().collect();
    let range =
        q.iter().copied().fold(f64::MIN, f64::max) - q.iter().copied().fold(f64::MAX, f64::min);
    // A freeze of a joint that rests changes nothing: the joint goes a twentieth of its way meanwhile.
    let fits: Vec<usize> = (1..e.len() - rows - 1)
        .filter(|&i| (q[i + rows] - q[i]).abs() > 0.05 * range)
        .collect();
    let start = *fits.get(draws.below(fits.len().max(1)))?;
    let (x, channel) = match (&mut e.v, draws.below(4)) {
        (Some(v), 0) => (v, "dq"),
        (_, 1) => (&mut e.u, "u"),
        _ => (&mut e.q, "q"),
    };
    let held = x[start * n + j];
    (start..start + rows).for_each(|i| x[i * n + j] = held);
    Some(format!(
        "{channel}{} in {rows} rows from {start} of record `{}`",
        j + 1,
        e.name
    ))
}

/// Whether a finding names the planted fault: its kind and its joints.
pub(crate) fn names(finding: &Finding, planted: &Planted) -> bool {
    if finding.severity == Severity::Note {
        return false;
    }
    let joints = planted.joints.is_empty() || finding.joints == planted.joints;
    joints
        && match (&finding.kind, planted.kind) {
            (FindingKind::Swapped { channel, .. }, "swapped inputs") => *channel == Channel::Input,
            (FindingKind::Swapped { channel, .. }, "swapped motion") => *channel == Channel::Motion,
            (FindingKind::Swapped { channel, .. }, "joint order") => *channel == Channel::All,
            (FindingKind::SignFlipped { channel, .. }, "flipped input") => {
                *channel == Channel::Input
            }
            (FindingKind::SignFlipped { channel, .. }, "flipped position") => {
                *channel == Channel::Position
            }
            (FindingKind::SignFlipped { channel, .. }, "flipped velocity") => {
                *channel == Channel::Velocity
            }
            (FindingKind::SignFlipped { channel, or_other }, "flipped motion") => {
                *channel == Channel::Motion || *or_other
            }
            (FindingKind::Unit { channel, unit, .. }, "degrees") => {
                *channel == Channel::Motion && unit == "degrees"
            }
            (FindingKind::TimeUnit { factor }, "milliseconds") => *factor == 1e-3,
            (FindingKind::FrozenChannel, "frozen channel") => true,
            (FindingKind::InputClock { .. }, "offset clock") => true,
            (FindingKind::Wrapped { .. }, "wrapped angle") => true,
            (FindingKind::Gravity { .. }, "wrong gravity") => finding.severity == Severity::Wrong,
            (
                FindingKind::Unit {
                    channel, factor, ..
                },
                "milli-units",
            ) => *channel == Channel::Input && (*factor == 1e3 || *factor == 1e-3),
            (FindingKind::ZeroInput, "zero effort") => true,
            _ => false,
        }
}

/// The description of a text.
pub(crate) fn described(text: &str) -> Nominal {
    Nominal::parse("nominal.toml", text).expect("a drawn description")
}
