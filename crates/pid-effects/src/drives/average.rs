//! The average of what is followed over the time before: a profile with limited acceleration becomes one with limited
//! jerk (L. Biagiotti, C. Melchiorri, Control Engineering Practice 20, 2012).

use std::collections::VecDeque;

use super::profile::Motion;
use crate::scalar::Scalar;

/// What was followed from a moment on.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Moment<D> {
    /// s since the start of what was recorded.
    t: f64,
    /// Integral of the position up to then.
    sum: D,
    /// The position there, and by how much it moves in a second until the next moment.
    r: D,
    slope: D,
    /// The velocity as the drive has it there, and by how much it changes in a second until the next moment.
    rate: D,
    growth: D,
}

impl<D: Scalar> Moment<D> {
    /// The integral up to `t`, and position and velocity there.
    #[inline(always)]
    fn at(&self, t: D) -> (D, (D, D)) {
        let since = t - self.t;
        let moved = self.slope * since;
        let sum = self.sum + (self.r + moved * 0.5) * since;
        (sum, (self.r + moved, self.rate + self.growth * since))
    }
}

/// What was followed, as long as it counts.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Average<D> {
    /// Where it rested before the first moment.
    rest: D,
    past: VecDeque<Moment<D>>,
}

impl<D: Scalar> Average<D> {
    /// At rest for long.
    pub(super) fn at_rest(r: D) -> Self {
        Average {
            rest: r,
            past: VecDeque::new(),
        }
    }

    /// The same of another scalar.
    pub(super) fn map<E>(&self, of: impl Fn(D) -> E) -> Average<E> {
        let moment = |own: &Moment<D>| Moment {
            t: own.t,
            sum: of(own.sum),
            r: of(own.r),
            slope: of(own.slope),
            rate: of(own.rate),
            growth: of(own.growth),
        };
        Average {
            rest: of(self.rest),
            past: self.past.iter().map(moment).collect(),
        }
    }

    /// The averages over `time` until two moments of a step from `t`, during which `both` was followed there; `times`
    /// are those from `t` on, s, and the step goes to the second. Forgets what no longer counts. Allocates while the
    /// past grows, and not later.
    #[inline(always)]
    pub(super) fn after(
        &mut self,
        both: &[Motion<D>; 2],
        time: D,
        (t, times): (f64, [f64; 2]),
    ) -> [Motion<D>; 2] {
        let sum = self.past.back();
        let sum = sum.map_or_else(D::nil, |last| last.at(D::constant(t)).0);
        // A straight way through the middle and the end; a target that jumps stands.
        let [middle, end] = both;
        let straight = |middle: D, end: D| {
            let slope = match times[1] > times[0] {
                true => (end - middle) / (times[1] - times[0]),
                false => D::nil(),
            };
            (end - slope * times[1], slope)
        };
        let (r, slope) = straight(middle.r, end.r);
        let (rate, growth) = straight(middle.rate, end.rate);
        let now = Moment {
            t,
            sum,
            r,
            slope,
            rate,
            growth,
        };
        self.past.push_back(now);
        let until = t - time.value();
        while self.past.get(1).is_some_and(|next| next.t <= until) {
            self.past.pop_front();
        }
        [(0, middle), (1, end)].map(|(i, own)| {
            let until = now.at(D::constant(t + times[i])).0;
            let (before, was) = self.at(-time + (t + times[i]));
            Motion {
                r: (until - before) / time,
                rate: (own.r - was.0) / time,
                acceleration: (own.rate - was.1) / time,
            }
        })
    }

    /// The integral up to a moment, and position and velocity there.
    #[inline(always)]
    fn at(&self, t: D) -> (D, (D, D)) {
        let later = self.past.partition_point(|own| own.t <= t.value());
        match later.checked_sub(1).and_then(|i| self.past.get(i)) {
            Some(own) => own.at(t),
            None => {
                let first = self.past.front().map_or(0.0, |own| own.t);
                let sum = self.past.front().map_or(D::nil(), |own| own.sum);
                (sum + self.rest * (t - first), (self.rest, D::nil()))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use num_dual::Dual64;

    use super::*;

    /// A target that moves on at a constant velocity from 0.1 s on.
    fn ramp(time: f64) -> Vec<(f64, Motion<Dual64>)> {
        let (time, dt) = (Dual64::new(time, 1.0), 0.002);
        let mut average = Average::at_rest(Dual64::from(0.0));
        let at = |t: f64| Motion {
            r: Dual64::from((t - 0.1).max(0.0)),
            rate: Dual64::from(if t > 0.1 { 1.0 } else { 0.0 }),
            acceleration: Dual64::from(0.0),
        };
        let steps = 0..200;
        let step = |i: i32| {
            let t = dt * f64::from(i);
            let both = [at(t + 0.5 * dt), at(t + dt)];
            let [_, end] = average.after(&both, time, (t, [0.5 * dt, dt]));
            (t + dt, end)
        };
        steps.map(step).collect()
    }

    #[test]
    fn an_average_lags_by_half_its_time() {
        for (t, at) in ramp(0.05) {
            let since = (t - 0.1).clamp(0.0, 0.05);
            let early = since * since / (2.0 * 0.05);
            let exact = early + (t - 0.15).max(0.0);
            assert!((at.r.re - exact).abs() < 1e-4, "{t}: {at:?} {exact}");
            // The velocity goes up along a straight line, and the acceleration is that of it.
            assert!((at.rate.re - since / 0.05).abs() < 1e-9, "{t}: {at:?}");
            // Of t − T/2 by T.
            if t > 0.16 {
                assert!((at.r.eps + 0.5).abs() < 1e-6, "{t}: {at:?}");
                assert!(at.acceleration.re.abs() < 1e-9, "{t}: {at:?}");
            } else if t > 0.104 && t < 0.148 {
                assert!((at.acceleration.re - 20.0).abs() < 1e-6, "{t}: {at:?}");
            }
        }
    }
}
