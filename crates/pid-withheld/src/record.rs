//! One record under the [controller](crate::controller): the robot moves in steps, and at each
//! sample its sensors are read and its controller acts.

use std::fmt::Write as _;
use std::ops::Range;

use rand_chacha::ChaCha8Rng;

use crate::causes::{Cause, Kind};
use crate::controller::{Controller, limit};
use crate::mess::Current;
use crate::motion::Motion;
use crate::plant::{PER_JOINT, Plant};
use crate::position_loop::{Loop, Running};
use crate::robot::{Joint, Robot};
use crate::sensors::{Colour, Sensors, Track, normal, prompt};
use crate::setup::{Row, Setup};
use crate::world::{Moment, STEP, World};

/// Time at rest before a record, s.
const HOLDING: f64 = 0.6;

/// Changes per second from one limit of the command to the other from which on a loop counts as one
/// that swings by itself: motions turn at most 4.4 times a second, loops that swing 55 times and more.
const SWINGING: f64 = 10.0;

/// When samples are taken, counted from the start of the rest before a record.
#[derive(Debug, Clone)]
pub(crate) struct Clock {
    /// Period, s.
    h: f64,
    /// Lateness of each sample, share of a period.
    late: Vec<f64>,
    /// Time of each sample, s.
    pub(crate) times: Vec<f64>,
}

impl Clock {
    fn new(h: f64, late: Vec<f64>) -> Self {
        let times = (late.iter().enumerate())
            .map(|(k, late)| k as f64 * h + late * h)
            .collect();
        Self { h, late, times }
    }

    /// The `k`-th sample in steps: how many are complete, and its time.
    pub(crate) fn steps(&self, k: usize) -> (usize, f64) {
        let steps = self.times[k] / STEP;
        let complete = (steps + 1e-6).floor();
        // Rounding is no part of a step.
        let exact = (steps - complete).abs() < 1e-6;
        (complete as usize, if exact { complete } else { steps })
    }

    /// Time between the `k`-th sample and the one before, s.
    pub(crate) fn elapsed(&self, k: usize) -> f64 {
        match k.checked_sub(1) {
            Some(before) => self.h * (1.0 + (self.late[k] - self.late[before])),
            None => self.h,
        }
    }
}

/// Values that hold from their samples on, joint by joint.
pub(crate) struct Held<'a> {
    pub(crate) clock: &'a Clock,
    pub(crate) values: &'a [Vec<f64>],
}

impl Held<'_> {
    /// The mean over the step that begins at `from`, s, of what comes in after the causes' delays.
    pub(crate) fn over(&self, causes: &[Cause], from: f64) -> Vec<f64> {
        let n = self.values[0].len();
        (0..n).map(|j| self.joint(causes, from, j)).collect()
    }

    fn joint(&self, causes: &[Cause], from: f64, j: usize) -> f64 {
        let delay = causes.iter().rev().find_map(|c| match c.kind {
            Kind::InputDelay { delay } if c.joint == j => Some(delay),
            _ => None,
        });
        let from = from - delay.unwrap_or(0.0);
        let times = &self.clock.times[..self.values.len()];
        let at = |t: f64| {
            let reached = t + 1e-9 * self.clock.h;
            times.partition_point(|x| *x <= reached).saturating_sub(1)
        };
        let (i, k) = (at(from), at(from + STEP));
        let (before, after) = (self.values[i][j], self.values[k][j]);
        let share = ((from + STEP - times[k]) / STEP).clamp(0.0, 1.0);
        before + (after - before) * share
    }
}

/// The sensors of the drives' currents.
struct Currents {
    sensor: Option<Current>,
    now: Vec<f64>,
}

impl Currents {
    /// After a step under the currents `applied`.
    fn follow(&mut self, applied: &[f64]) {
        if let Some(sensor) = self.sensor {
            let share = 1.0 - (-std::f64::consts::TAU * sensor.corner * STEP).exp();
            for (now, applied) in self.now.iter_mut().zip(applied) {
                *now += share * (applied - *now);
            }
        }
    }

    /// Reads the currents at the end of the period of a row.
    fn read(&self, robot: &Robot, row: &mut Row, random: &mut ChaCha8Rng) {
        if let Some(sensor) = self.sensor {
            for ((u, now), j) in row.u.iter_mut().zip(&self.now).zip(&robot.joints) {
                *u = now + sensor.noise * j.torque / j.gain * normal(random);
            }
        }
    }
}

/// A record and what nobody sees of it.
pub(crate) struct Run {
    /// The rows before anything is spoiled.
    pub(crate) rows: Vec<Row>,
    pub(crate) clock: Clock,
    /// Samples of rest before the first row.
    pub(crate) hold: usize,
    /// Commands, and what the drives make of them, sample by sample from the rest on.
    pub(crate) sent: Vec<Vec<f64>>,
    pub(crate) taken: Vec<Vec<f64>>,
    /// The encoders.
    pub(crate) track: Track,
    /// The robot at every `window`-th row, at the end of the last complete step.
    pub(crate) moments: Vec<Moment>,
}

impl Run {
    /// Whether the controller holds the robot: no joint leaves its room by more than its size, and no
    /// command goes from limit to limit.
    pub(crate) fn held(&self, robot: &Robot) -> bool {
        let roomy = self.rows.iter().all(|row| {
            let mut joints = row.q.iter().zip(&robot.joints);
            joints.all(|(q, j)| (q - j.room.centre).abs() <= 2.0 * j.room.amplitude)
        });
        let most = SWINGING * self.sent.len() as f64 / robot.rate;
        let swings = |(j, joint): (usize, &Joint)| {
            let limit = 0.999 * limit(joint);
            let commands = self.sent.iter().map(|u| u[j]);
            swings(commands, limit) as f64 > most
        };
        roomy && !robot.joints.iter().enumerate().any(swings)
    }
}

/// How often a command goes from one limit to the other.
fn swings(command: impl Iterator<Item = f64>, limit: f64) -> usize {
    let at_limit: Vec<bool> = (command.filter(|u| u.abs() >= limit))
        .map(|u| u > 0.0)
        .collect();
    at_limit.windows(2).filter(|w| w[0] != w[1]).count()
}

/// The loops of all joints at work, with what the drives know of the robot.
struct Loops<'a> {
    running: Vec<Running<'a>>,
    model: Plant<f64>,
}

impl<'a> Loops<'a> {
    /// At rest at `start`; samples are `every` steps apart, and the record begins after `origin`.
    fn new(setup: &Setup<'a>, start: &[f64], (every, origin): (usize, usize)) -> Option<Self> {
        let n = start.len();
        let model = Plant::new(setup.nominal, &vec![0.0; n * PER_JOINT]);
        let (_, weight) = setup.plant.mass_and_bias(start, &vec![0.0; n]);
        let of = |(j, own): (usize, &'a Loop)| {
            Running::new(
                own,
                start[j],
                weight[j] / setup.plant.gain[j],
                (every, origin),
            )
        };
        let running = setup.loops?.iter().enumerate().map(of).collect();
        Some(Self { running, model })
    }

    /// Currents over the next step, in place of the targets.
    fn act(&mut self, applied: &mut [f64], readings: &[(f64, f64)]) {
        let n = readings.len();
        let (mut weight, mut push) = (vec![0.0; n], vec![0.0; n]);
        let targets = self.running.iter_mut().zip(&*applied);
        let aims: Vec<f64> = targets.map(|(own, target)| own.aim(*target)).collect();
        if self.running.iter().any(Running::weighs) {
            let q: Vec<f64> = readings.iter().map(|r| r.0).collect();
            let (mass, bias) = self.model.mass_and_bias(&q, &vec![0.0; n]);
            let gain = &self.model.gain;
            weight = (0..n).map(|j| bias[j] / gain[j]).collect();
            let force = |j: usize| (0..n).map(|k| mass[(j, k)] * aims[k]).sum::<f64>();
            push = (0..n)
                .map(|j| (force(j) + self.model.rotor[j] * aims[j]) / gain[j])
                .collect();
        }
        for (j, own) in self.running.iter_mut().enumerate() {
            applied[j] = own.next(readings[j], weight[j], push[j]);
        }
    }
}

/// What moves between two samples.
struct Moving<'a> {
    world: World<'a>,
    loops: Option<Loops<'a>>,
    currents: Currents,
}

impl Moving<'_> {
    /// What the encoders turn with, joint by joint.
    fn encoders(&self) -> Vec<(f64, f64)> {
        let n = self.currents.now.len();
        (0..n).map(|j| self.world.encoder(j)).collect()
    }

    /// Over the steps of one period, under what the drives take and the noise of their currents.
    fn over(&mut self, steps: Range<usize>, causes: &[Cause], noise: &[f64], run: &mut Run) {
        for s in steps {
            let from = s as f64 * STEP;
            let held = Held {
                clock: &run.clock,
                values: &run.taken,
            };
            let mut applied = held.over(causes, from);
            if let Some(loops) = &mut self.loops {
                let readings: Vec<(f64, f64)> = (0..noise.len())
                    .map(|j| prompt(causes, self.world.encoder(j), j))
                    .collect();
                loops.act(&mut applied, &readings);
            }
            for (a, e) in applied.iter_mut().zip(noise) {
                *a += e;
            }
            self.world
                .step(&applied, from - run.hold as f64 * run.clock.h);
            self.currents.follow(&applied);
            run.track.places.push(self.encoders());
        }
    }
}

/// Moves the robot; `window`: rows from one kept moment to the next. Two streams of numbers: for
/// what is there in a tidy record too, and for the rest.
pub(crate) fn run(
    setup: &Setup<'_>,
    motion: Motion,
    window: usize,
    random: &mut ChaCha8Rng,
    untidy: &mut ChaCha8Rng,
) -> Run {
    let Setup {
        robot,
        causes,
        mess,
        ..
    } = *setup;
    let n = robot.joints.len();
    let h = 1.0 / robot.rate;
    let hold = (HOLDING * robot.rate) as usize;
    let samples = (robot.length * robot.rate) as usize + 1;
    let controller = Controller::new(setup, motion, (hold, samples), random);
    let start: Vec<f64> = (0..n).map(|j| controller.target(j, 0)).collect();
    let steps = |samples: f64| (samples * h / STEP).round() as usize;
    let mut moving = Moving {
        world: World::new(setup.plant.clone(), causes, &start),
        loops: Loops::new(setup, &start, (steps(1.0), steps(hold as f64))),
        currents: Currents {
            sensor: mess.current,
            now: vec![0.0; n],
        },
    };
    let mut sensors = Sensors::new(robot, causes, setup.velocity);
    let mut colour = Colour::new(n, mess.colour, h);
    let mut run = Run {
        rows: Vec::with_capacity(samples),
        // One more, at which the last period ends.
        clock: Clock::new(h, mess.late(hold + samples + 1, untidy)),
        hold,
        sent: Vec::new(),
        taken: Vec::new(),
        track: Track::default(),
        moments: Vec::new(),
    };
    run.track.places.push(moving.encoders());
    for k in 0..hold + samples {
        let (step, at) = run.clock.steps(k);
        let noise = Some((&mut colour, &mut *random));
        let (q, v) = sensors.read(&run.track, at, run.clock.elapsed(k), noise);
        let u = match &moving.loops {
            None => controller.command(k, &q, &sensors.filtered),
            Some(_) => (0..n).map(|j| controller.target(j, k)).collect(),
        };
        let mut taken = u.clone();
        run.sent.push(u.clone());
        if let Some(row) = k.checked_sub(hold) {
            if row % window == 0 {
                run.moments.push(moving.world.moment());
            }
            let t = run.clock.times[k] - hold as f64 * h;
            run.rows.push(Row { t, q, v, u });
        }
        moving.world.command(&mut taken, random);
        run.taken.push(taken);
        let noise: Vec<f64> = robot
            .joints
            .iter()
            .map(|j| robot.drive_noise * j.torque / j.gain * normal(random))
            .collect();
        moving.over(step..run.clock.steps(k + 1).0, causes, &noise, &mut run);
        if let Some(row) = run.rows.last_mut() {
            moving.currents.read(robot, row, untidy);
        }
    }
    run
}

/// The text of rows, the inputs under a name; what is lost is an empty cell.
pub(crate) fn text(rows: &[Row], velocity: &str, input: &str) -> String {
    let n = rows.first().map_or(0, |row| row.q.len());
    let recorded = velocity != "absent";
    let mut text = String::from("t");
    for (head, some) in [("q", true), ("dq", recorded), (input, true)] {
        for j in 0..n {
            if some {
                // Writing to a string cannot fail.
                let _ = write!(text, ",{head}{}", j + 1);
            }
        }
    }
    text.push('\n');
    let cell = |text: &mut String, x: f64, digits: usize| {
        text.push(',');
        if x.is_finite() {
            let _ = write!(text, "{x:.digits$}");
        }
    };
    for row in rows {
        let _ = write!(text, "{:.6}", row.t);
        for x in &row.q {
            cell(&mut text, *x, 7);
        }
        for x in row.v.iter().filter(|_| recorded) {
            cell(&mut text, *x, 6);
        }
        for x in &row.u {
            cell(&mut text, *x, 7);
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::swings;

    #[test]
    fn a_command_swings_where_it_goes_from_limit_to_limit() {
        // At one limit for long, on the way between them, beyond them by rounding.
        assert_eq!(swings([1.0, 1.0, 1.0, 0.2, 1.0].into_iter(), 1.0), 0);
        assert_eq!(swings([1.0, 0.0, -1.0, -1.0, 0.3, 1.0].into_iter(), 1.0), 2);
        assert_eq!(swings([0.9, -0.9, 0.9].into_iter(), 1.0), 0);
    }
}
