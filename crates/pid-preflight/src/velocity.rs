//! Recorded velocities against the slopes of the positions: order, sign, unit.

use std::f64::consts::{PI, TAU};

use pid_data::Dataset;

use crate::clock;
use crate::contest::Contest;
use crate::criteria::{Criteria, Settings};
use crate::faults::{flipped, swapped, unit_finding};
use crate::finding::{Channel, Finding, FindingKind, Severity, number};
use crate::motion::Motion;
use crate::torque::Bench;

/// Velocity over slope of the position, factor to SI, unit, and whether the position is in it.
const UNITS: [(f64, f64, &str, bool); 8] = [
    (180.0 / PI, PI / 180.0, "degrees per second", false),
    (PI / 180.0, PI / 180.0, "degrees", true),
    (1e3, 1e-3, "thousandths (mrad/s, mm/s)", false),
    (1e-3, 1e-3, "thousandths (mrad, mm)", true),
    (30.0 / PI, PI / 30.0, "revolutions per minute", false),
    (1.0 / TAU, TAU, "revolutions per second", false),
    (TAU, TAU, "turns", true),
    (
        1e-3 * 180.0 / PI,
        1e3 * PI / 180.0,
        "kilodegrees per second",
        false,
    ),
];
/// A ratio is that of a unit within this factor: velocities follow slopes closely.
const WIDTH: f64 = 1.25;
/// Median step of time from which a ratio of 1000 is one of time, s: robots are not read once in 0.1 s.
const SLOW: f64 = 0.1;

/// Moments of the recorded velocities with the slopes.
struct Moments {
    /// Correlation of velocity `i` with slope `j`.
    correlation: Vec<Vec<f64>>,
    /// Velocity over slope of each joint.
    ratio: Vec<f64>,
    /// Joints with a recorded velocity that move.
    there: Vec<usize>,
}

fn moments(motion: &Motion) -> Moments {
    let n = motion.n;
    let product = |x: &[f64], i: usize, y: &[f64], j: usize| -> f64 {
        let pairs = motion.column(x, i).zip(motion.column(y, j));
        pairs
            .filter(|(a, b)| a.is_finite() && b.is_finite())
            .map(|(a, b)| a * b)
            .sum()
    };
    let correlation = (0..n)
        .map(|i| {
            let own = product(&motion.dq, i, &motion.dq, i);
            let with = |j: usize| {
                let slope = product(&motion.v, j, &motion.v, j);
                product(&motion.dq, i, &motion.v, j) / (own * slope).sqrt()
            };
            (0..n).map(with).collect()
        })
        .collect();
    let ratio = (0..n)
        .map(|j| product(&motion.dq, j, &motion.v, j) / product(&motion.v, j, &motion.v, j))
        .collect();
    let recorded = |j: usize| {
        motion
            .column(&motion.dq, j)
            .filter(|v| v.is_finite() && *v != 0.0)
            .count()
            > 50
    };
    let there = (0..n).filter(|&j| motion.moves(j) && recorded(j)).collect();
    Moments {
        correlation,
        ratio,
        there,
    }
}

/// Time in another unit, as the velocities have it.
pub(crate) fn time_unit(data: &Dataset, settings: &Settings) -> Option<Finding> {
    let slowest = data
        .experiments
        .iter()
        .map(pid_data::Experiment::sample_time)
        .fold(0.0, f64::max);
    if slowest < SLOW {
        return None;
    }
    let m = moments(&Motion::sample(data, settings));
    let fits = |j: &&usize| m.correlation[**j][**j] > settings.criteria.velocity_correlation;
    let ratios: Vec<f64> = m.there.iter().filter(fits).map(|&j| m.ratio[j]).collect();
    let first = ratios.first()?;
    let (factor, unit) = clock::near(1.0 / first, WIDTH)?;
    if ratios.iter().any(|r| (r * factor).ln().abs() > WIDTH.ln()) {
        return None;
    }
    Some(
        clock::unit_finding(factor, unit)
            .with("velocity over slope of the position", *first, "1")
            .with("median step of t", slowest, "of t"),
    )
}

/// The first fault of order, sign or unit between velocities and positions.
pub(crate) fn check(
    motion: &Motion,
    bench: Option<&Bench>,
    criteria: &Criteria,
) -> Option<Finding> {
    let m = moments(motion);
    let close = criteria.velocity_correlation;
    let c = |i: usize, j: usize| m.correlation[i][j];
    let better = |changed: Motion| {
        bench.is_some_and(|bench| {
            explains(bench, &changed, criteria) + 0.5 < explains(bench, motion, criteria)
        })
    };
    for (k, &i) in m.there.iter().enumerate() {
        for &j in &m.there[k + 1..] {
            let crossed = c(i, j) > close && c(j, i) > close;
            if crossed && c(i, i) < close && c(j, j) < close {
                let mut order: Vec<usize> = (0..motion.n).collect();
                order.swap(i, j);
                let channel = side(better(motion.exchanged(i, j)));
                let finding = swapped(channel, &order);
                let (a, b) = (i + 1, j + 1);
                return Some(
                    finding
                        .with(
                            &format!("correlation of dq{a} with the slope of q{b}"),
                            c(i, j),
                            "1",
                        )
                        .with(&format!("of dq{a} with that of q{a}"), c(i, i), "1"),
                );
            }
        }
    }
    for &j in &m.there {
        if c(j, j) < -close {
            let channel = side(better(motion.scaled(j, -1.0)));
            let finding = flipped(channel, &[j + 1], false);
            return Some(finding.with("correlation of dq with the slope of q", c(j, j), "1"));
        }
    }
    units(&m, motion.n, close)
}

/// The column at fault: positions if the torques ask for it.
fn side(position: bool) -> Channel {
    if position {
        Channel::Position
    } else {
        Channel::Velocity
    }
}

/// Sum of the logarithms of the shares of torque left.
fn explains(bench: &Bench, motion: &Motion, criteria: &Criteria) -> f64 {
    let torques = bench.torques(motion);
    let contest = Contest::new(bench, motion, &torques, criteria);
    contest.total()
}

fn units(m: &Moments, n: usize, close: f64) -> Option<Finding> {
    let fits: Vec<usize> = m
        .there
        .iter()
        .copied()
        .filter(|&j| m.correlation[j][j] > close)
        .collect();
    let unit_of = |j: usize| {
        let near = |f: f64| (m.ratio[j] / f).ln().abs() < WIDTH.ln();
        UNITS.iter().position(|(f, ..)| near(*f))
    };
    let (first, place) = fits.iter().find_map(|&j| Some((j, unit_of(j)?)))?;
    let (_, factor, unit, position) = UNITS[place];
    let alike: Vec<usize> = fits
        .iter()
        .filter(|&&j| unit_of(j) == Some(place))
        .map(|j| j + 1)
        .collect();
    // Joints that rest share the unit of those that move.
    let joints = if alike.len() == fits.len() && alike.len() > 1 {
        (1..=n).collect()
    } else {
        alike
    };
    let channel = side(position);
    let finding = unit_finding(channel, &joints, factor, unit);
    Some(finding.with("velocity over slope of the position", m.ratio[first], "1"))
}

/// Velocities that are neither the slope of their position nor that of another.
pub(crate) fn mismatch(motion: &Motion, criteria: &Criteria) -> Vec<Finding> {
    let m = moments(motion);
    let off = |j: &&usize| {
        m.correlation[**j][**j] < criteria.velocity_correlation || (m.ratio[**j] - 1.0).abs() > 0.3
    };
    m.there
        .iter()
        .filter(off)
        .map(|&j| {
            let (correlation, slope) = (m.correlation[j][j], m.ratio[j]);
            let sentence = format!(
                "dq{} is {} times the slope of q{}, correlation {}",
                j + 1,
                number(slope),
                j + 1,
                number(correlation)
            );
            Finding::new(
                FindingKind::VelocityMismatch { slope, correlation },
                Severity::Doubtful,
                sentence,
                "check the unit and the source of the velocity, or write velocity = \"absent\"",
            )
            .of(&[j + 1], Channel::Velocity)
            .with("correlation", correlation, "1")
            .with("velocity over slope", slope, "1")
        })
        .collect()
}
