//! Proportional: u = kp (r − q).

use super::{Gains, Output, Seen};
use crate::scalar::Scalar;

#[inline(always)]
pub(super) fn output<D: Scalar>(k: &Gains<D>, at: &Seen<D>) -> Output<D> {
    Output {
        u: k.kp * (at.r - at.q),
        stiffness: k.kp,
        damping: D::nil(),
    }
}
