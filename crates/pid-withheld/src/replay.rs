//! Free runs of the true robot with some of its causes, and what each cause has of the gap.
//!
//! G(S) is the free-run gap with the causes S at their true size: each record is cut into windows,
//! and from the true state at the start of a window the robot runs under the recorded inputs. Its
//! readings without noise are compared with the recorded ones; the squared error is divided by the
//! variance of the channel in the record, then averaged over joints, channels and records. Where
//! causes are missing, the nominal values are fitted to the same windows within their tolerances (see
//! [`refit`](crate::refit)): what these take up is no gap. Encoders that S takes for right show the
//! start: an offset outside S moves the start, as it does for everyone who reads it.
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
use crate::refit::Refit;
use crate::sensors::{Sensors, Track, sensed};
use crate::world::{STEP, World};

/// A relative error beyond this counts as this.
const LARGEST: f64 = 10.0;
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
        let all = mean_square(&errors(setup, runs, window, &|_| true));
        let refit = (count > 0).then(|| Refit::new(setup, runs, window, all));
        let square = |on: &(dyn Fn(usize) -> bool + Sync)| match &refit {
            None => all,
            Some(refit) => refit.square(setup, runs, window, on),
        };
        let none = square(&|_| false).max(all);
        let whole = (none - all).max(1e-300);
        let mut parts: Vec<Part> = (0..count)
            .map(|e| {
                let (without, alone) = match count {
                    1 => (none, all),
                    _ => (square(&|i| i != e), square(&|i| i == e)),
                };
                // What the nominal values take up is nothing, and no less.
                let part = |x: f64| (x / whole).clamp(0.0, 1.0);
                let (left_out, left_in) = (part(without - all), part(none - alone));
                Part {
                    share: 0.5 * (left_out + left_in),
                    left_out,
                    left_in,
                }
            })
            .collect();
        let sum: f64 = parts.iter().map(|p| p.share).sum();
        for p in &mut parts {
            p.share = if sum > 0.0 {
                p.share / sum
            } else {
                1.0 / count as f64
            };
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
            none: LARGEST * LARGEST,
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

/// Relative errors of free runs with the causes that are `on`, each over the root of their number, so that
/// the sum of their squares is the squared gap.
pub(crate) fn errors(
    setup: &Setup<'_>,
    runs: &[Run],
    window: usize,
    on: &dyn Fn(usize) -> bool,
) -> Vec<f64> {
    let mut all = Vec::new();
    for run in runs {
        of_record(setup, run, window, on, &mut all);
    }
    let share = 1.0 / (runs.len() as f64).sqrt();
    all.iter_mut().for_each(|e| *e *= share);
    all
}

/// The squared gap of [`errors`].
pub(crate) fn mean_square(errors: &[f64]) -> f64 {
    errors.iter().map(|e| e * e).sum()
}

fn of_record(
    setup: &Setup<'_>,
    run: &Run,
    window: usize,
    on: &dyn Fn(usize) -> bool,
    all: &mut Vec<f64>,
) {
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
    let channels = if setup.velocity == "absent" { n } else { 2 * n };
    let count = (run.rows.len() - 1) / window;
    let number = (count * window * channels).max(1) as f64;
    let deviation = |channel: &dyn Fn(usize) -> f64| variance(run.rows.len(), channel).sqrt();
    let sizes: Vec<(f64, f64)> = (0..n)
        .map(|j| {
            (
                deviation(&|k| run.rows[k].q[j]),
                deviation(&|k| run.rows[k].v[j]),
            )
        })
        .collect();
    let mut add = |j: usize, (q, v): (f64, f64)| {
        let relative = |e: f64| {
            let e = if e.is_finite() { e } else { LARGEST };
            e.clamp(-LARGEST, LARGEST) / number.sqrt()
        };
        all.push(relative(q / sizes[j].0));
        if channels > n {
            all.push(relative(v / sizes[j].1));
        }
    };
    for i in 0..count {
        replay.window(i, window, &mut add);
    }
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
    /// Adds the errors of the positions and velocities of the `i`-th window, joint by joint.
    fn window(&self, i: usize, window: usize, add: &mut dyn FnMut(usize, (f64, f64))) {
        let Self { setup, run, .. } = self;
        let n = setup.robot.joints.len();
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
            for j in 0..n {
                add(j, (q[j] - run.rows[row].q[j], v[j] - run.rows[row].v[j]));
            }
        }
    }
}
