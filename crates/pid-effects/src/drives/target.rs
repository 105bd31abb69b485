//! Shaping of a target before the loop follows it: steps, a lower rate, a largest speed, a profile, an average, a
//! filter; and its velocity and acceleration.

use pid_interpret::nominal::Servo;

pub use super::profile::Motion;

use super::average::Average;
use super::{Gains, filter, profile};
use crate::scalar::Scalar;

/// What shaping remembers.
#[derive(Debug, Clone, PartialEq)]
pub struct Shaped<D> {
    /// The target that was taken last.
    taken: D,
    /// When the next one is taken, s since the start of what was recorded.
    due: f64,
    /// What its velocity is taken from.
    moving: Moving<D>,
    /// Behind the largest speed and the profile.
    goes: Motion<D>,
    /// What is averaged.
    average: Average<D>,
    /// Behind the filter.
    filtered: Motion<D>,
}

/// The velocity of a target.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Moving<D> {
    /// The target that was taken before, at a lower rate, and when, s since the start of what was recorded.
    before: (D, f64),
    /// When the next one is taken.
    due: f64,
    rate: D,
    acceleration: D,
}

impl<D: Scalar> Shaped<D> {
    /// Where everything rests at a target.
    pub fn at_rest(r: D) -> Self {
        Shaped {
            taken: r,
            due: f64::NEG_INFINITY,
            moving: Moving {
                before: (r, f64::NEG_INFINITY),
                due: f64::NEG_INFINITY,
                rate: D::nil(),
                acceleration: D::nil(),
            },
            goes: Motion::at_rest(r),
            average: Average::at_rest(r),
            filtered: Motion::at_rest(r),
        }
    }

    /// The same of another scalar.
    pub fn map<E>(&self, of: impl Fn(D) -> E) -> Shaped<E> {
        Shaped {
            taken: of(self.taken),
            due: self.due,
            moving: Moving {
                before: (of(self.moving.before.0), self.moving.before.1),
                due: self.moving.due,
                rate: of(self.moving.rate),
                acceleration: of(self.moving.acceleration),
            },
            goes: self.goes.map(&of),
            average: self.average.map(&of),
            filtered: self.filtered.map(&of),
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

/// Moves the memory on by `dt` from `t` (s, since the start of what was recorded) under a target with its velocity and
/// acceleration.
/// Returns what the loop follows: `lead` beyond the middle of that time, at most at its end, and at its end. A loop
/// that reads has its target moved on by a whole period before it holds its output: by half of one on average.
#[inline(always)]
pub fn followed<D: Scalar>(
    servo: &Servo,
    k: &Gains<D>,
    memory: &mut Shaped<D>,
    target: &Motion<D>,
    (t, dt): (f64, f64),
    lead: f64,
) -> [Motion<D>; 2] {
    let middle = (0.5 * dt + lead).min(dt);
    let times = [middle, dt];
    let mut own = moving(servo, &mut memory.moving, target, (t, dt));
    if !k.shapes(servo) {
        return [own; 2];
    }
    own.r = taken(servo, memory, target.r, (t, dt));
    let mut both = match (k.target_acceleration, k.target_speed) {
        (Some(a), most) => times.map(|time| profile::after(&memory.goes, own.r, (most, a), time)),
        (None, Some(speed)) => times.map(|time| slewed(memory.goes.r, &own, speed, time)),
        (None, None) => [own; 2],
    };
    memory.goes = both[1];
    if let Some(time) = k.target_average {
        both = memory.average.after(&both, time, (t, times));
    }
    if let Some(time) = k.target_time {
        both = [0, 1].map(|i| filtered(&memory.filtered, &both[i], time, times[i]));
        memory.filtered = both[1];
    }
    both
}

/// What is left of a motion behind a filter of first order, after `dt`.
#[inline(always)]
fn filtered<D: Scalar>(before: &Motion<D>, own: &Motion<D>, time: D, dt: f64) -> Motion<D> {
    let rate = filter::after(before.rate, own.rate, time, dt);
    Motion {
        r: filter::after(before.r, own.r, time, dt),
        rate,
        acceleration: (own.rate - rate) / time,
    }
}

/// What goes to a target at a speed at most; beyond that speed it is not accelerated.
#[inline(always)]
fn slewed<D: Scalar>(from: D, own: &Motion<D>, speed: D, time: f64) -> Motion<D> {
    let most = speed * time;
    let slow = own.rate.value().abs() <= speed.value();
    Motion {
        r: from + (own.r - from).limit(-most, most),
        rate: own.rate.limit(-speed, speed),
        acceleration: if slow { own.acceleration } else { D::nil() },
    }
}

/// The target that is taken, at whole periods since the record began, however the run began.
#[inline(always)]
fn taken<D: Scalar>(servo: &Servo, memory: &mut Shaped<D>, r: D, (t, dt): (f64, f64)) -> D {
    let slack = 1e-3 * dt;
    match servo.shaping.rate_hz {
        None => memory.taken = stepped(servo, r),
        Some(rate) if t >= memory.due - slack => {
            memory.taken = stepped(servo, r);
            memory.due = next_period(t, 1.0 / rate, slack);
        }
        Some(_) => {}
    }
    memory.taken
}

/// A target with its velocity and acceleration as the drive has them. Targets that are taken at a lower rate go from
/// one that is taken to the next.
#[inline(always)]
fn moving<D: Scalar>(
    servo: &Servo,
    memory: &mut Moving<D>,
    target: &Motion<D>,
    (t, dt): (f64, f64),
) -> Motion<D> {
    let Some(hz) = servo.shaping.rate_hz else {
        return *target;
    };
    let slack = 1e-3 * dt;
    if t >= memory.due - slack {
        let (before, at) = memory.before;
        if at.is_finite() {
            let rate = (target.r - before) / (t - at);
            memory.acceleration = (rate - memory.rate) / (t - at);
            memory.rate = rate;
        }
        memory.before = (target.r, t);
        memory.due = next_period(t, 1.0 / hz, slack);
    }
    Motion {
        r: target.r,
        rate: memory.rate,
        acceleration: memory.acceleration,
    }
}
