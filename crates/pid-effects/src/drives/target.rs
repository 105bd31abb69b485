//! Shaping of a target before the loop follows it: steps, a lower rate, a largest speed, a filter; and its velocity.

use pid_interpret::nominal::Servo;

use super::{Gains, filter};
use crate::scalar::Scalar;

/// What shaping remembers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shaped<D> {
    /// The target that was taken last.
    taken: D,
    /// When the next one is taken, s since the start of what was recorded.
    due: f64,
    /// Behind the largest speed.
    slewed: D,
    /// Behind the filter.
    filtered: D,
    /// What its velocity is taken from.
    moving: Moving<D>,
}

/// The velocity of a target.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Moving<D> {
    /// The target that was taken before, at a lower rate, and when, s since the start of what was recorded.
    before: (D, f64),
    /// When the next one is taken.
    due: f64,
    rate: D,
    /// Behind the filter.
    filtered: D,
}

/// What a loop follows at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point<D> {
    /// Position.
    pub r: D,
    /// The share of its velocity that is fed forward; zero where none is.
    pub rate: D,
}

impl<D: Scalar> Shaped<D> {
    /// Where everything rests at a target.
    pub fn at_rest(r: D) -> Self {
        Shaped {
            taken: r,
            due: f64::NEG_INFINITY,
            slewed: r,
            filtered: r,
            moving: Moving {
                before: (r, f64::NEG_INFINITY),
                due: f64::NEG_INFINITY,
                rate: D::nil(),
                filtered: D::nil(),
            },
        }
    }

    /// The same of another scalar.
    pub fn map<E>(&self, of: impl Fn(D) -> E) -> Shaped<E> {
        Shaped {
            taken: of(self.taken),
            due: self.due,
            slewed: of(self.slewed),
            filtered: of(self.filtered),
            moving: Moving {
                before: (of(self.moving.before.0), self.moving.before.1),
                due: self.moving.due,
                rate: of(self.moving.rate),
                filtered: of(self.moving.filtered),
            },
        }
    }
}

/// The nearest multiple of the step; it moves with the target as if there were none.
fn stepped<D: Scalar>(servo: &Servo, r: D) -> D {
    match servo.shaping.step {
        Some(step) => r + ((r.value() / step).round() * step - r.value()),
        None => r,
    }
}

/// Start of the period after that in which `t` lies, within `slack`.
fn next_period(t: f64, period: f64, slack: f64) -> f64 {
    (((t + slack) / period).floor() + 1.0) * period
}

/// Moves the memory on by `dt` from `t` (s, since the start of what was recorded) under the target `r` and its
/// velocity.
/// Returns what the loop follows: `lead` beyond the middle of that time, at most at its end, and at its end. A loop
/// that reads has its target moved on by a whole period before it holds its output: by half of one on average.
#[inline(always)]
pub fn followed<D: Scalar>(
    servo: &Servo,
    k: &Gains<D>,
    memory: &mut Shaped<D>,
    (r, rate): (D, D),
    (t, dt): (f64, f64),
    lead: f64,
) -> [Point<D>; 2] {
    let middle = (0.5 * dt + lead).min(dt);
    let times = [middle, dt];
    let rates = velocity(servo, k, &mut memory.moving, (r, rate), (t, times));
    let positions = match k.shapes(servo) {
        true => position(servo, k, memory, r, (t, times)),
        false => [r, r],
    };
    [0, 1].map(|i| Point {
        r: positions[i],
        rate: rates[i],
    })
}

/// Position of what is followed after the two times from `t`; the memory goes to the second.
#[inline(always)]
fn position<D: Scalar>(
    servo: &Servo,
    k: &Gains<D>,
    memory: &mut Shaped<D>,
    r: D,
    (t, times): (f64, [f64; 2]),
) -> [D; 2] {
    match servo.shaping.rate_hz {
        None => memory.taken = stepped(servo, r),
        Some(rate) => {
            // Targets are taken at whole periods since the record began, however the run began.
            let slack = 1e-3 * times[1];
            if t >= memory.due - slack {
                memory.taken = stepped(servo, r);
                memory.due = next_period(t, 1.0 / rate, slack);
            }
        }
    }
    let mut both = match k.target_speed {
        None => [memory.taken; 2],
        Some(speed) => times.map(|time| {
            let most = speed * time;
            memory.slewed + (memory.taken - memory.slewed).limit(-most, most)
        }),
    };
    memory.slewed = both[1];
    if let Some(time) = k.target_time {
        both = [0, 1].map(|i| filter::after(memory.filtered, both[i], time, times[i]));
        memory.filtered = both[1];
    }
    both
}

/// The share of its velocity that is fed forward, at the same times, within the largest speed and behind the filter.
/// Targets that are taken at a lower rate go from one that is taken to the next.
#[inline(always)]
fn velocity<D: Scalar>(
    servo: &Servo,
    k: &Gains<D>,
    memory: &mut Moving<D>,
    (r, rate): (D, D),
    (t, times): (f64, [f64; 2]),
) -> [D; 2] {
    let Some(share) = k.ahead else {
        return [D::nil(); 2];
    };
    let slack = 1e-3 * times[1];
    match servo.shaping.rate_hz {
        None => memory.rate = rate,
        Some(hz) if t >= memory.due - slack => {
            let (before, at) = memory.before;
            if at.is_finite() {
                memory.rate = (r - before) / (t - at);
            }
            memory.before = (r, t);
            memory.due = next_period(t, 1.0 / hz, slack);
        }
        Some(_) => {}
    }
    let rate = match k.target_speed {
        Some(speed) => memory.rate.limit(-speed, speed),
        None => memory.rate,
    };
    let mut both = [rate; 2];
    if let Some(time) = k.target_time {
        both = times.map(|after| filter::after(memory.filtered, rate, time, after));
        memory.filtered = both[1];
    }
    both.map(|rate| share * rate)
}
