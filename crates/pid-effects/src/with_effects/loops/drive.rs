//! The loop of one drive over [`Smooth`]: its input of the motor and the growth of its states.
//!
//! A reading that is late by τ is that behind an all-pass, (1 − τs/2) / (1 + τs/2): the Padé approximation of first
//! order, of the same gain and with a phase within (ωτ)³/12 (G. A. Baker, Essentials of Padé Approximants, 1975).
//! With what its position lags, ξ̇ = v − 2ξ/τ, the loop reads q − 2ξ and its velocity 4ξ/τ − v.

use pid_data::GainFactors;
use pid_interpret::nominal::{Gain, Servo};
use pid_runtime::dynamics::{At, Dims};

use crate::drives::{Gains, Seen, growth, unlimited};
use crate::scalar::Scalar;
use crate::smooth::{CORNER, Smooth};
use crate::with_effects::arguments;

use super::feed_forward::{Fed, Read};

/// Places of the arguments: position, velocity, target, gains, the integral and how fast it grows, the share of the
/// target's velocity and that velocity, the velocity behind a filter, how fast that grows, and the filter's time; the
/// share of gravity; what a late position lags, how fast that grows, and by how much it is late; the share of inertia.
/// The inputs that make up for all of gravity and inertia are no variables of their own. Factors of gains are inputs,
/// and so is whether the drive is on.
pub(super) const Q: usize = 0;
pub(super) const V: usize = 1;
pub(super) const R: usize = 2;
const KP: usize = 3;
const KD: usize = 4;
const KI: usize = 5;
const KV: usize = 6;
pub(super) const W: usize = 7;
pub(super) const W_DOT: usize = 8;
const AHEAD: usize = 9;
pub(super) const R_DOT: usize = 10;
pub(super) const F: usize = 11;
pub(super) const F_DOT: usize = 12;
const TIME: usize = 13;
const SHARE: usize = 14;
const WEIGHT: usize = 15;
pub(super) const LAG: usize = 16;
const LAG_DOT: usize = 17;
const LATE: usize = 18;
const INERTIA_SHARE: usize = 19;
const INERTIA: usize = 20;
/// Inputs by which a record multiplies kp, kd, ki and kv.
const TIMES: usize = 21;
/// The back-EMF, on which the input does not depend ([`Brake`](super::brake::Brake)).
pub(super) const BACK_EMF: usize = TIMES + GainFactors::KEYS.len();
/// Input that is 1 while the drive is on, and 0 while it is off.
pub(super) const ON: usize = BACK_EMF + 1;
/// Number of these. [`Loop::further`] follow where a drive has a feed-forward.
pub(super) const MOST: usize = ON + 1;

/// By how much the position that a loop reads moves with what it lags.
pub(super) const LAGS: f64 = -2.0;
/// Share of the limit of an integral per second by which its growth is rounded at zero.
const SLOW: f64 = 1e-3;

/// Place of a number of a loop among the arguments; `None` of one that is no parameter of the equations.
pub(super) fn argument(gain: Gain) -> Option<usize> {
    match gain {
        Gain::Kp => Some(KP),
        Gain::Kd => Some(KD),
        Gain::Ki => Some(KI),
        Gain::Kv => Some(KV),
        Gain::BackEmf => Some(BACK_EMF),
        Gain::VelocityAhead => Some(AHEAD),
        Gain::VelocityTime => Some(TIME),
        Gain::Gravity => Some(SHARE),
        Gain::FeedbackDelay => Some(LATE),
        Gain::InertiaAhead => Some(INERTIA_SHARE),
        _ => None,
    }
}

/// Place of the factor of a gain that differs from record to record; `None` of one that is the same in all.
pub(super) fn factor(gain: Gain) -> Option<usize> {
    let gain = gain as usize;
    (gain < GainFactors::KEYS.len()).then_some(TIMES + gain)
}

/// Numbers of a loop that are parameters of the equations, those of its law first.
pub(super) fn parameters(servo: &Servo) -> impl Iterator<Item = Gain> + '_ {
    let own = servo.law.gains().iter().copied();
    let beside = Gain::BESIDE.iter().copied().filter(|&gain| servo.has(gain));
    own.chain(beside).filter(|&gain| argument(gain).is_some())
}

/// What a loop remembers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Memory {
    /// The part w of its integral.
    Integral,
    /// The velocity behind its filter.
    Filter,
    /// What the position that it reads lags.
    Lag,
}

impl Memory {
    /// Places of its value and of how fast that grows.
    pub(super) fn places(self) -> [usize; 2] {
        match self {
            Memory::Integral => [W, W_DOT],
            Memory::Filter => [F, F_DOT],
            Memory::Lag => [LAG, LAG_DOT],
        }
    }

    /// As its coordinate is named, before the joint.
    pub(super) fn word(self) -> &'static str {
        match self {
            Memory::Integral => "integral",
            Memory::Filter => "filtered",
            Memory::Lag => "lag",
        }
    }

    /// Those of a loop.
    pub(super) fn of(servo: &Servo) -> impl Iterator<Item = Memory> {
        let all = [
            (Memory::Integral, servo.law.integrates()),
            (Memory::Filter, servo.has(Gain::VelocityTime)),
            (Memory::Lag, servo.has(Gain::FeedbackDelay)),
        ];
        all.into_iter().filter_map(|(own, has)| has.then_some(own))
    }
}

/// The loop of one drive.
pub(super) struct Loop {
    pub(super) servo: Servo,
    /// The joint, which is its coordinate.
    pub(super) joint: usize,
    /// Sign of the motor gain.
    pub(super) sign: f64,
    /// Place of each argument in z.
    pub(super) places: Vec<Option<usize>>,
    /// What the arguments behind the first [`MOST`] are.
    pub(super) further: Vec<Read>,
}

/// A value within two ends, and its slope times that of the value, rounded as every limit of [`Smooth`].
fn clipped((x, slope): (Smooth, Smooth), [low, high]: [Smooth; 2]) -> (Smooth, Smooth) {
    let round = (high - low) * CORNER;
    let from = |end: Smooth| {
        let x = x - end;
        x / (x * x + round * round).root()
    };
    (x.limit(low, high), slope * (from(low) - from(high)) * 0.5)
}

/// How fast an integral grows that keeps within its limit: there it grows inwards alone, rounded.
fn kept(w: Smooth, growth: Smooth, most: f64) -> Smooth {
    let part = |x: Smooth| (x + (x * x + (SLOW * most).powi(2)).root()) * 0.5;
    let beyond = |w: Smooth| {
        let out = (w - most) / (2.0 * most * CORNER);
        (out.hyperbolic_tangent() + 1.0) * 0.5
    };
    growth - part(growth) * beyond(w) + part(-growth) * beyond(-w)
}

/// A point with what the drives feed forward there.
pub(super) struct Point<'a> {
    x: [Smooth; MOST],
    fed: Option<&'a Fed>,
}

impl Loop {
    pub(super) fn at<'a>(&self, at: &At<'_>, d: &Dims, fed: Option<&'a Fed>) -> Point<'a> {
        Point {
            x: arguments::arguments(&self.places, at, d),
            fed,
        }
    }

    /// What a feed-forward reads of an argument.
    fn read(&self, argument: usize) -> Option<Read> {
        match argument {
            Q => Some(Read::Position(self.joint, 1.0)),
            LAG => Some(Read::Position(self.joint, LAGS)),
            a => self.further.get(a.checked_sub(MOST)?).copied(),
        }
    }

    /// Arguments with the first derivative by one of them, and the second by it and another.
    fn seeded(&self, at: &Point<'_>, a: Option<usize>, b: Option<usize>) -> [Smooth; MOST] {
        let mut x = at.x;
        if let Some(own) = a.and_then(|a| x.get_mut(a)) {
            own.0.eps1 = 1.0;
        }
        if let Some(own) = b.and_then(|b| x.get_mut(b)) {
            own.0.eps2 = 1.0;
        }
        let Some(fed) = at.fed else { return x };
        let read = |a: Option<usize>| self.read(a?);
        if self.servo.has(Gain::Gravity) {
            x[WEIGHT] = fed.gravity(self.joint, read(a), read(b));
        }
        if self.servo.has(Gain::InertiaAhead) {
            x[INERTIA] = fed.inertia(self.joint, read(a), read(b));
        }
        x
    }

    fn is_late(&self) -> bool {
        self.places[LAG].is_some()
    }

    /// The position and velocity that the loop reads.
    fn readings(&self, x: &[Smooth; MOST]) -> (Smooth, Smooth) {
        match self.is_late() {
            true => (x[Q] + x[LAG] * LAGS, x[LAG] * 4.0 / x[LATE] - x[V]),
            false => (x[Q], x[V]),
        }
    }

    /// Arguments on which the velocity depends that the law uses.
    fn velocity(&self) -> &'static [usize] {
        match (self.places[F].is_some(), self.is_late()) {
            (true, _) => &[F],
            (false, true) => &[V, LAG, LATE],
            (false, false) => &[V],
        }
    }

    /// Gains, and what the law sees.
    fn seen(&self, x: &[Smooth; MOST]) -> (Gains<Smooth>, Seen<Smooth>) {
        let own = |gain| argument(gain).filter(|_| self.servo.has(gain));
        let times = |gain| factor(gain).filter(|&a| self.places[a].is_some());
        let k = Gains::of(|gain| {
            let value = x[own(gain)?];
            Some(times(gain).map_or(value, |a| value * x[a]))
        });
        let (q, v) = self.readings(x);
        let at = Seen {
            r: x[R],
            q,
            v: if self.places[F].is_some() { x[F] } else { v },
            ahead: x[AHEAD] * x[R_DOT],
            gravity: x[WEIGHT],
            inertia: x[INERTIA],
        };
        (k, at)
    }

    /// Input of the motor with its derivatives, as [`Loop::seeded`] has them.
    pub(super) fn input(&self, at: &Point<'_>, a: Option<usize>, b: Option<usize>) -> Smooth {
        let x = self.seeded(at, a, b);
        let u = self.limited(&x).0;
        match self.places[ON] {
            Some(_) => u * x[ON],
            None => u,
        }
    }

    /// Output of the drive, and how it moves with that of the law.
    fn limited(&self, x: &[Smooth; MOST]) -> (Smooth, Smooth) {
        let (k, at) = self.seen(x);
        let integral = match self.servo.integral_limit.map(Smooth::constant) {
            Some(most) => x[W].limit(-most, most),
            None => x[W],
        };
        let mut out = (
            unlimited(&self.servo, &k, &at, integral).u,
            Smooth::constant(1.0),
        );
        if let Some(limit) = self.servo.limit {
            out = clipped(out, [-limit, limit].map(Smooth::constant));
        }
        if let Some(own) = self.servo.falling {
            let speed = x[V] * (self.sign / own.no_load_speed);
            let ends = [-speed - 1.0, -speed + 1.0].map(|end| end * own.stall);
            out = (clipped(out, ends).0, out.1);
        }
        out
    }

    /// Arguments on which the input depends, ascending.
    pub(super) fn acting(&self) -> impl Iterator<Item = usize> + '_ {
        let speed = self.servo.falling.is_some();
        let reads = move |a: usize| match a {
            V => speed || self.velocity().contains(&a),
            LATE => self.velocity().contains(&a),
            _ => true,
        };
        let all = [
            Q,
            V,
            R,
            KP,
            KD,
            KV,
            W,
            AHEAD,
            R_DOT,
            F,
            SHARE,
            LAG,
            LATE,
            INERTIA_SHARE,
            TIMES + Gain::Kp as usize,
            TIMES + Gain::Kd as usize,
            TIMES + Gain::Kv as usize,
            ON,
        ];
        let used = all.into_iter().filter(move |&a| reads(a));
        let all = used.chain(MOST..self.places.len());
        all.filter(|&a| self.places[a].is_some())
    }

    /// How fast a memory grows.
    fn growth(&self, memory: Memory, x: &[Smooth; MOST]) -> Smooth {
        match memory {
            Memory::Integral => {
                let (k, at) = self.seen(x);
                let free = growth(&self.servo, &k, &at) * self.limited(x).1;
                match self.servo.integral_limit {
                    Some(most) => kept(x[W], free, most),
                    None => free,
                }
            }
            Memory::Filter => (self.readings(x).1 - x[F]) / x[TIME],
            Memory::Lag => x[V] - x[LAG] * 2.0 / x[LATE],
        }
    }

    /// Residual of a memory with its derivatives, as [`Loop::seeded`] has them.
    pub(super) fn residual(
        &self,
        memory: Memory,
        at: &Point<'_>,
        a: Option<usize>,
        b: Option<usize>,
    ) -> Smooth {
        let x = self.seeded(at, a, b);
        x[memory.places()[1]] - self.growth(memory, &x)
    }

    /// Arguments on which the residual of a memory depends, ascending.
    pub(super) fn active(&self, memory: Memory) -> Vec<usize> {
        let mut all = match memory {
            Memory::Integral => vec![Q, R, KI, TIMES + Gain::Ki as usize, W, W_DOT, LAG],
            Memory::Filter => vec![V, F, F_DOT, TIME, LAG, LATE],
            Memory::Lag => vec![V, LAG, LAG_DOT, LATE],
        };
        if memory == Memory::Integral && self.servo.has(Gain::Kv) {
            all.extend(self.velocity());
            all.extend([KP, TIMES + Gain::Kp as usize, AHEAD, R_DOT]);
        }
        if memory == Memory::Integral && self.servo.limit.is_some() {
            all.extend(self.acting());
        }
        all.retain(|&a| self.places[a].is_some());
        all.sort_unstable();
        all.dedup();
        all
    }
}
