//! Targets as loops follow them: what becomes of a recorded target in the stages before its loop.
//!
//! Steps, lower rates, largest speeds, profiles, averages and filters of a target depend on the target alone, so they
//! act on the records with the values that are stated, and the equations of motion have what comes out as input.

use pid_data::{Dataset, Experiment, InputHold};
use pid_interpret::nominal::{Gain, Servo};

use crate::drives::Gains;
use crate::drives::target::{Motion, Shaped, followed};

/// Longest step of a stage, s: a twentieth of the fastest filter of a target that drives have, 10 ms.
const STEP: f64 = 5e-4;
/// Fewest steps of a stage from one sample to the next.
const FEWEST: f64 = 4.0;

/// Target, its velocity and its acceleration, sample by sample.
pub(super) struct Followed {
    pub(super) r: Vec<f64>,
    pub(super) rate: Vec<f64>,
    pub(super) acceleration: Vec<f64>,
}

impl Followed {
    fn push(&mut self, own: Motion<f64>) {
        self.r.push(own.r);
        self.rate.push(own.rate);
        self.acceleration.push(own.acceleration);
    }
}

/// What the loop of a joint follows along the records, in their order.
pub(super) fn along(dataset: &Dataset, joint: usize, servo: &Servo) -> Vec<Followed> {
    let linear = dataset.input_hold == InputHold::Linear;
    let own = dataset.experiments.iter();
    own.map(|e| along_record(e, joint, servo, linear)).collect()
}

/// The same along one record. A held input is what the loop follows in the mean until the next sample, one that goes
/// straight between samples is that at the sample.
fn along_record(e: &Experiment, joint: usize, servo: &Servo, linear: bool) -> Followed {
    let target: Vec<f64> =
        e.u.iter()
            .skip(joint)
            .step_by(e.nu().max(1))
            .copied()
            .collect();
    let k = Gains::of(|gain| {
        servo
            .has(gain)
            .then(|| servo.gain(gain).value.unwrap_or(0.0))
    });
    let first = target.iter().copied().find(|r| r.is_finite());
    let mut memory = Shaped::at_rest(first.unwrap_or(0.0));
    let mut moves = Motion::at_rest(first.unwrap_or(0.0));
    let mut out = Followed {
        r: Vec::with_capacity(target.len()),
        rate: Vec::with_capacity(target.len()),
        acceleration: Vec::with_capacity(target.len()),
    };
    for i in 0..target.len() {
        let span = |i: usize| e.t[i + 1] - e.t[i];
        let last = target.len() < i + 2;
        let dt = match last {
            true => e.sample_time(),
            false => span(i),
        };
        let next = target[if last { i } else { i + 1 }];
        if !(target[i].is_finite() && next.is_finite() && dt > 0.0) {
            // A lost target stays lost; the loop goes on with the one before.
            out.push(Motion::at_rest(target[i]));
            continue;
        }
        let rate = match (linear, i) {
            (true, _) => (next - target[i]) / dt,
            (false, 0) => 0.0,
            (false, _) => (target[i] - moves.r) / span(i - 1),
        };
        let since = if i == 0 || linear { dt } else { span(i - 1) };
        let own = Motion {
            r: target[i],
            rate,
            acceleration: (rate - moves.rate) / since,
        };
        moves = own;
        let steps = (dt / STEP).ceil().max(FEWEST);
        let step = dt / steps;
        let mut mean = Motion::at_rest(0.0);
        let mut start = None;
        for n in 0..steps as usize {
            let after = step * n as f64;
            let now = Motion {
                r: if linear { own.r + rate * after } else { own.r },
                ..own
            };
            let t = e.t[i] - e.t[0] + after;
            let [middle, end] = followed(servo, &k, &mut memory, &now, (t, step), 0.0);
            mean.r += middle.r / steps;
            mean.rate += middle.rate / steps;
            mean.acceleration += middle.acceleration / steps;
            start.get_or_insert(end);
        }
        out.push(match start {
            Some(start) if linear => start,
            _ => mean,
        });
    }
    out
}

/// Puts what the loop of a joint follows in place of its target.
pub(super) fn put(dataset: &mut Dataset, joint: usize, followed: &[Followed]) {
    for (e, own) in dataset.experiments.iter_mut().zip(followed) {
        let nu = e.nu();
        let targets = e.u.iter_mut().skip(joint).step_by(nu.max(1));
        targets.zip(&own.r).for_each(|(u, r)| *u = *r);
    }
}

/// Adds a column, one for each record, as the last input.
pub(super) fn add_input<'r>(dataset: &mut Dataset, columns: impl Iterator<Item = &'r [f64]>) {
    for (e, own) in dataset.experiments.iter_mut().zip(columns) {
        let rows = e.u.chunks_exact(e.nu().max(1));
        let wide = rows.zip(own).flat_map(|(row, more)| {
            let more = [*more];
            row.iter().copied().chain(more).collect::<Vec<f64>>()
        });
        e.u = wide.collect();
    }
}

/// Whether a stage changes the target of a loop.
pub(super) fn shapes(servo: &Servo) -> bool {
    Gains::of(|gain: Gain| servo.has(gain).then_some(1.0)).shapes(servo)
}
