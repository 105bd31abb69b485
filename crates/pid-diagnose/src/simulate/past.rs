//! Positions and velocities of a drive before now, for a loop that reads its encoder late.

use std::collections::VecDeque;

use crate::effect::Pick;

/// What was at a moment.
#[derive(Debug, Clone, Copy)]
struct Moment<D> {
    /// s since the start of what was recorded.
    t: f64,
    q: D,
    v: D,
}

/// Positions and velocities up to now.
#[derive(Debug, Clone, Default)]
pub(super) struct Past<D>(VecDeque<Moment<D>>);

impl Past<f64> {
    /// The same as constants of another scalar.
    pub(super) fn lift<D: Pick>(&self) -> Past<D> {
        let lift = |own: &Moment<f64>| Moment {
            t: own.t,
            q: D::constant(own.q),
            v: D::constant(own.v),
        };
        Past(self.0.iter().map(lift).collect())
    }
}

impl<D: Pick> Past<D> {
    /// Nothing yet.
    pub(super) fn new() -> Self {
        Past(VecDeque::new())
    }

    /// Takes in what is at `t`; what is older than `delay` is forgotten, but for the last of that.
    #[inline(always)]
    pub(super) fn remember(&mut self, t: f64, (q, v): (D, D), delay: f64) {
        let known = self.0.back().is_some_and(|last| last.t >= t);
        if !known {
            self.0.push_back(Moment { t, q, v });
        }
        while self.0.get(1).is_some_and(|next| next.t <= t - delay) {
            self.0.pop_front();
        }
    }

    /// Takes in that position and velocity at the second of two times are corrected by so much: what was since the
    /// first is bent towards it, in proportion to the time. A reading of it would jump otherwise.
    #[inline(always)]
    pub(super) fn bend(&mut self, (from, to): (f64, f64), (q, v): (D, D)) {
        for own in self.0.iter_mut().rev().take_while(|own| own.t > from) {
            let share = ((own.t - from) / (to - from)).min(1.0);
            own.q += q * share;
            own.v += v * share;
        }
    }

    /// Position and velocity at `t`: cubic through positions and velocities, straight between velocities, and straight
    /// on before the first and after the last of them. Allocates nothing.
    #[inline(always)]
    pub(super) fn at(&self, t: D) -> Option<(D, D)> {
        let after = self.0.partition_point(|own| own.t <= t.value());
        let straight = |own: &Moment<D>| (own.q + own.v * (t - own.t), own.v);
        let (Some(b), true) = (self.0.get(after), after > 0) else {
            return self.0.get(after.saturating_sub(1)).map(straight);
        };
        let a = &self.0[after - 1];
        let h = b.t - a.t;
        let s = (t - a.t) / h;
        let (p, m, n) = (b.q - a.q, a.v * h, b.v * h);
        let (cubic, square) = (m + n - p * 2.0, p * 3.0 - m * 2.0 - n);
        Some((
            ((cubic * s + square) * s + m) * s + a.q,
            a.v + (b.v - a.v) * s,
        ))
    }
}

#[cfg(test)]
mod tests {
    use num_dual::Dual64;

    use super::*;

    /// A cubic motion is told exactly, with its derivative by the delay; its velocity to the square of a step.
    #[test]
    fn what_was_is_told() {
        let motion = |t: f64| 0.3 - 0.7 * t + 2.0 * t * t - 1.5 * t * t * t;
        let speed = |t: f64| -0.7 + 4.0 * t - 4.5 * t * t;
        let mut past = Past::<Dual64>::new();
        for i in 0..20 {
            // Steps of two lengths.
            let t = 0.1 * f64::from(i) + if i % 2 == 0 { 0.03 } else { 0.0 };
            let now = (Dual64::from(motion(t)), Dual64::from(speed(t)));
            past.remember(t, now, 0.45);
        }
        let now = 1.9;
        for delay in [0.05, 0.2, 0.31, 0.44] {
            let t = Dual64::new(now - delay, -1.0);
            let (q, v) = past.at(t).expect("a past");
            assert!((q.re - motion(now - delay)).abs() < 1e-12, "{delay}");
            let apart = v.re - speed(now - delay);
            assert!(apart.abs() < 9.0 / 8.0 * 0.13 * 0.13, "{delay} {apart}");
            assert!((q.eps + speed(now - delay)).abs() < 1e-12, "{delay}");
        }
        assert!(past.0.len() < 8, "{}", past.0.len());
        // Beyond both ends straight on.
        let last = past.at(Dual64::from(2.0)).expect("a past");
        assert!((last.0.re - (motion(1.9) + 0.1 * speed(1.9))).abs() < 1e-12);
        // A correction of the last moment is fully there, and not at all where it begins.
        let q = |past: &Past<Dual64>, t: f64| past.at(Dual64::from(t)).expect("a past").0.re;
        let before = [1.63, 1.9].map(|t| q(&past, t));
        past.bend((1.63, 1.9), (Dual64::from(0.1), Dual64::from(0.0)));
        let after = [1.63, 1.9].map(|t| q(&past, t));
        assert!((after[0] - before[0]).abs() < 1e-12, "{after:?} {before:?}");
        assert!(
            (after[1] - before[1] - 0.1).abs() < 1e-12,
            "{after:?} {before:?}"
        );
        assert!(Past::<Dual64>::new().at(Dual64::from(0.0)).is_none());
    }
}
