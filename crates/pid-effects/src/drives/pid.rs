//! With an integral of the error: u = kp (r − q) − kd (v − f) + z, dz/dt = ki (r − q).

use super::{Gains, Output, Seen, pd};
use crate::scalar::Scalar;

#[inline(always)]
pub(super) fn output<D: Scalar>(k: &Gains<D>, at: &Seen<D>, integral: D) -> Output<D> {
    let own = pd::output(k, at);
    Output {
        u: own.u + integral,
        ..own
    }
}

/// Growth of the integral.
#[inline(always)]
pub(super) fn growth<D: Scalar>(k: &Gains<D>, at: &Seen<D>) -> D {
    k.ki * (at.r - at.q)
}
