//! Where what loops remember starts along the records: what recorded positions and targets make of it.
//!
//! No sensor reads these states, and nothing weighs them. A fit begins at them, and windows start there.

use pid_data::{Dataset, Experiment};
use pid_interpret::nominal::{Gain, Servo};

use super::drive::{LAGS, Memory};
use crate::drives::{Gains, Seen, integrated};

/// Coordinates of a memory along the records, in their order: the integrals of its value, from zero on. The inputs of
/// the joint are what its loop follows, `rates` the velocities of that.
pub(super) fn along(
    dataset: &Dataset,
    joint: usize,
    servo: &Servo,
    memory: Memory,
    rates: Option<&[&[f64]]>,
) -> Vec<Vec<f64>> {
    let own = dataset.experiments.iter().enumerate();
    own.map(|(i, e)| {
        let q = kept(&e.q, e.nq, joint);
        let value = match memory {
            Memory::Integral => {
                let r = kept(&e.u, e.nu(), joint);
                replayed(e, (joint, servo), (&r, &q), rates.map(|all| all[i]))
            }
            Memory::Lag => lag(e, servo, &q),
            Memory::Filter => filtered(e, servo, &q),
        };
        summed(&e.t, &value)
    })
    .collect()
}

/// The stated value of a time of a loop that has it.
fn time(servo: &Servo, gain: Gain) -> Option<f64> {
    let value = servo.has(gain).then(|| servo.gain(gain).value).flatten();
    value.filter(|time| *time > 0.0)
}

/// What the position that a loop reads lags.
fn lag(e: &Experiment, servo: &Servo, q: &[f64]) -> Vec<f64> {
    match time(servo, Gain::FeedbackDelay) {
        Some(late) => lagging(&e.t, q, 0.5 * late),
        None => vec![0.0; q.len()],
    }
}

/// The velocity behind the filter of a loop.
fn filtered(e: &Experiment, servo: &Servo, q: &[f64]) -> Vec<f64> {
    let Some(time) = time(servo, Gain::VelocityTime) else {
        return vec![0.0; q.len()];
    };
    let lags = lag(e, servo, q);
    let read: Vec<f64> = q.iter().zip(lags).map(|(q, lag)| q + LAGS * lag).collect();
    let behind = lagging(&e.t, &read, time);
    behind.into_iter().map(|x| x / time).collect()
}

/// The part of the integral of a loop that starts without one, by its law on targets and positions; gravity and inertia
/// that it feeds forward aside.
fn replayed(
    e: &Experiment,
    (joint, servo): (usize, &Servo),
    (r, q): (&[f64], &[f64]),
    rate: Option<&[f64]>,
) -> Vec<f64> {
    let mut k = Gains::of(|gain| servo.has(gain).then(|| servo.gain(gain).value).flatten());
    k.times(|gain| e.gain_factors.at(gain as usize, joint));
    let mut integral = 0.0;
    let mut out = Vec::with_capacity(q.len());
    for i in 0..q.len() {
        out.push(integral);
        let Some(next) = q.get(i + 1) else { break };
        let h = (e.t[i + 1] - e.t[i]).max(1e-9);
        let at = Seen {
            r: r[i],
            q: 0.5 * (q[i] + next),
            v: (next - q[i]) / h,
            ahead: k.ahead.unwrap_or(0.0) * rate.map_or(0.0, |rate| rate[i]),
            gravity: 0.0,
            inertia: 0.0,
        };
        integral = integrated(servo, &k, &at, (integral, h));
    }
    out
}

/// A column of samples of a width; a lost value is the one before.
fn kept(samples: &[f64], width: usize, column: usize) -> Vec<f64> {
    let own = samples.iter().skip(column).step_by(width.max(1)).copied();
    let first = own.clone().find(|x| x.is_finite()).unwrap_or(0.0);
    own.scan(first, |last, x| {
        *last = if x.is_finite() { x } else { *last };
        Some(*last)
    })
    .collect()
}

/// What a signal, straight from sample to sample and at rest before the first, is ahead of itself behind a filter of
/// first order.
fn lagging(t: &[f64], x: &[f64], time: f64) -> Vec<f64> {
    let mut lag = 0.0;
    let mut out = Vec::with_capacity(x.len());
    for i in 0..x.len() {
        if i > 0 {
            let h = (t[i] - t[i - 1]).max(1e-9);
            let rests = time * (x[i] - x[i - 1]) / h;
            lag = rests + (lag - rests) * (-h / time).exp();
        }
        out.push(lag);
    }
    out
}

/// Integral from the first sample on, by trapezoids.
fn summed(t: &[f64], rate: &[f64]) -> Vec<f64> {
    let mut sum = 0.0;
    let mut out = Vec::with_capacity(rate.len());
    for i in 0..rate.len() {
        if i > 0 {
            sum += 0.5 * (rate[i] + rate[i - 1]) * (t[i] - t[i - 1]);
        }
        out.push(sum);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_is_its_slope_times_the_time_ahead() {
        let t: Vec<f64> = (0..400).map(|k| 0.01 * f64::from(k)).collect();
        let x: Vec<f64> = t.iter().map(|t| 3.0 * t).collect();
        let lag = lagging(&t, &x, 0.05);
        assert!((lag[399] - 0.15).abs() < 1e-12, "{}", lag[399]);
        // 1 − exp(−t/T) of it on the way.
        let expected = 0.15 * (1.0 - (-1.0_f64).exp());
        assert!((lag[5] - expected).abs() < 1e-12);
        let way = summed(&t, &x);
        assert!((way[399] - 1.5 * t[399] * t[399]).abs() < 1e-12);
    }
}
