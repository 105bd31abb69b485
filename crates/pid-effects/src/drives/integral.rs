//! Integrals of laws that have one, within their limits.

use pid_interpret::nominal::{Servo, ServoLaw};

use super::{Gains, Seen, cascade, dead_band, pid, unlimited};
use crate::scalar::Scalar;

/// How fast the part of the integral grows where nothing is limited, in the unit of the input per second.
#[inline(always)]
pub fn growth<D: Scalar>(servo: &Servo, k: &Gains<D>, at: &Seen<D>) -> D {
    let (at, _) = dead_band::applied(servo, at);
    match servo.law {
        ServoLaw::Pid => pid::growth(k, &at),
        ServoLaw::Cascade => cascade::growth(servo, k, &at),
        _ => D::nil(),
    }
}

/// The part of the integral after a substep of length `dt`, s. It stops where the output is limited and
/// the error pushes further (conditional integration: K. J. Åström, L. Rundqwist, ACC 1989).
#[inline(always)]
pub fn integrated<D: Scalar>(
    servo: &Servo,
    k: &Gains<D>,
    at: &Seen<D>,
    (integral, dt): (D, f64),
) -> D {
    if !servo.law.integrates() {
        return integral;
    }
    let more = growth(servo, k, at) * dt;
    let free = unlimited(servo, k, at, integral).u.value();
    let limited = servo.limit.is_some_and(|limit| free.abs() > limit);
    if limited && free * more.value() > 0.0 {
        return integral;
    }
    clipped(servo, integral + more)
}

/// The part of the integral with which a loop at rest gives an input `u`.
pub fn at_rest<D: Scalar>(servo: &Servo, k: &Gains<D>, at: &Seen<D>, u: D) -> D {
    if !servo.law.integrates() {
        return D::nil();
    }
    clipped(servo, u - unlimited(servo, k, at, D::nil()).u)
}

/// Within the limit of the integral.
#[inline(always)]
fn clipped<D: Scalar>(servo: &Servo, integral: D) -> D {
    match servo.integral_limit {
        Some(most) => integral.limit(D::constant(-most), D::constant(most)),
        None => integral,
    }
}
