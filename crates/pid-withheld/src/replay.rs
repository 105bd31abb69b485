//! Free runs of the true robot with some of its causes.
//!
//! G(S) is the free-run gap with the causes S at their true size: each record is cut into windows,
//! and from the true state at the start of a window the robot runs under the recorded inputs. Its
//! readings without noise are compared with the recorded ones; the squared error is divided by the
//! variance of the channel in the record, then averaged over joints, channels and records. Where
//! causes are missing, the nominal values are fitted to the same windows within their tolerances (see
//! [`refit`](crate::refit)): what these take up is no gap. Encoders that S takes for right show the
//! start: an offset outside S moves the start, as it does for everyone who reads it.

use crate::causes::{Cause, Kind};
use crate::record::{Held, Run};
use crate::sensors::{Sensors, Track, sensed};
use crate::setup::Setup;
use crate::world::{STEP, World};

/// A relative error beyond this counts as this.
pub(crate) const LARGEST: f64 = 10.0;
/// Steps of the encoders' past that a late sensor may ask for: 0.2 s.
const PAST: usize = 2000;

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
