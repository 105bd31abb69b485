//! An error within the dead band counts as none, of a larger one counts what is beyond.

use pid_interpret::nominal::Servo;

use super::Seen;
use crate::scalar::Scalar;

/// What the law sees, and whether the error moves with the position.
#[inline(always)]
pub(super) fn applied<D: Scalar>(servo: &Servo, at: &Seen<D>) -> (Seen<D>, bool) {
    let Some(band) = servo.dead_band else {
        return (*at, true);
    };
    let error = at.r - at.q;
    let open = error.value().abs() > band;
    let within = error.limit(D::constant(-band), D::constant(band));
    let r = at.r - within;
    (Seen { r, ..*at }, open)
}
