//! A loop of the position around one of the velocity: w = kp (r − q) + f within ± velocity_limit with
//! a share f of the target's velocity, u = kv (w − v) + z, dz/dt = ki (w − v) (W. Leonhard, Control of
//! Electrical Drives, 2001, chapter 15).
//! The loop of the current inside is a lag of the input: the effect `actuator_lag`.

use pid_interpret::nominal::Servo;

use super::{Gains, Output, Seen};
use crate::scalar::Scalar;

/// The velocity that the loop of the position asks for, and by how much it falls per unit of the position.
#[inline(always)]
fn wanted<D: Scalar>(servo: &Servo, k: &Gains<D>, at: &Seen<D>) -> (D, D) {
    let free = k.kp * (at.r - at.q) + at.ahead;
    match servo.velocity_limit {
        Some(most) => {
            let slope = if free.value().abs() > most {
                D::nil()
            } else {
                k.kp
            };
            (free.limit(D::constant(-most), D::constant(most)), slope)
        }
        None => (free, k.kp),
    }
}

#[inline(always)]
pub(super) fn output<D: Scalar>(
    servo: &Servo,
    k: &Gains<D>,
    at: &Seen<D>,
    integral: D,
) -> Output<D> {
    let (w, slope) = wanted(servo, k, at);
    Output {
        u: k.kv * (w - at.v) + integral,
        stiffness: k.kv * slope,
        damping: k.kv,
    }
}

/// Growth of the integral.
#[inline(always)]
pub(super) fn growth<D: Scalar>(servo: &Servo, k: &Gains<D>, at: &Seen<D>) -> D {
    k.ki * (wanted(servo, k, at).0 - at.v)
}
