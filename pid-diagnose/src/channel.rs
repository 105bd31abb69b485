//! The velocity channel judged by itself: does the reading follow from the positions as stated?

use crate::case::{Case, Velocity};

/// What the velocity channel of one joint says.
#[derive(Debug, Clone, PartialEq)]
pub struct Consistency {
    /// Root mean square mismatch between the reading and what the positions give through the stated filter, relative to the
    /// standard deviation of the reading.
    pub mismatch: f64,
    /// The same with an additional first-order lag.
    pub with_lag: f64,
    /// Time constant of that lag, s.
    pub lag: f64,
    /// Whether the plain mismatch is more than rounding can explain.
    pub lagging: bool,
}

/// Rounding of the files and of the drives: a mismatch below this share of the motion says nothing.
const NEGLIGIBLE: f64 = 5e-3;

/// Judges every joint with a derived velocity whose filter is stated; `None` for the others.
pub fn consistency(case: &Case) -> Vec<Option<Consistency>> {
    (0..case.n())
        .map(|j| {
            let hz = case.nominal.velocity_filter_hz?;
            if case.velocity[j] != Velocity::Derived {
                return None;
            }
            let plain = mismatch(case, j, hz, 0.0);
            // Golden section over the logarithm of the time constant.
            let (mut a, mut b) = ((1e-4f64).ln(), (0.5f64).ln());
            let ratio = 0.618_033_988_75;
            for _ in 0..40 {
                let (c, d) = (b - ratio * (b - a), a + ratio * (b - a));
                if mismatch(case, j, hz, c.exp()) < mismatch(case, j, hz, d.exp()) {
                    b = d;
                } else {
                    a = c;
                }
            }
            let lag = (0.5 * (a + b)).exp();
            let with_lag = mismatch(case, j, hz, lag);
            Some(Consistency {
                mismatch: plain,
                with_lag,
                lag,
                lagging: plain > NEGLIGIBLE && with_lag < 0.5 * plain,
            })
        })
        .collect()
}

fn mismatch(case: &Case, j: usize, hz: f64, lag: f64) -> f64 {
    let (mut square, mut size) = (0.0, 0.0);
    for r in &case.records {
        let fade = (-2.0 * std::f64::consts::PI * hz * r.h).exp();
        let late = if lag > 0.0 { (-r.h / lag).exp() } else { 0.0 };
        let (mut w, mut x) = (r.v[j][0], r.v[j][0]);
        for k in 1..r.len() {
            let (q, before, v) = (r.q[j][k], r.q[j][k - 1], r.v[j][k]);
            if !(q.is_finite() && before.is_finite() && v.is_finite()) {
                continue;
            }
            w = fade * w + (1.0 - fade) * (q - before) / r.h;
            x = late * x + (1.0 - late) * w;
            if k as f64 * r.h > 0.3 {
                square += (x - v).powi(2);
                size += v * v;
            }
        }
    }
    (square / f64::max(size, 1e-300)).sqrt()
}
