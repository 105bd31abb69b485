//! A filter of first order, T dx/dt = y − x.

use crate::scalar::Scalar;

/// Share of the old value that is left after `dt`, s, of a filter with a time constant, s.
#[inline(always)]
pub fn kept<D: Scalar>(time: D, dt: f64) -> D {
    (time.inverse() * -dt).exponential()
}

/// A filter at `x` after `dt`, s, under the input `y`.
#[inline(always)]
pub fn after<D: Scalar>(x: D, y: D, time: D, dt: f64) -> D {
    y + (x - y) * kept(time, dt)
}
