//! Proportional with damping by the velocity: u = kp (r − q) − kd (v − f), f a share of the target's velocity.

use super::{Gains, Output, Seen, p};
use crate::scalar::Scalar;

#[inline(always)]
pub(super) fn output<D: Scalar>(k: &Gains<D>, at: &Seen<D>) -> Output<D> {
    let own = p::output(k, at);
    Output {
        u: own.u - k.kd * (at.v - at.ahead),
        damping: k.kd,
        ..own
    }
}
