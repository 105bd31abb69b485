//! Draws the loops of a robot, and how well they are stated.

use std::f64::consts::TAU;
use std::fmt::Write as _;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::causes::{Cause, Kind};
use crate::position_loop::{Law, Loop};
use crate::robot::Robot;

/// Rates of records behind servos, Hz.
const RATES: [f64; 4] = [50.0, 100.0, 200.0, 500.0];
/// Rates of loops, Hz; none answers at once.
const LOOP_RATES: [Option<f64>; 4] = [None, Some(1000.0), Some(500.0), Some(200.0)];
/// Tolerance of stated gains, and how far off they are at most, shares.
const TOLERANCE: f64 = 0.3;
const OFF: f64 = 0.25;

/// How well the gains are stated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stated {
    /// As they are.
    Exactly,
    /// Within 30 %.
    Roughly,
    /// Not at all; what stands beside the law is within 30 %.
    Unknown,
}

/// A rate of records.
pub(super) fn rate(random: &mut ChaCha8Rng) -> f64 {
    RATES[random.random_range(0..RATES.len())]
}

/// Loops of all joints: one law and one set of stages, gains by what a joint moves.
pub(super) fn loops(
    robot: &Robot,
    inertia: &[f64],
    law: Option<Law>,
    random: &mut ChaCha8Rng,
) -> Vec<Loop> {
    let law = law.unwrap_or(Law::ALL[random.random_range(0..Law::ALL.len())]);
    let rate = LOOP_RATES[random.random_range(0..LOOP_RATES.len())];
    let mut some = |share: f64| random.random_bool(share);
    let (feed, filtered, banded) = (some(0.3), some(0.25) && law != Law::P, some(0.15));
    let (stepped, held, slowed, smoothed) = (some(0.1), some(0.15), some(0.1), some(0.25));
    let mut x = |low: f64, high: f64| random.random_range(low..high);
    // A loop of a slow drive, and one whose speed is filtered, must be softer.
    let slow = rate.map_or(f64::INFINITY, |rate| 0.06 * rate);
    let speed_filter = filtered.then(|| x(0.004, 0.02));
    let target_filter = smoothed.then(|| x(0.02, 0.08));
    let share = feed.then(|| x(0.6, 1.0));
    let mut out = Vec::new();
    for (joint, inertia) in robot.joints.iter().zip(inertia) {
        let softer = speed_filter.map_or(f64::INFINITY, |time| 0.25 / time);
        let w = (TAU * x(1.5, 4.0)).min(slow).min(softer);
        let z = x(0.5, 1.0);
        let stiffness = inertia * w * w / joint.gain;
        let damping = (2.0 * z * w * inertia - joint.viscous).max(0.3 * w * inertia) / joint.gain;
        let size = joint.room.amplitude;
        let cascade = law == Law::Cascade;
        out.push(Loop {
            law,
            kp: if cascade {
                stiffness / damping
            } else {
                stiffness
            },
            kd: if law == Law::P { 0.0 } else { damping },
            ki: match law {
                Law::Pid => stiffness * w * x(0.05, 0.2),
                Law::Cascade => damping * w * x(0.05, 0.2),
                _ => 0.0,
            },
            limit: 2.0 * joint.torque / joint.gain,
            speed_limit: cascade.then(|| joint.room.speed * x(0.6, 1.5)),
            gravity: share,
            target_share: None,
            inertia: None,
            speed_filter,
            read_late: None,
            dead_band: banded.then(|| size * x(0.002, 0.01)),
            target_step: stepped.then(|| size * x(0.002, 0.02)),
            target_rate: held.then_some(50.0),
            target_speed: slowed.then(|| joint.room.speed * x(0.4, 1.0)),
            target_acceleration: None,
            target_average: None,
            target_filter,
            rate,
        });
    }
    out
}

/// Damping ratio of a P loop, and its frequency at most, Hz.
const BACK_EMF: std::ops::Range<f64> = 0.3..0.6;
const SLOWER: std::ops::Range<f64> = 1.0..2.0;

/// Slows P loops, and has the back-EMF of their motors brake the joints: nothing else damps them, and a drive that
/// swings up is not one that is recorded. The motors are as much stronger.
pub(super) fn brake(
    robot: &mut Robot,
    inertia: &[f64],
    loops: &mut [Loop],
    random: &mut ChaCha8Rng,
) {
    for ((joint, own), inertia) in robot.joints.iter_mut().zip(loops).zip(inertia) {
        if own.law != Law::P {
            continue;
        }
        let slower = TAU * random.random_range(SLOWER);
        let w = (own.kp * joint.gain / inertia).sqrt().min(slower);
        own.kp = inertia * w * w / joint.gain;
        joint.viscous += 2.0 * random.random_range(BACK_EMF) * w * inertia;
        own.limit += joint.viscous * joint.room.speed / joint.gain;
    }
}

/// Rates of a policy and of the loops below it, Hz.
const POLICY_RATE: f64 = 50.0;
const JOINT_RATE: f64 = 1000.0;

/// Damped loops without further stages whose targets come from a policy.
pub(super) fn under_a_policy(robot: &Robot, inertia: &[f64], random: &mut ChaCha8Rng) -> Vec<Loop> {
    let bare = |own: Loop| Loop {
        gravity: None,
        speed_filter: None,
        dead_band: None,
        target_step: None,
        target_speed: None,
        target_filter: None,
        target_rate: Some(POLICY_RATE),
        rate: Some(JOINT_RATE),
        ..own
    };
    let drawn = loops(robot, inertia, Some(Law::Pd), random);
    drawn.into_iter().map(bare).collect()
}

/// Resonances of elastic joints over the frequency of their loops: within reach of the motion, not so low that the
/// loop no longer holds the link.
const RESONANCE: std::ops::Range<f64> = 2.0..5.0;
/// Delays of a loop's readings over the time in which it swings by a radian: it rings, and does not swing up.
const LATE: std::ops::Range<f64> = 0.1..0.35;
/// Damping of a gear over that of its rotor and link against each other.
const GEAR: f64 = 0.06;

/// Frequency of a loop, rad/s.
fn swings(robot: &Robot, inertia: &[f64], loops: &[Loop], joint: usize) -> f64 {
    let own = &loops[joint];
    let per_error = match own.law {
        Law::Cascade => own.kp * own.kd,
        _ => own.kp,
    };
    (per_error * robot.joints[joint].gain / inertia[joint]).sqrt()
}

/// An elastic joint that resonates within reach of its loop, or a loop that reads so late that it rings as much.
pub(super) fn resonance(
    robot: &Robot,
    inertia: &[f64],
    loops: &mut [Loop],
    random: &mut ChaCha8Rng,
) -> Cause {
    let joint = random.random_range(0..loops.len());
    let own = &robot.joints[joint];
    let w = swings(robot, inertia, loops, joint);
    let elastic = random.random_bool(0.5);
    let (faster, late) = (random.random_range(RESONANCE), random.random_range(LATE));
    let kind = match elastic {
        true => {
            let link = (inertia[joint] - own.rotor).max(0.1 * inertia[joint]);
            let stiffness = link * (faster * w).powi(2);
            let reduced = own.rotor * link / inertia[joint];
            Kind::JointElasticity {
                stiffness,
                damping: GEAR * (stiffness * reduced).sqrt(),
            }
        }
        false => {
            loops[joint].read_late = Some(late / w);
            Kind::FeedbackDelay { delay: late / w }
        }
    };
    Cause { kind, joint }
}

/// Time constants of filters that are not stated, s.
const FILTERS: std::ops::Range<f64> = 0.02..0.08;
/// Largest speeds that are not stated, shares of the fastest motion.
const SPEEDS: std::ops::Range<f64> = 0.3..0.7;
/// Accelerations of profiles that are not stated, shares of that of a sine as wide and fast as the motion; and times
/// over which targets are averaged, s.
const ACCELERATIONS: std::ops::Range<f64> = 0.3..1.0;
const AVERAGES: std::ops::Range<f64> = 0.04..0.16;
/// Shares of feed-forward that is not stated.
const SHARES: std::ops::Range<f64> = 0.5..1.0;
/// Least torque of gravity, a share of the largest usual one, that a feed-forward shows against.
const PULL: f64 = 0.1;

/// Gives a loop a stage that the others do not have either. `pull` is the largest torque of gravity at each joint.
/// Returns it, and the loops as they are stated.
pub(super) fn hide(
    robot: &Robot,
    (inertia, pull): (&[f64], &[f64]),
    loops: &mut [Loop],
    random: &mut ChaCha8Rng,
) -> (Cause, Vec<Loop>) {
    let joint = random.random_range(0..loops.len());
    let own = &robot.joints[joint];
    let falls = pull[joint] > PULL * own.torque;
    let which = loop {
        let which = random.random_range(0..8);
        let fits = match which {
            2 => falls,
            3 => loops[joint].law != Law::P,
            _ => true,
        };
        if fits {
            break which;
        }
    };
    let (time, speed) = (random.random_range(FILTERS), random.random_range(SPEEDS));
    let (speed, share) = (speed * own.room.speed, random.random_range(SHARES));
    let delay = random.random_range(LATE) / swings(robot, inertia, loops, joint);
    let most = own.room.speed.powi(2) / own.room.amplitude;
    let acceleration = random.random_range(ACCELERATIONS) * most;
    let average = random.random_range(AVERAGES);
    let bare = |own: &mut Loop| match which {
        0 => own.target_filter = None,
        1 => own.target_speed = None,
        2 => own.gravity = None,
        4 => own.read_late = None,
        5 => own.target_acceleration = None,
        6 => own.target_average = None,
        7 => own.inertia = None,
        _ => own.target_share = None,
    };
    loops.iter_mut().for_each(bare);
    let stated = loops.to_vec();
    let kind = match which {
        0 => Kind::CommandFilter { time },
        1 => Kind::CommandSpeedLimit { speed },
        2 => Kind::GravityFeedForward { share },
        4 => Kind::FeedbackDelay { delay },
        5 => Kind::CommandAccelerationLimit { acceleration },
        6 => Kind::CommandAverage { time: average },
        7 => Kind::InertiaFeedForward { share },
        _ => Kind::VelocityFeedForward { share },
    };
    let hidden = &mut loops[joint];
    match kind {
        Kind::CommandFilter { time } => hidden.target_filter = Some(time),
        Kind::CommandSpeedLimit { speed } => hidden.target_speed = Some(speed),
        Kind::GravityFeedForward { share } => hidden.gravity = Some(share),
        Kind::FeedbackDelay { delay } => hidden.read_late = Some(delay),
        Kind::CommandAccelerationLimit { acceleration } => {
            hidden.target_acceleration = Some(acceleration);
        }
        Kind::CommandAverage { time } => hidden.target_average = Some(time),
        Kind::InertiaFeedForward { share } => hidden.inertia = Some(share),
        _ => hidden.target_share = Some(share),
    }
    (Cause { kind, joint }, stated)
}

/// A number as it is stated.
fn number(key: &str, value: f64, stated: Stated, random: &mut ChaCha8Rng) -> String {
    match stated {
        Stated::Exactly => format!("{key} = {value:?}\n"),
        Stated::Roughly => {
            let off = value * (1.0 + random.random_range(-OFF..OFF));
            // The tolerance is that of the real value.
            format!(
                "{key} = {{ value = {off:?}, tolerance = {:?} }}\n",
                TOLERANCE * value
            )
        }
        Stated::Unknown => format!("{key} = {{ unknown = true }}\n"),
    }
}

/// The table `[joint.drive]` of each joint.
pub(super) fn tables(loops: &[Loop], stated: Stated, random: &mut ChaCha8Rng) -> Vec<String> {
    let mut out = Vec::new();
    for own in loops {
        let mut s = format!("[joint.drive]\nlaw = \"{}\"\n", own.law.word());
        s += &number("kp", own.kp, stated, random);
        match own.law {
            Law::P => {}
            Law::Cascade => s += &number("kv", own.kd, stated, random),
            _ => s += &number("kd", own.kd, stated, random),
        }
        if matches!(own.law, Law::Pid | Law::Cascade) {
            s += &number("ki", own.ki, stated, random);
        }
        let beside = stated.min(Stated::Roughly);
        let uncertain = [
            ("gravity", own.gravity),
            ("velocity_filter_s", own.speed_filter),
            ("target_filter_s", own.target_filter),
        ];
        for (key, value) in uncertain {
            if let Some(value) = value {
                s += &number(key, value, beside, random);
            }
        }
        let exact = [
            ("limit", Some(own.limit)),
            ("velocity_limit", own.speed_limit),
            ("dead_band", own.dead_band),
            ("target_step", own.target_step),
            ("target_rate_hz", own.target_rate),
            ("target_speed", own.target_speed),
            ("rate_hz", own.rate),
        ];
        for (key, value) in exact {
            if let Some(value) = value {
                // Writing to a string cannot fail.
                let _ = writeln!(s, "{key} = {value:?}");
            }
        }
        out.push(s);
    }
    out
}
