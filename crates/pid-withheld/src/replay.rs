//! Free runs of the true robot with some of its causes, and what each cause has of the gap.
//!
//! G(S) is the free-run gap with the causes S at their true size: each record is cut into windows,
//! and from the true state at the start of a window the robot runs under the recorded inputs, with
//! the true values of the nominal structure. So there is nothing to refit. Its readings without
//! noise are compared with the recorded ones; the squared error is divided by the variance of the
//! channel in the record, then averaged over joints, channels and records. Encoders that S takes for
//! right show the start: an offset outside S moves the start, as it does for everyone who reads it.
//!
//! With F = G(all), which noise leaves,
//!
//! ```text
//! left_out(e) = (G(all but e)² − F²) / (G(none)² − F²)
//! left_in(e)  = (G(none)² − G(e)²) / (G(none)² − F²)
//! ```
//!
//! and the share of e is the mean of both, scaled to the sum 1. Causes interact: neither left_out nor
//! left_in need sum to 1.

use serde::{Deserialize, Serialize};

use crate::causes::{Cause, Kind};
use crate::record::{Held, Run, Setup};
use crate::sensors::{Sensors, Track, sensed};
use crate::world::{STEP, World};

/// A squared relative error beyond this counts as this.
const LARGEST: f64 = 100.0;
/// Steps of the encoders' past that a late sensor may ask for: 0.2 s.
const PAST: usize = 2000;

/// What one cause has of the gap.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Share of the squared gap beyond the floor; those of a case sum to 1.
    pub share: f64,
    /// What is lost without it.
    pub left_out: f64,
    /// What it explains alone.
    pub left_in: f64,
}

/// The study's own gaps of a case on its test records.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Gaps {
    /// Gap without a cause.
    pub none: f64,
    /// Gap with all of them: the study's own floor.
    pub all: f64,
    /// Cause by cause.
    pub parts: Vec<Part>,
}

impl Gaps {
    /// From free runs on the test records `runs`, cut into windows of `window` rows.
    pub(crate) fn new(setup: &Setup<'_>, runs: &[Run], window: usize) -> Self {
        let count = setup.causes.len();
        let square = |on: &dyn Fn(usize) -> bool| {
            let sum: f64 = runs.iter().map(|run| squared(setup, run, window, on)).sum();
            sum / runs.len() as f64
        };
        let all = square(&|_| true);
        let none = if count > 0 { square(&|_| false) } else { all };
        let whole = (none - all).max(1e-300);
        let mut parts: Vec<Part> = (0..count)
            .map(|e| {
                let (without, alone) = match count {
                    1 => (none, all),
                    _ => (square(&|i| i != e), square(&|i| i == e)),
                };
                let (left_out, left_in) = ((without - all) / whole, (none - alone) / whole);
                Part {
                    share: 0.5 * (left_out + left_in),
                    left_out,
                    left_in,
                }
            })
            .collect();
        let sum: f64 = parts.iter().map(|p| p.share).sum();
        for p in &mut parts {
            p.share /= sum;
        }
        Self {
            none: none.sqrt(),
            all: all.sqrt(),
            parts,
        }
    }

    /// Of a robot that its controller does not hold: far too large.
    pub(crate) fn out_of_hand(causes: usize) -> Self {
        let share = 1.0 / causes.max(1) as f64;
        let part = Part {
            share,
            left_out: share,
            left_in: share,
        };
        Self {
            none: LARGEST,
            all: 1.0,
            parts: vec![part; causes],
        }
    }

    /// The least share; 1 where nothing is missing.
    pub(crate) fn least(&self) -> f64 {
        let shares = self.parts.iter().map(|p| p.share);
        shares.fold(1.0, |a, b| if b.is_finite() { a.min(b) } else { -1.0 })
    }
}

/// Mean square of the relative errors of free runs on one record with the causes that are `on`.
fn squared(setup: &Setup<'_>, run: &Run, window: usize, on: &dyn Fn(usize) -> bool) -> f64 {
    let mut causes: (Vec<Cause>, Vec<Cause>) = (Vec::new(), Vec::new());
    for (i, c) in setup.causes.iter().enumerate() {
        if on(i) { &mut causes.0 } else { &mut causes.1 }.push(*c);
    }
    let replay = Replay {
        setup,
        run,
        with: &causes.0,
        without: &causes.1,
        inputs: inputs(setup, run, &causes.0),
    };
    let n = setup.robot.joints.len();
    let velocities = setup.velocity != "absent";
    let mut sums = vec![(0.0, 0.0); n];
    let count = (run.rows.len() - 1) / window;
    for i in 0..count {
        replay.window(i, window, &mut sums);
    }
    let mean = |sum: f64, channel: &dyn Fn(usize) -> f64| {
        let square = sum / (count * window).max(1) as f64 / variance(run.rows.len(), channel);
        if square.is_finite() {
            square.min(LARGEST)
        } else {
            LARGEST
        }
    };
    let mut all = Vec::new();
    for (j, sum) in sums.iter().enumerate() {
        all.push(mean(sum.0, &|k| run.rows[k].q[j]));
        if velocities {
            all.push(mean(sum.1, &|k| run.rows[k].v[j]));
        }
    }
    all.iter().sum::<f64>() / all.len() as f64
}

/// Inputs from the rest on, as they are recorded; drives that drop commands, where they are known to,
/// take what they took.
fn inputs(setup: &Setup<'_>, run: &Run, with: &[Cause]) -> Vec<Vec<f64>> {
    let drops = |c: &Cause| matches!(c.kind, Kind::DroppedCommands { .. });
    let mut values = if with.iter().any(drops) {
        run.taken.clone()
    } else {
        run.sent.clone()
    };
    if setup.mess.current.is_some() {
        for (value, row) in values[run.hold..].iter_mut().zip(&run.rows) {
            value.copy_from_slice(&row.u);
        }
    }
    values
}

fn variance(count: usize, channel: &dyn Fn(usize) -> f64) -> f64 {
    let mean = (0..count).map(channel).sum::<f64>() / count as f64;
    let square = (0..count).map(|k| (channel(k) - mean).powi(2)).sum::<f64>();
    (square / count as f64).max(1e-24)
}

/// One record, run again with some of its causes.
struct Replay<'a> {
    setup: &'a Setup<'a>,
    run: &'a Run,
    with: &'a [Cause],
    without: &'a [Cause],
    inputs: Vec<Vec<f64>>,
}

impl Replay<'_> {
    /// Adds the squared errors of the positions and velocities of the `i`-th window.
    fn window(&self, i: usize, window: usize, sums: &mut [(f64, f64)]) {
        let Self { setup, run, .. } = self;
        let n = sums.len();
        let (first, begin) = (i * window, run.hold as f64 / setup.robot.rate);
        let (mut step, _) = run.clock.steps(run.hold + first);
        let moved: Vec<(f64, f64)> = (0..n)
            .map(|j| {
                let at = |causes| sensed(causes, &run.track, step as f64, j);
                let (shown, true_place) = (at(self.without), at(&[]));
                (shown.0 - true_place.0, shown.1 - true_place.1)
            })
            .collect();
        let mut world = World::new(setup.plant.clone(), self.with, &vec![0.0; n]);
        world.resume(&run.moments[i], &moved);
        let past = step.saturating_sub(PAST);
        let mut track = Track {
            first: past,
            places: run.track.places[past..=step].to_vec(),
        };
        for (x, moved) in track
            .places
            .iter_mut()
            .flat_map(|p| p.iter_mut().zip(&moved))
        {
            *x = (x.0 + moved.0, x.1 + moved.1);
        }
        let mut sensors = Sensors::new(setup.robot, self.with, setup.velocity);
        sensors.resume(&run.rows[first].q, &run.rows[first].v);
        let inputs = Held {
            clock: &run.clock,
            values: &self.inputs,
        };
        for row in first + 1..=first + window {
            let (end, at) = run.clock.steps(run.hold + row);
            while step < end {
                let from = step as f64 * STEP;
                world.step(&inputs.over(self.with, from), from - begin);
                track
                    .places
                    .push((0..n).map(|j| world.encoder(j)).collect());
                step += 1;
            }
            let elapsed = run.clock.elapsed(run.hold + row);
            let (q, v) = sensors.read(&track, at, elapsed, None);
            for (j, sum) in sums.iter_mut().enumerate() {
                sum.0 += (q[j] - run.rows[row].q[j]).powi(2);
                sum.1 += (v[j] - run.rows[row].v[j]).powi(2);
            }
        }
    }
}
