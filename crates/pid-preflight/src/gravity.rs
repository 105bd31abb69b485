//! Gravity: the vector that the torques ask for, and the torque at rest.

use nalgebra::{DMatrix, DVector};
use pid_interpret::nominal::{Nominal, Role};

use crate::columns::quantile;
use crate::criteria::Criteria;
use crate::finding::{Channel, Finding, FindingKind, Severity, number};
use crate::motion::Motion;
use crate::open;
use crate::torque::{Bench, Fit, Torques, fit, friction};

/// Weight of the stated vector, over the largest information that the record gives on a component: what the
/// record does not tell stays as stated.
const PRIOR: f64 = 1e-3;
/// Speed at rest, over the 95 % quantile.
const REST: f64 = 0.02;
/// Points at rest that are needed.
const FEWEST: usize = 30;

/// The fitted vector where it lies off the stated one.
pub(crate) fn check(
    bench: &Bench,
    motion: &Motion,
    torques: &Torques,
    base: &[Fit],
    criteria: &Criteria,
) -> Option<Finding> {
    let stated = bench.stated();
    let size = stated.iter().map(|g| g * g).sum::<f64>().sqrt();
    if torques.unit.is_empty() || size == 0.0 {
        return None;
    }
    let found = fitted(bench, motion, torques, base, criteria)?;
    let length = found.iter().map(|g| g * g).sum::<f64>().sqrt();
    let cosine = found.iter().zip(stated).map(|(a, b)| a * b).sum::<f64>() / (size * length);
    let angle = cosine.clamp(-1.0, 1.0).acos();
    if angle < criteria.gravity_note || !angle.is_finite() {
        return None;
    }
    let severity = if angle > criteria.gravity_doubtful {
        Severity::Doubtful
    } else {
        Severity::Note
    };
    Some(
        Finding::new(
            FindingKind::Gravity { stated, found },
            severity,
            format!("gravity that fits the torques lies {} degrees off the stated one", number(angle.to_degrees())),
            "check how the base stands; a tilted base, an encoder offset, a payload or a spring looks alike, and the diagnosis tells them apart",
        )
        .with("angle", angle, "rad")
        .with("fitted over stated size", length / size, "1"),
    )
}

/// Least squares of gravity and of friction per joint; equations weighted by what is left at the joint.
fn fitted(
    bench: &Bench,
    motion: &Motion,
    torques: &Torques,
    base: &[Fit],
    criteria: &Criteria,
) -> Option<[f64; 3]> {
    let n = motion.n;
    let width = 3 + 2 * n;
    let (mut a, mut b) = (
        DMatrix::<f64>::zeros(width, width),
        DVector::<f64>::zeros(width),
    );
    let stated = bench.stated();
    let rigid = torques.with(stated);
    for j in (0..n).filter(|&j| base[j].size > 0.0 && base[j].left < criteria.explained) {
        let weight = 1.0 / (base[j].size * base[j].left.max(1e-4).sqrt());
        for (i, f) in friction(motion, j).iter().enumerate() {
            let at = i * n + j;
            let y = bench.gain[j] * motion.u[at] - rigid[at];
            let columns = [
                torques.unit[0][at],
                torques.unit[1][at],
                torques.unit[2][at],
                f[0],
                f[1],
            ];
            if !y.is_finite() || columns.iter().any(|x| !x.is_finite()) {
                continue;
            }
            let places = [0, 1, 2, 3 + 2 * j, 4 + 2 * j];
            for (x, &r) in columns.iter().zip(&places) {
                b[r] += weight * weight * x * y;
                for (z, &c) in columns.iter().zip(&places) {
                    a[(r, c)] += weight * weight * x * z;
                }
            }
        }
    }
    let prior = PRIOR * (0..3).map(|k| a[(k, k)]).fold(0.0, f64::max);
    if prior <= 0.0 {
        return None;
    }
    for k in 0..width {
        a[(k, k)] += if k < 3 {
            prior
        } else {
            1e-9 * a[(k, k)] + 1e-12
        };
    }
    let change = a.cholesky()?.solve(&b);
    Some([0, 1, 2].map(|k| stated[k] + change[k]))
}

/// Joints whose torque at rest is neither that of gravity nor within dry friction.
pub(crate) fn at_rest(
    bench: &Bench,
    nominal: &Nominal,
    motion: &Motion,
    rigid: &[f64],
    base: &[Fit],
) -> Vec<Finding> {
    let open = open::squares(bench, motion);
    let n = motion.n;
    let mut out = Vec::new();
    let speeds: Vec<f64> = (0..n)
        .map(|j| {
            quantile(
                &motion
                    .column(&motion.v, j)
                    .map(f64::abs)
                    .collect::<Vec<_>>(),
                0.95,
            )
        })
        .collect();
    let resting: Vec<usize> = (0..motion.len())
        .filter(|i| (0..n).all(|j| motion.v[i * n + j].abs() <= REST * speeds[j]))
        .collect();
    if resting.len() < FEWEST {
        return out;
    }
    for j in 0..n {
        let size = base[j].size;
        let dry = nominal
            .tolerances()
            .iter()
            .find(|t| t.joint == Some(j) && t.role == Role::Coulomb);
        let dry = dry
            .map_or(0.0, |t| t.nominal + t.half_width)
            .max(1.5 * base[j].x[1]);
        let differences: Vec<f64> = resting
            .iter()
            .map(|i| bench.gain[j] * motion.u[i * n + j] - rigid[i * n + j])
            .collect();
        let middle = quantile(&differences, 0.5);
        // Three deviations of what the tolerances leave open.
        let excess = middle.abs() - dry - 3.0 * open[j].sqrt();
        if excess > 0.2 * size && size > 0.0 {
            out.push(
                Finding::new(
                    FindingKind::RestTorque { excess: middle },
                    Severity::Doubtful,
                    format!(
                        "at rest the torque of joint {} is {} off that of gravity, more than dry friction can hold",
                        j + 1,
                        number(middle)
                    ),
                    "a payload, a spring, an offset of the input or of the encoder; the diagnosis tells them apart",
                )
                .of(&[j + 1], Channel::Input)
                .with("torque at rest less gravity", middle, "N*m or N")
                .with("dry friction at most", dry, "N*m or N")
                .with("points at rest", resting.len() as f64, "1"),
            );
        }
    }
    out
}

/// Share of the torque of gravity that inertia and friction do not balance, at the worst joint that moves;
/// `None` where no joint moves under gravity.
pub(crate) fn left_of_free_motion(
    bench: &Bench,
    motion: &Motion,
    torques: &Torques,
    criteria: &Criteria,
) -> Option<f64> {
    let stated = bench.stated();
    let all = torques.with(stated);
    let moving = (0..motion.n).filter(|&j| motion.moves(j));
    let left = moving.filter_map(|j| {
        let inertia = motion.column(&torques.rigid, j);
        let gravity = motion
            .column(&all, j)
            .zip(inertia.clone())
            .map(|(all, rest)| rest - all);
        let found = fit(inertia, &friction(motion, j), gravity, criteria);
        (found.size > 0.0).then_some(found.left)
    });
    left.max_by(f64::total_cmp)
}
