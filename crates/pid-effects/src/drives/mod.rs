//! Laws of the position loop inside a drive: one file per law, over any scalar.
//!
//! Behind such a loop the input of a joint is a target position r, and what acts is
//!
//! ```text
//! target r -> effects on the command -> law on the read position and velocity, within ± limit
//!          -> effects between drive and motor -> motor gain -> joint
//! ```
//!
//! A law gives its output at the middle of a substep together with how it falls with position and
//! velocity: the simulation takes these two slopes implicitly, so that stiff gains stay stable at its
//! substeps (an IMEX step; U. M. Ascher, S. J. Ruuth, R. J. Spiteri, Applied Numerical Mathematics 25,
//! 1997).

mod p;
mod pd;
mod pid;

use pid_interpret::nominal::{Servo, ServoLaw};

use crate::scalar::Scalar;

/// Gains of a loop, in the unit of the joint's input.
#[derive(Debug, Clone, Copy)]
pub struct Gains<D> {
    /// Of the error of the position.
    pub kp: D,
    /// Of the velocity.
    pub kd: D,
    /// Of the integral of the error.
    pub ki: D,
}

/// What a loop sees, averaged over a substep.
#[derive(Debug, Clone, Copy)]
pub struct Seen<D> {
    /// Target.
    pub r: D,
    /// Position.
    pub q: D,
    /// Velocity.
    pub v: D,
}

/// Output of a loop.
#[derive(Debug, Clone, Copy)]
pub struct Output<D> {
    /// Input of the motor, within the limit.
    pub u: D,
    /// By how much it falls per unit of the position; zero at the limit.
    pub stiffness: D,
    /// By how much it falls per unit of the velocity; zero at the limit.
    pub damping: D,
}

/// Output of a law without limits; `integral` is the part of its integral, in the unit of the input.
#[inline(always)]
pub fn unlimited<D: Scalar>(law: ServoLaw, k: &Gains<D>, at: &Seen<D>, integral: D) -> Output<D> {
    match law {
        ServoLaw::P => p::output(k, at),
        ServoLaw::Pd => pd::output(k, at),
        _ => pid::output(k, at, integral),
    }
}

/// Output of a loop; `integral` is the part of its integral, in the unit of the input.
#[inline(always)]
pub fn output<D: Scalar>(servo: &Servo, k: &Gains<D>, at: &Seen<D>, integral: D) -> Output<D> {
    let free = unlimited(servo.law, k, at, integral);
    match servo.limit {
        Some(limit) if free.u.value().abs() > limit => Output {
            u: D::constant(limit * free.u.value().signum()),
            stiffness: D::nil(),
            damping: D::nil(),
        },
        _ => free,
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
    if servo.law != ServoLaw::Pid {
        return integral;
    }
    pid::integrated(servo, k, at, (integral, dt))
}

/// The part of the integral with which a loop at rest gives an input `u`.
pub fn at_rest<D: Scalar>(servo: &Servo, k: &Gains<D>, at: &Seen<D>, u: D) -> D {
    if servo.law != ServoLaw::Pid {
        return D::nil();
    }
    pid::clipped(servo, u - pd::output(k, at).u)
}

#[cfg(test)]
mod tests {
    use num_dual::Dual64;

    use super::*;

    fn servo(law: ServoLaw, limit: Option<f64>) -> Servo {
        Servo {
            law,
            gains: Default::default(),
            limit,
            integral_limit: Some(1.5),
            rate_hz: None,
            place: None,
        }
    }

    const AT: Seen<f64> = Seen {
        r: 0.5,
        q: 0.2,
        v: -0.4,
    };
    const K: Gains<f64> = Gains {
        kp: 10.0,
        kd: 2.0,
        ki: 5.0,
    };

    #[test]
    fn laws_by_hand() {
        let of = |law| output(&servo(law, None), &K, &AT, 0.7).u;
        assert!((of(ServoLaw::P) - 3.0).abs() < 1e-15);
        assert!((of(ServoLaw::Pd) - 3.8).abs() < 1e-15);
        assert!((of(ServoLaw::Pid) - 4.5).abs() < 1e-15);
        let most = output(&servo(ServoLaw::Pd, Some(1.2)), &K, &AT, 0.0);
        assert_eq!((most.u, most.stiffness, most.damping), (1.2, 0.0, 0.0));
    }

    #[test]
    fn slopes_are_those_of_the_output() {
        for law in [ServoLaw::P, ServoLaw::Pd, ServoLaw::Pid] {
            let lift = Dual64::from;
            let k = Gains {
                kp: lift(K.kp),
                kd: lift(K.kd),
                ki: lift(K.ki),
            };
            let at = |q: f64, v: f64| Seen {
                r: lift(AT.r),
                q: Dual64::new(AT.q, q),
                v: Dual64::new(AT.v, v),
            };
            let slope = |q, v| output(&servo(law, None), &k, &at(q, v), lift(0.7)).u.eps;
            let own = output(&servo(law, None), &K, &AT, 0.7);
            assert_eq!(slope(1.0, 0.0), -own.stiffness);
            assert_eq!(slope(0.0, 1.0), -own.damping);
        }
    }

    #[test]
    fn an_integral_grows_with_the_error_and_stops_at_its_limits() {
        let free = servo(ServoLaw::Pid, None);
        let next = integrated(&free, &K, &AT, (0.1, 0.01));
        assert!((next - (0.1 + 5.0 * 0.3 * 0.01)).abs() < 1e-15);
        assert_eq!(integrated(&free, &K, &AT, (1.499, 0.01)), 1.5);
        // Limited, and the error pushes further; back it may go.
        let tight = servo(ServoLaw::Pid, Some(2.0));
        assert_eq!(integrated(&tight, &K, &AT, (0.1, 0.01)), 0.1);
        let back = Seen { r: -0.5, ..AT };
        assert!(integrated(&tight, &K, &back, (0.1, 0.01)) > -1.5);
        let held = at_rest(&free, &K, &AT, 4.3);
        assert!((output(&free, &K, &AT, held).u - 4.3).abs() < 1e-14);
        assert_eq!(
            integrated(&servo(ServoLaw::Pd, None), &K, &AT, (0.2, 0.01)),
            0.2
        );
    }
}
