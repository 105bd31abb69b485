//! With an integral of the error: u = kp (r − q) − kd v + w, dw/dt = ki (r − q).

use pid_interpret::nominal::Servo;

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

#[inline(always)]
pub(super) fn integrated<D: Scalar>(
    servo: &Servo,
    k: &Gains<D>,
    at: &Seen<D>,
    (integral, dt): (D, f64),
) -> D {
    let more = k.ki * (at.r - at.q) * dt;
    let free = output(k, at, integral).u.value();
    let limited = servo.limit.is_some_and(|limit| free.abs() > limit);
    if limited && free * more.value() > 0.0 {
        return integral;
    }
    clipped(servo, integral + more)
}

/// Within the limit of the integral.
#[inline(always)]
pub(super) fn clipped<D: Scalar>(servo: &Servo, integral: D) -> D {
    match servo.integral_limit {
        Some(most) => integral.limit(D::constant(-most), D::constant(most)),
        None => integral,
    }
}
