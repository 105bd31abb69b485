//! What the description states against what the record reaches.

use std::f64::consts::TAU;

use pid_interpret::nominal::Nominal;
use pid_runtime::dynamics::Dynamics;

use crate::columns::quantile;
use crate::criteria::Criteria;
use crate::finding::{Channel, Finding, FindingKind, Severity, number};
use crate::motion::Motion;
use crate::torque::Bench;

/// Share of the limits' width by which a position may pass them unnoticed.
const SLACK: f64 = 0.01;

/// Positions, torques and speeds beyond what is stated.
pub(crate) fn check(
    bench: &Bench,
    nominal: &Nominal,
    motion: &Motion,
    criteria: &Criteria,
) -> Vec<Finding> {
    let mut out = Vec::new();
    for j in 0..motion.n {
        out.extend(positions(bench, motion, j));
        let Some(channel) = nominal.measurement().channels.get(j) else {
            continue;
        };
        let torque: Vec<f64> = motion
            .column(&motion.u, j)
            .map(|u| (bench.gain[j] * u).abs())
            .collect();
        let speed: Vec<f64> = motion.column(&motion.v, j).map(f64::abs).collect();
        let (torque, speed) = (quantile(&torque, 0.999), quantile(&speed, 0.999));
        let unit = if bench.model.joints()[j].prismatic {
            ("N", "m/s")
        } else {
            ("N*m", "rad/s")
        };
        if let Some(stated) = channel
            .torque_peak
            .filter(|s| torque > criteria.above_stated * s)
        {
            let kind = FindingKind::AbovePeak {
                found: torque,
                stated,
            };
            out.push(above(
                kind,
                j,
                Channel::Input,
                "torque",
                (torque, stated),
                unit.0,
                "torque_peak",
            ));
        }
        if let Some(stated) = channel
            .speed_scale
            .filter(|s| speed > criteria.above_stated * s)
        {
            let kind = FindingKind::AboveSpeed {
                found: speed,
                stated,
            };
            out.push(above(
                kind,
                j,
                Channel::Velocity,
                "speed",
                (speed, stated),
                unit.1,
                "speed_scale",
            ));
        }
    }
    out
}

fn above(
    kind: FindingKind,
    j: usize,
    channel: Channel,
    what: &str,
    (found, stated): (f64, f64),
    unit: &str,
    key: &str,
) -> Finding {
    let severity = if found > 10.0 * stated {
        Severity::Doubtful
    } else {
        Severity::Note
    };
    Finding::new(
        kind,
        severity,
        format!(
            "the {what} of joint {} reaches {} {unit}, {} {unit} is stated",
            j + 1,
            number(found),
            number(stated)
        ),
        format!("check {key} and the unit of the columns"),
    )
    .of(&[j + 1], channel)
    .with("reached", found, unit)
    .with("stated", stated, unit)
}

/// Positions outside of the limits, whole turns aside.
fn positions(bench: &Bench, motion: &Motion, j: usize) -> Option<Finding> {
    let joint = &bench.model.joints()[j];
    let (low, high) = joint.limits?;
    let q: Vec<f64> = motion.column(&motion.q, j).collect();
    let (mut from, mut to) = (quantile(&q, 0.001), quantile(&q, 0.999));
    if !joint.prismatic {
        let turns = ((0.5 * (from + to) - 0.5 * (low + high)) / TAU).round() * TAU;
        (from, to) = (from - turns, to - turns);
    }
    let over = (low - from).max(to - high);
    if q.is_empty() || over <= SLACK * (high - low) {
        return None;
    }
    let unit = joint.unit();
    Some(
        Finding::new(
            FindingKind::OutsideLimits {
                reached: [from, to],
                limits: [low, high],
            },
            Severity::Doubtful,
            format!(
                "q{} reaches {} to {} {unit}, the limits are {} to {} {unit}",
                j + 1,
                number(from),
                number(to),
                number(low),
                number(high)
            ),
            "check the zero of the encoder, the sign of the axis and the limits of the description",
        )
        .of(&[j + 1], Channel::Position)
        .with("beyond the limit by", over, unit),
    )
}
