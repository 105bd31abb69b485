//! Logs of many units of one drawn arm: a healthy spread, a few units that differ, a few that change over time.
//!
//! Healthy units differ normally in masses, inertias, gains and friction; friction differs from log to log too, and the
//! viscous friction of the first joint grows in all units alike. What is hidden is drawn from the same seed.

use pid_interpret::nominal::{Nominal, NominalError};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::causes::{Cause, Kind};
use crate::family::{self, Family};
use crate::mess::Mess;
use crate::motion::Motion;
use crate::plant::{PER_JOINT, Plant};
use crate::record::{run, text as rows_text};
use crate::robot::Robot;
use crate::sensors::normal;
use crate::setup::Setup;
use crate::text;

/// Length of a log, s, and its rate, Hz.
const LOG: (f64, f64) = (3.0, 200.0);
/// Days that the logs of a unit are spread over, and the first of them (2025-01-01) since 1970-01-01.
const DAYS: (f64, f64) = (365.0, 20_089.0);
/// Days that a log comes early or late at most.
const EARLY: f64 = 1.0;
/// Standard deviation of Coulomb and viscous friction between healthy units.
pub const FRICTION: f64 = 0.08;
/// The same from log to log of a unit.
const FROM_LOG_TO_LOG: f64 = 0.015;
/// Growth of the viscous friction of the first joint in a year, in all units.
pub const COMMON: f64 = 0.05;
/// Deviation between healthy units of what is no friction, in tolerances of the description.
const ELSE: f64 = 0.3;
/// Places of gain, Coulomb and viscous friction among the deviations of a joint.
const PLACES: [usize; 3] = [11, 12, 13];

/// A fleet to be drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FleetPlan {
    /// Seed of everything.
    pub seed: u64,
    /// Number of units.
    pub units: usize,
    /// Logs of each.
    pub logs: usize,
    /// Units that differ from their first log on, and as many that change; at most half of the units together.
    pub odd: usize,
}

/// What the matter is with a unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Matter {
    /// More Coulomb friction, by a share.
    Coulomb(f64),
    /// More viscous friction, by a share.
    Viscous(f64),
    /// Another gain, by a share.
    Gain(f64),
    /// A mass at the tool, kg.
    Payload(f64),
    /// A late input, s.
    Delay(f64),
    /// An input beside the command, A.
    Offset(f64),
    /// Torque ripple in time, N·m: nothing that is measured of a log.
    Hum(f64),
}

/// How it comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Coming {
    /// It is there from the first log on.
    Always,
    /// At once.
    Step,
    /// Evenly from its onset to the last log.
    Ramp,
}

/// A unit with something the matter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Odd {
    /// Number of the unit.
    pub unit: usize,
    /// What.
    pub matter: Matter,
    /// Where, from 0; no meaning for a payload.
    pub joint: usize,
    /// How.
    pub coming: Coming,
    /// When it begins, days since 1970-01-01.
    pub onset: f64,
}

/// A drawn fleet.
pub struct DrawnFleet {
    plan: FleetPlan,
    robot: Robot,
    nominal: Nominal,
    odd: Vec<Odd>,
}

impl FleetPlan {
    /// Draws the robot and what is hidden.
    ///
    /// # Errors
    /// If the drawn robot is not one; none is known.
    pub fn draw(self) -> Result<DrawnFleet, NominalError> {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed.wrapping_mul(7_000_003));
        let mut robot = family::draw(Family::PlanarArm, &mut random)?;
        (robot.length, robot.rate) = LOG;
        let stated = text::nominal(&robot, Some(robot.drive_noise), "absent");
        let nominal = Nominal::parse("nominal.toml", &stated)?;
        let mut all: Vec<usize> = (0..self.units).collect();
        all.shuffle(&mut random);
        let share = self.odd.min(self.units / 4);
        let odd = all
            .into_iter()
            .take(2 * share)
            .enumerate()
            .map(|(k, unit)| draw_odd(&robot, unit, k >= share, &mut random))
            .collect();
        Ok(DrawnFleet {
            plan: self,
            robot,
            nominal,
            odd,
        })
    }
}

fn draw_odd(robot: &Robot, unit: usize, changes: bool, random: &mut ChaCha8Rng) -> Odd {
    let joint = random.random_range(0..robot.joints.len());
    let own = &robot.joints[joint];
    let sign = if random.random_bool(0.5) { 1.0 } else { -1.0 };
    let tip = &robot.joints[robot.joints.len() - 1];
    let kinds = if changes { 3 } else { 7 };
    let matter = match random.random_range(0..kinds) {
        0 => Matter::Coulomb(random.random_range(0.6..1.2)),
        1 => Matter::Viscous(random.random_range(0.6..1.2)),
        2 => Matter::Gain(-random.random_range(0.08..0.14)),
        3 => Matter::Payload(tip.mass * random.random_range(0.12..0.25)),
        4 => Matter::Delay(random.random_range(0.005..0.012)),
        5 => Matter::Offset(sign * own.torque / own.gain * random.random_range(0.04..0.08)),
        _ => Matter::Hum(own.torque * random.random_range(0.06..0.1)),
    };
    let coming = match (changes, random.random_bool(0.5)) {
        (false, _) => Coming::Always,
        (true, true) => Coming::Step,
        (true, false) => Coming::Ramp,
    };
    let onset = match changes {
        true => DAYS.1 + DAYS.0 * random.random_range(0.25..0.7),
        false => DAYS.1,
    };
    Odd {
        unit,
        matter,
        joint,
        coming,
        onset,
    }
}

impl DrawnFleet {
    /// `nominal.toml`.
    pub fn nominal(&self) -> String {
        text::nominal(&self.robot, Some(self.robot.drive_noise), "absent")
    }

    /// What is hidden.
    pub fn odd(&self) -> &[Odd] {
        &self.odd
    }

    /// Names of the joints, base to tip.
    pub fn joints(&self) -> Vec<String> {
        (1..=self.robot.joints.len())
            .map(|k| format!("j{k}"))
            .collect()
    }

    /// The `k`-th log of a unit: its day since 1970-01-01, and its text.
    pub fn log(&self, unit: usize, k: usize) -> (f64, String) {
        let FleetPlan { seed, logs, .. } = self.plan;
        let stream = |number: u64| {
            let mut random =
                ChaCha8Rng::seed_from_u64(seed.wrapping_mul(7_000_003).wrapping_add(1));
            random.set_stream(number);
            random
        };
        let number = (unit * logs + k) as u64;
        let mut random = stream(2 * number + 1);
        let day =
            DAYS.1 + DAYS.0 * (k as f64 + 0.5) / logs as f64 + random.random_range(-EARLY..EARLY);
        let mut theta = self.healthy(&mut stream(2 * unit as u64));
        for joint in theta.chunks_exact_mut(PER_JOINT) {
            for &place in &PLACES[1..] {
                joint[place] +=
                    FROM_LOG_TO_LOG / self.robot.tolerance.friction * normal(&mut random);
            }
        }
        theta[PLACES[2]] += COMMON / self.robot.tolerance.friction * (day - DAYS.1) / DAYS.0;
        let mut causes = Vec::new();
        for odd in self.odd.iter().filter(|o| o.unit == unit) {
            self.add(odd, odd.share(day), &mut theta, &mut causes);
        }
        let plant = Plant::<f64>::new(&self.nominal, &theta);
        let setup = Setup {
            robot: &self.robot,
            nominal: &self.nominal,
            plant: &plant,
            theta: &theta,
            causes: &causes,
            velocity: "absent",
            mess: &Mess::default(),
            loops: None,
        };
        // Nothing untidy is drawn.
        let mut none = random.clone();
        let samples = (LOG.0 * LOG.1) as usize + 1;
        let run = run(
            &setup,
            Motion::Sines(100, 100),
            samples,
            &mut random,
            &mut none,
        );
        (day, rows_text(&run.rows, "absent", "u"))
    }

    /// Deviations of a healthy unit in tolerances.
    fn healthy(&self, random: &mut ChaCha8Rng) -> Vec<f64> {
        let size = |place: usize| match PLACES[1..].contains(&place) {
            true => FRICTION / self.robot.tolerance.friction,
            false => ELSE,
        };
        (0..self.robot.joints.len() * PER_JOINT)
            .map(|i| size(i % PER_JOINT) * normal(random))
            .collect()
    }

    /// Puts a share of what is the matter into a log.
    fn add(&self, odd: &Odd, share: f64, theta: &mut [f64], causes: &mut Vec<Cause>) {
        if share == 0.0 {
            return;
        }
        let tolerance = &self.robot.tolerance;
        let own = &mut theta[odd.joint * PER_JOINT..(odd.joint + 1) * PER_JOINT];
        let joint = odd.joint;
        match odd.matter {
            Matter::Gain(by) => own[PLACES[0]] += share * by / tolerance.gain,
            Matter::Coulomb(by) => own[PLACES[1]] += share * by / tolerance.friction,
            Matter::Viscous(by) => own[PLACES[2]] += share * by / tolerance.friction,
            Matter::Payload(mass) => causes.push(Cause {
                kind: Kind::Payload { mass: share * mass },
                joint,
            }),
            Matter::Delay(delay) => causes.push(Cause {
                kind: Kind::InputDelay {
                    delay: share * delay,
                },
                joint,
            }),
            Matter::Offset(offset) => causes.push(Cause {
                kind: Kind::CurrentOffset {
                    offset: share * offset,
                },
                joint,
            }),
            Matter::Hum(amplitude) => causes.push(Cause {
                kind: Kind::MainsHum {
                    amplitude: share * amplitude,
                    frequency: 9.0,
                },
                joint,
            }),
        }
    }
}

impl Odd {
    /// How much of it is there on a day.
    fn share(&self, day: f64) -> f64 {
        match self.coming {
            Coming::Always => 1.0,
            Coming::Step if day > self.onset => 1.0,
            Coming::Step => 0.0,
            Coming::Ramp => ((day - self.onset) / (DAYS.1 + DAYS.0 - self.onset)).max(0.0),
        }
    }

    /// Names of quantities and causes of a fleet's summary that are this one; empty for what has no name there.
    pub fn names(&self, joints: &[String]) -> Vec<String> {
        let at = |stem: &str| vec![format!("{stem}_{}", joints[self.joint])];
        match self.matter {
            Matter::Coulomb(_) => at("coulomb"),
            Matter::Viscous(_) => at("viscous"),
            Matter::Gain(_) => at("gain"),
            Matter::Payload(_) => vec!["payload".to_owned()],
            Matter::Delay(_) => at("delay"),
            Matter::Offset(_) => at("offset"),
            Matter::Hum(_) => at("residual"),
        }
    }
}
