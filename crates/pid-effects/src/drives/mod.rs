//! Position loops inside drives: one file per law and per stage, over any scalar.
//!
//! Behind such a loop the input of a joint is a target position r, and what acts is
//!
//! ```text
//! target r -> effects on the command -> shaping ([`target`]) -> error less the dead band
//!          -> law on the position and the velocity as read, late and filtered, less a share of the target's
//!          -> plus feed-forward of gravity and inertia, within ± limit
//!          -> effects between drive and motor -> motor gain -> joint
//! ```
//!
//! A law gives its output at the middle of a substep together with how it falls with position and
//! velocity: the simulation takes these two slopes implicitly, so that stiff gains stay stable at its
//! substeps (an IMEX step; U. M. Ascher, S. J. Ruuth, R. J. Spiteri, Applied Numerical Mathematics 25,
//! 1997).

mod average;
mod cascade;
mod dead_band;
pub mod filter;
mod integral;
mod p;
mod pd;
mod pid;
mod profile;
pub mod target;

use pid_interpret::nominal::{Gain, Servo, ServoLaw, Shaping};

pub use integral::{at_rest, growth, integrated};

use crate::scalar::Scalar;

/// Gains of a loop, in the unit of the joint's input; those of a stage that it does not have are `None`.
#[derive(Debug, Clone, Copy)]
pub struct Gains<D> {
    /// Of the error of the position; in a cascade the velocity per error, 1/s.
    pub kp: D,
    /// Of the velocity.
    pub kd: D,
    /// Of the integral of the error; in a cascade of that of the velocity.
    pub ki: D,
    /// Of the error of the velocity, in a cascade.
    pub kv: D,
    /// Voltage that the motor induces per velocity.
    pub back_emf: Option<D>,
    /// Share of the gravity that the drive's model knows.
    pub gravity: Option<D>,
    /// Share of the inertia that the drive's model knows.
    pub inertia: Option<D>,
    /// Share of the velocity of the target.
    pub ahead: Option<D>,
    /// Largest speed of what is followed.
    pub target_speed: Option<D>,
    /// Acceleration of what is followed.
    pub target_acceleration: Option<D>,
    /// Time over which what is followed is averaged, s.
    pub target_average: Option<D>,
    /// Time constant of the filter of the target, s.
    pub target_time: Option<D>,
    /// Time constant of the filter of the velocity, s.
    pub velocity_time: Option<D>,
    /// By how much the encoder is read late, s.
    pub feedback_delay: Option<D>,
}

impl<D: Scalar> Gains<D> {
    /// From each of them; `None` of one that the loop does not have.
    pub fn of(mut of: impl FnMut(Gain) -> Option<D>) -> Self {
        let mut own = |gain| of(gain).unwrap_or_else(D::nil);
        Gains {
            kp: own(Gain::Kp),
            kd: own(Gain::Kd),
            ki: own(Gain::Ki),
            kv: own(Gain::Kv),
            back_emf: of(Gain::BackEmf),
            gravity: of(Gain::Gravity),
            inertia: of(Gain::InertiaAhead),
            ahead: of(Gain::VelocityAhead),
            target_speed: of(Gain::TargetSpeed),
            target_acceleration: of(Gain::TargetAcceleration),
            target_average: of(Gain::TargetAverage),
            target_time: of(Gain::TargetTime),
            velocity_time: of(Gain::VelocityTime),
            feedback_delay: of(Gain::FeedbackDelay),
        }
    }

    /// Multiplies the gains of the law, as those of a record that differ from what is described.
    pub fn times(&mut self, factor: impl Fn(Gain) -> f64) {
        let law = [
            (Gain::Kp, &mut self.kp),
            (Gain::Kd, &mut self.kd),
            (Gain::Ki, &mut self.ki),
            (Gain::Kv, &mut self.kv),
        ];
        for (gain, own) in law {
            *own = *own * factor(gain);
        }
    }

    /// Whether something becomes of the target before the loop follows it.
    pub(crate) fn shapes(&self, servo: &Servo) -> bool {
        let stages = [
            self.target_speed,
            self.target_acceleration,
            self.target_average,
            self.target_time,
        ];
        servo.shaping != Shaping::default() || stages.iter().any(Option::is_some)
    }
}

/// What a loop sees, averaged over a substep.
#[derive(Debug, Clone, Copy)]
pub struct Seen<D> {
    /// Target, shaped.
    pub r: D,
    /// Position.
    pub q: D,
    /// Velocity, filtered.
    pub v: D,
    /// Velocity that is fed forward: a share of the target's.
    pub ahead: D,
    /// Input with which the drive's model makes up for gravity.
    pub gravity: D,
    /// Input with which it accelerates as the targets do.
    pub inertia: D,
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

/// Output of a loop without its limit; `integral` is the part of its integral, in the unit of the input.
#[inline(always)]
pub fn unlimited<D: Scalar>(servo: &Servo, k: &Gains<D>, at: &Seen<D>, integral: D) -> Output<D> {
    let (at, open) = dead_band::applied(servo, at);
    let mut out = match servo.law {
        ServoLaw::P => p::output(k, &at),
        ServoLaw::Pd => pd::output(k, &at),
        ServoLaw::Cascade => cascade::output(servo, k, &at, integral),
        _ => pid::output(k, &at, integral),
    };
    if let Some(share) = k.gravity {
        out.u += share * at.gravity;
    }
    if let Some(share) = k.inertia {
        out.u += share * at.inertia;
    }
    if !open {
        out.stiffness = D::nil();
    }
    out
}

/// Output of a loop; `integral` is the part of its integral, in the unit of the input.
#[inline(always)]
pub fn output<D: Scalar>(servo: &Servo, k: &Gains<D>, at: &Seen<D>, integral: D) -> Output<D> {
    let free = unlimited(servo, k, at, integral);
    match servo.limit {
        Some(limit) if free.u.value().abs() > limit => Output {
            u: D::constant(limit * free.u.value().signum()),
            stiffness: D::nil(),
            damping: D::nil(),
        },
        _ => free,
    }
}

/// What is left of an output where the limit falls with the speed of the motor, in the direction that a positive
/// output drives; `None` where the limit holds nothing back.
#[inline(always)]
pub fn slowed<D: Scalar>(servo: &Servo, u: D, speed: D) -> Option<Output<D>> {
    let own = servo.falling?;
    let most = |speed: D| (-speed / own.no_load_speed + 1.0) * own.stall;
    let (low, high) = (-most(-speed), most(speed));
    if u.value() >= low.value() && u.value() <= high.value() {
        return None;
    }
    Some(Output {
        u: u.limit(low, high),
        stiffness: D::nil(),
        damping: D::constant(own.stall / own.no_load_speed),
    })
}

/// By how much the output of a law falls per unit of the position and of the velocity, limits, bands and
/// filters aside.
pub fn slopes(law: ServoLaw, k: &Gains<f64>) -> [f64; 2] {
    match law {
        ServoLaw::P => [k.kp, 0.0],
        ServoLaw::Cascade => [k.kp * k.kv, k.kv],
        _ => [k.kp, k.kd],
    }
}

/// By how much the integral of a law falls in a second per unit of the position and of the velocity, limits, bands and
/// filters aside; `None` where there is no integral.
pub fn falls(law: ServoLaw, k: &Gains<f64>) -> Option<[f64; 2]> {
    match law {
        ServoLaw::Pid => Some([k.ki, 0.0]),
        ServoLaw::Cascade => Some([k.ki * k.kp, k.ki]),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::target::Motion;
    use super::*;
    use num_dual::Dual64;
    use pid_interpret::nominal::FallingLimit;

    fn servo(law: ServoLaw, limit: Option<f64>) -> Servo {
        let mut servo = Servo::new(law);
        (servo.limit, servo.integral_limit) = (limit, Some(1.5));
        servo
    }

    const AT: Seen<f64> = Seen {
        r: 0.5,
        q: 0.2,
        v: -0.4,
        ahead: 0.3,
        gravity: 0.6,
        inertia: -0.8,
    };
    const K: Gains<f64> = Gains {
        kp: 10.0,
        kd: 2.0,
        ki: 5.0,
        kv: 1.5,
        back_emf: None,
        gravity: None,
        inertia: None,
        ahead: None,
        target_speed: None,
        target_acceleration: None,
        target_average: None,
        target_time: None,
        velocity_time: None,
        feedback_delay: None,
    };

    /// A gain has the same place among the factors of a record.
    #[test]
    fn factors_of_records_are_those_of_the_gains() {
        let keys = Gain::ALL.map(Gain::key);
        assert!(keys.starts_with(&pid_data::GainFactors::KEYS));
        let mut k = K;
        k.times(|gain| 1.0 + gain as usize as f64);
        assert_eq!([k.kp, k.kd, k.ki, k.kv], [10.0, 4.0, 15.0, 6.0]);
    }

    #[test]
    fn laws_by_hand() {
        let of = |law| output(&servo(law, None), &K, &AT, 0.7).u;
        assert!((of(ServoLaw::P) - 3.0).abs() < 1e-15);
        // 10 · 0.3 + 2 (0.3 + 0.4).
        assert!((of(ServoLaw::Pd) - 4.4).abs() < 1e-15);
        assert!((of(ServoLaw::Pid) - 5.1).abs() < 1e-15);
        // 1.5 (10 · 0.3 + 0.3 + 0.4) + 0.7.
        assert!((of(ServoLaw::Cascade) - 6.25).abs() < 1e-15);
        let most = output(&servo(ServoLaw::Pd, Some(1.2)), &K, &AT, 0.0);
        assert_eq!((most.u, most.stiffness, most.damping), (1.2, 0.0, 0.0));
        // A cascade that asks for 2 rad/s at most: 1.5 (2 + 0.4).
        let mut slow = servo(ServoLaw::Cascade, None);
        slow.velocity_limit = Some(2.0);
        let out = output(&slow, &K, &AT, 0.0);
        assert!((out.u - 3.6).abs() < 1e-15 && out.stiffness == 0.0 && out.damping == 1.5);
        // 0.1 rad of the error of 0.3 do not count; 0.9 of the gravity of 0.6 and half of what accelerates are added.
        let mut banded = servo(ServoLaw::Pd, None);
        banded.dead_band = Some(0.1);
        let k = Gains {
            gravity: Some(0.9),
            inertia: Some(0.5),
            ..K
        };
        assert!((output(&banded, &k, &AT, 0.0).u - (2.0 + 1.4 + 0.14)).abs() < 1e-15);
        banded.dead_band = Some(0.35);
        let out = output(&banded, &k, &AT, 0.0);
        assert!((out.u - (1.4 + 0.14)).abs() < 1e-15 && out.stiffness == 0.0);
    }

    /// 2 at rest and nothing at 4 rad/s; against the motion more. The slope is that of the output.
    #[test]
    fn a_limit_falls_with_the_speed() {
        let mut own = servo(ServoLaw::Pd, None);
        own.falling = Some(FallingLimit {
            stall: 2.0,
            no_load_speed: 4.0,
        });
        let at = |u: f64, speed: f64| {
            let out = slowed(&own, Dual64::from(u), Dual64::new(speed, 1.0));
            out.map(|out| {
                assert_eq!(out.u.eps, -out.damping.re);
                out.u.re
            })
        };
        assert_eq!((at(1.9, 0.0), at(2.1, 0.0)), (None, Some(2.0)));
        assert_eq!((at(0.9, 2.0), at(5.0, 2.0)), (None, Some(1.0)));
        assert_eq!((at(-2.9, 2.0), at(-3.1, 2.0)), (None, Some(-3.0)));
        // Faster than without a load it brakes.
        assert_eq!((at(0.1, 5.0), at(-0.6, 5.0)), (Some(-0.5), None));
        assert_eq!((at(-5.0, -2.0), at(5.0, -2.0)), (Some(-1.0), Some(3.0)));
    }

    #[test]
    fn slopes_are_those_of_the_output() {
        for law in ServoLaw::ALL {
            let k = Gains::of(|gain| {
                let all = [10.0, 2.0, 5.0, 1.5];
                all.get(gain as usize).map(|&x| Dual64::from(x))
            });
            let lift = Dual64::from;
            let at = |q: f64, v: f64| Seen {
                r: lift(AT.r),
                q: Dual64::new(AT.q, q),
                v: Dual64::new(AT.v, v),
                ahead: lift(AT.ahead),
                gravity: lift(AT.gravity),
                inertia: lift(AT.inertia),
            };
            let slope = |q, v| output(&servo(law, None), &k, &at(q, v), lift(0.7)).u.eps;
            let own = output(&servo(law, None), &K, &AT, 0.7);
            assert_eq!(slope(1.0, 0.0), -own.stiffness);
            assert_eq!(slope(0.0, 1.0), -own.damping);
            assert_eq!(slopes(law, &K), [own.stiffness, own.damping]);
            let growth = |q, v| growth(&servo(law, None), &k, &at(q, v)).eps;
            let falls = falls(law, &K).unwrap_or_default();
            assert_eq!(falls, [-growth(1.0, 0.0), -growth(0.0, 1.0)]);
        }
    }

    #[test]
    fn an_integral_grows_with_the_error_and_stops_at_its_limits() {
        let free = servo(ServoLaw::Pid, None);
        let next = integrated(&free, &K, &AT, (0.1, 0.01));
        assert!((next - (0.1 + 5.0 * 0.3 * 0.01)).abs() < 1e-15);
        assert_eq!(integrated(&free, &K, &AT, (1.499, 0.01)), 1.5);
        let next = integrated(&servo(ServoLaw::Cascade, None), &K, &AT, (0.1, 0.01));
        assert!((next - (0.1 + 5.0 * 3.7 * 0.01)).abs() < 1e-15);
        // Limited, and the error pushes further; back it may go.
        let tight = servo(ServoLaw::Pid, Some(2.0));
        assert_eq!(integrated(&tight, &K, &AT, (0.1, 0.01)), 0.1);
        let back = Seen { r: -0.5, ..AT };
        assert!(integrated(&tight, &K, &back, (0.1, 0.01)) > -1.5);
        for law in [ServoLaw::Pid, ServoLaw::Cascade] {
            let mut own = servo(law, None);
            own.integral_limit = None;
            let held = at_rest(&own, &K, &AT, 4.3);
            assert!((output(&own, &K, &AT, held).u - 4.3).abs() < 1e-14);
        }
        assert_eq!(
            integrated(&servo(ServoLaw::Pd, None), &K, &AT, (0.2, 0.01)),
            0.2
        );
    }

    /// A ramp of 1 rad/s in steps of 10 ms through a shaping; what is followed at the end of each, and its velocity.
    fn ramp(shaping: Shaping, k: Gains<f64>) -> Vec<(f64, f64)> {
        let mut own = servo(ServoLaw::P, None);
        own.shaping = shaping;
        let mut memory = target::Shaped::at_rest(0.0);
        let mut at = |i: u32| {
            let t = 0.01 * f64::from(i);
            let target = Motion {
                r: t,
                rate: 1.0,
                acceleration: 0.0,
            };
            let [_, end] = target::followed(&own, &k, &mut memory, &target, (t, 0.01), 0.0);
            (end.r, k.ahead.unwrap_or(0.0) * end.rate)
        };
        (0..100).map(&mut at).collect()
    }

    #[test]
    fn a_target_is_stepped_held_slowed_and_filtered() {
        let none = Shaping::default();
        let close = |x: f64, y: f64| assert!((x - y).abs() < 1e-12, "{x} {y}");
        let stepped = ramp(
            Shaping {
                step: Some(0.1),
                ..none
            },
            K,
        );
        close(stepped[14].0, 0.1);
        close(stepped[16].0, 0.2);
        // Every 40 ms.
        let held = ramp(
            Shaping {
                rate_hz: Some(25.0),
                ..none
            },
            K,
        );
        assert_eq!(
            [3, 4, 7, 8].map(|i: usize| held[i].0),
            [0.0, 0.04, 0.04, 0.08]
        );
        // At 0.4 rad/s.
        let speed = Some(0.4);
        let slowed = ramp(
            none,
            Gains {
                target_speed: speed,
                ..K
            },
        );
        close(slowed[99].0, 0.004 * 99.0);
        // Behind a filter of 50 ms a ramp lags by 50 ms, less the 5 ms by which a step of it leads.
        let filter = Gains {
            target_time: Some(0.05),
            ..K
        };
        let filtered = ramp(none, filter);
        let kept = (-0.01_f64 / 0.05).exp();
        close(filtered[1].0, 0.01 * (1.0 - kept));
        assert!((filtered[99].0 - (0.99 - 0.01 * kept / (1.0 - kept))).abs() < 1e-9);
        assert!(filtered.iter().all(|at| at.1 == 0.0));
    }

    #[test]
    fn the_velocity_of_a_target_is_that_of_what_is_followed() {
        let none = Shaping::default();
        let close = |x: f64, y: f64| assert!((x - y).abs() < 1e-12, "{x} {y}");
        let fed = Gains {
            ahead: Some(0.5),
            ..K
        };
        let plain = ramp(none, fed);
        close(plain[0].1, 0.5);
        close(plain[99].1, 0.5);
        // Targets every 40 ms go by 40 mrad.
        let held = Shaping {
            rate_hz: Some(25.0),
            ..none
        };
        let held = ramp(held, fed);
        close(held[3].1, 0.0);
        close(held[4].1, 0.5);
        close(held[98].1, 0.5);
        let slowed = Gains {
            target_speed: Some(0.4),
            ..fed
        };
        close(ramp(none, slowed)[99].1, 0.2);
        let filtered = Gains {
            target_time: Some(0.05),
            ..fed
        };
        let kept = (-0.01_f64 / 0.05).exp();
        let filtered = ramp(none, filtered);
        close(filtered[0].1, 0.5 * (1.0 - kept));
        close(filtered[1].1, 0.5 * (1.0 - kept * kept));
    }
}
