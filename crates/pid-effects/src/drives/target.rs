//! Shaping of a target before the loop follows it: steps, a lower rate, a largest speed, a filter.

use pid_interpret::nominal::{Gain, Servo};

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
}

impl<D: Scalar> Shaped<D> {
    /// Where everything rests at a target.
    pub fn at_rest(r: D) -> Self {
        Shaped {
            taken: r,
            due: f64::NEG_INFINITY,
            slewed: r,
            filtered: r,
        }
    }

    /// The same of another scalar.
    pub fn map<E>(&self, of: impl Fn(D) -> E) -> Shaped<E> {
        Shaped {
            taken: of(self.taken),
            due: self.due,
            slewed: of(self.slewed),
            filtered: of(self.filtered),
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

/// Moves the memory on by `dt` from `t` (s, since the start of what was recorded) under the target `r`.
/// Returns what the loop follows: `lead` beyond the middle of that time, at most at its end, and at its end. A loop
/// that reads has its target moved on by a whole period before it holds its output: by half of one on average.
#[inline(always)]
pub fn followed<D: Scalar>(
    servo: &Servo,
    k: &Gains<D>,
    memory: &mut Shaped<D>,
    r: D,
    (t, dt): (f64, f64),
    lead: f64,
) -> [D; 2] {
    let middle = (0.5 * dt + lead).min(dt);
    if !servo.shapes() {
        return [r, r];
    }
    match servo.shaping.rate_hz {
        None => memory.taken = stepped(servo, r),
        Some(rate) => {
            // Targets are taken at whole periods since the record began, however the run began.
            let slack = 1e-3 * dt;
            if t >= memory.due - slack {
                memory.taken = stepped(servo, r);
                memory.due = (((t + slack) * rate).floor() + 1.0) / rate;
            }
        }
    }
    let mut both = match servo.shaping.speed {
        None => [memory.taken; 2],
        Some(speed) => [middle, dt].map(|time| {
            let most = D::constant(speed * time);
            memory.slewed + (memory.taken - memory.slewed).limit(-most, most)
        }),
    };
    memory.slewed = both[1];
    if servo.has(Gain::TargetTime) {
        let [first, end] = both;
        both = [
            filter::after(memory.filtered, first, k.target_time, middle),
            filter::after(memory.filtered, end, k.target_time, dt),
        ];
        memory.filtered = both[1];
    }
    both
}
