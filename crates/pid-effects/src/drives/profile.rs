//! The fastest motion to a target within an acceleration and a speed, and to rest there: a trapezoid of the velocity
//! (L. Biagiotti, C. Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008, section 3.2). It begins
//! anew from where it is whenever the target moves.

use crate::scalar::Scalar;

/// Where a profile is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion<D> {
    /// Position.
    pub r: D,
    /// Velocity.
    pub rate: D,
    /// Acceleration.
    pub acceleration: D,
}

impl<D: Scalar> Motion<D> {
    /// At rest.
    pub fn at_rest(r: D) -> Self {
        let (rate, acceleration) = (D::nil(), D::nil());
        Motion {
            r,
            rate,
            acceleration,
        }
    }

    /// The same of another scalar.
    pub fn map<E>(&self, of: impl Fn(D) -> E) -> Motion<E> {
        Motion {
            r: of(self.r),
            rate: of(self.rate),
            acceleration: of(self.acceleration),
        }
    }
}

/// Share of what brakes in time that counts as rounding.
const ROUNDING: f64 = 1e-12;

/// The motion `dt`, s, later on the way to a target that stands; `most` is the largest speed, if there is one, and
/// `a` the acceleration.
///
/// It speeds up, goes at the largest speed and brakes: each part has its end in closed form, so that derivatives by
/// all numbers are exact and the length of a step does not matter.
#[inline(always)]
pub(super) fn after<D: Scalar>(
    from: &Motion<D>,
    target: D,
    (most, a): (Option<D>, D),
    dt: f64,
) -> Motion<D> {
    let (way, v) = (target - from.r, from.rate);
    let brakes = v * v * v.value().signum() / (a * 2.0);
    let beyond = (way - brakes).value();
    let rounding = ROUNDING * way.value().abs().max(brakes.value().abs());
    let on_curve = beyond.abs() <= rounding;
    let sign = match on_curve {
        true => v.value().signum(),
        false => beyond.signum(),
    };
    // Towards the side to which it speeds up first.
    let (way, v) = (way * sign, v * sign);
    let squared = a * way + v * v * 0.5;
    let top = match (on_curve, squared.value() > 0.0) {
        (true, _) => v,
        (false, true) => squared.root(),
        (false, false) => D::nil(),
    };
    let fastest = match most {
        Some(most) if top.value() > most.value() => most,
        _ => top,
    };
    let speeds_up = (fastest - v) / a;
    let goes_on = match fastest.value() < top.value() {
        true => (way - (fastest * fastest * 2.0 - v * v) / (a * 2.0)) / fastest,
        false => D::nil(),
    };
    let end = speeds_up + goes_on + fastest / a;
    let now = |r: D, rate: D, acceleration: D| Motion {
        r: from.r + r * sign,
        rate: rate * sign,
        acceleration: acceleration * sign,
    };
    if dt < speeds_up.value() {
        return now(v * dt + a * (0.5 * dt * dt), v + a * dt, a);
    }
    if dt < (speeds_up + goes_on).value() {
        let first = (fastest * fastest - v * v) / (a * 2.0);
        let r = first + fastest * (-speeds_up + dt);
        return now(r, fastest, D::nil());
    }
    if dt < end.value() {
        let left = end - dt;
        return now(way - a * left * left * 0.5, a * left, -a);
    }
    Motion::at_rest(target)
}

#[cfg(test)]
mod tests {
    use num_dual::Dual64;

    use super::*;

    /// From a place and a velocity to zero, by steps of 10 µs with the largest acceleration of the right sign.
    fn by_steps((mut r, mut v): (f64, f64), (most, a): (f64, f64), time: f64) -> (f64, f64) {
        let dt = 1e-5;
        for _ in 0..(time / dt).round() as usize {
            // The velocity from which it can still stop.
            let wanted = -r.signum() * (2.0 * a * r.abs()).sqrt().min(most);
            v += (wanted - v).clamp(-a * dt, a * dt);
            r += v * dt;
        }
        (r, v)
    }

    #[test]
    fn a_profile_is_the_fastest_way_to_rest() {
        let limits = [(f64::INFINITY, 4.0), (0.7, 4.0), (0.7, 1.1)];
        let starts = [
            (-1.0, 0.0),
            (0.3, 0.0),
            (-0.5, 0.6),
            (-0.02, 0.5),
            (0.4, 0.7),
        ];
        for (most, a) in limits {
            for from in starts {
                for time in [0.05, 0.3, 0.8, 1.5, 4.0] {
                    let (r, rate) = by_steps(from, (most, a), time);
                    let at = Motion {
                        r: from.0,
                        rate: from.1,
                        acceleration: 0.0,
                    };
                    let most = most.is_finite().then_some(most);
                    let to = after(&at, 0.0, (most, a), time);
                    let off = ((to.r - r).abs(), (to.rate - rate).abs());
                    assert!(
                        off.0 < 1e-4 && off.1 < 0.02,
                        "{from:?} {most:?} {a} {time}: {to:?} {r} {rate}"
                    );
                }
            }
        }
    }

    /// Many short steps end where one long step does, and there it stays.
    #[test]
    fn the_length_of_a_step_does_not_matter() {
        let mut short: Motion<f64> = Motion {
            r: -0.9,
            rate: -0.4,
            acceleration: 0.0,
        };
        let from = short;
        for i in 1..=500 {
            short = after(&short, 0.2, (Some(1.2), 5.0), 0.003);
            let long = after(&from, 0.2, (Some(1.2), 5.0), 0.003 * f64::from(i));
            let off = (short.r - long.r).abs().max((short.rate - long.rate).abs());
            assert!(off < 1e-7, "{i}: {short:?} {long:?}");
        }
        assert_eq!(short, Motion::at_rest(0.2));
    }

    #[test]
    fn slopes_are_those_of_the_motion() {
        let of = |acceleration: f64, most: f64, time: f64| {
            let from = Motion {
                r: 0.1,
                rate: -0.2,
                acceleration: 0.0,
            };
            after(&from, 1.0, (Some(most), acceleration), time).r
        };
        for time in [0.1, 0.5, 1.0, 1.4] {
            for which in [0, 1] {
                let dual = |x: f64, own: bool| Dual64::new(x, f64::from(u8::from(own)));
                let from = Motion {
                    r: dual(0.1, false),
                    rate: dual(-0.2, false),
                    acceleration: dual(0.0, false),
                };
                let (a, most) = (dual(3.0, which == 0), dual(0.8, which == 1));
                let slope = after(&from, dual(1.0, false), (Some(most), a), time).r.eps;
                let d = 1e-6;
                let by = [d * f64::from(1 - which), d * f64::from(which)];
                let far = of(3.0 + by[0], 0.8 + by[1], time) - of(3.0 - by[0], 0.8 - by[1], time);
                let off = slope - far / (2.0 * d);
                assert!(
                    off.abs() < 1e-7,
                    "{time} {which}: {slope} {}",
                    far / (2.0 * d)
                );
            }
        }
    }
}
