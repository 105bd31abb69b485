//! The loop of one drive over [`Smooth`]: its input of the motor and the growth of its states.

use pid_interpret::nominal::{Gain, Servo};
use pid_runtime::dynamics::{At, Dims};

use crate::drives::{Gains, Seen, growth, unlimited};
use crate::scalar::Scalar;
use crate::smooth::{CORNER, Smooth};
use crate::with_effects::arguments;

use super::gravity::Weights;

/// Places of the arguments: position, velocity, target, gains, the integral and how fast it grows, the share of the
/// target's velocity and that velocity, the velocity behind a filter, how fast that grows, and the filter's time; the
/// share of gravity, and the input that makes up for all of it, which is no variable of its own.
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
/// Number of these. The positions of the other joints follow where a drive makes up for gravity.
pub(super) const MOST: usize = 16;

/// Place of a number of a loop among the arguments; `None` of one that is no parameter of the equations.
pub(super) fn argument(gain: Gain) -> Option<usize> {
    match gain {
        Gain::Kp => Some(KP),
        Gain::Kd => Some(KD),
        Gain::Ki => Some(KI),
        Gain::Kv => Some(KV),
        Gain::VelocityAhead => Some(AHEAD),
        Gain::VelocityTime => Some(TIME),
        Gain::Gravity => Some(SHARE),
        _ => None,
    }
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
}

impl Memory {
    /// Places of its value and of how fast that grows.
    pub(super) fn places(self) -> [usize; 2] {
        match self {
            Memory::Integral => [W, W_DOT],
            Memory::Filter => [F, F_DOT],
        }
    }

    /// As its coordinate is named, before the joint.
    pub(super) fn word(self) -> &'static str {
        match self {
            Memory::Integral => "integral",
            Memory::Filter => "filtered",
        }
    }

    /// Those of a loop.
    pub(super) fn of(servo: &Servo) -> impl Iterator<Item = Memory> {
        let all = [
            (Memory::Integral, servo.law.integrates()),
            (Memory::Filter, servo.has(Gain::VelocityTime)),
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

/// A point with what holds the robot there against gravity.
pub(super) struct Point<'a> {
    x: [Smooth; MOST],
    weights: Option<&'a Weights>,
}

impl Loop {
    pub(super) fn at<'a>(&self, at: &At<'_>, d: &Dims, weights: Option<&'a Weights>) -> Point<'a> {
        Point {
            x: arguments::arguments(&self.places, at, d),
            weights,
        }
    }

    /// The coordinate that an argument is the position of.
    fn position(&self, argument: usize) -> Option<usize> {
        match argument {
            Q => Some(self.joint),
            a if a >= MOST => self.places[a],
            _ => None,
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
        if let (Some(weights), true) = (at.weights, self.servo.has(Gain::Gravity)) {
            let position = |a: Option<usize>| self.position(a?);
            x[WEIGHT] = weights.of(self.joint, position(a), position(b));
        }
        x
    }

    /// Where the velocity stands that the law uses.
    fn velocity(&self) -> usize {
        if self.places[F].is_some() { F } else { V }
    }

    /// Gains, and what the law sees.
    fn seen(&self, x: &[Smooth; MOST]) -> (Gains<Smooth>, Seen<Smooth>) {
        let own = |gain| argument(gain).filter(|_| self.servo.has(gain));
        let k = Gains::of(|gain| own(gain).map(|a| x[a]));
        let at = Seen {
            r: x[R],
            q: x[Q],
            v: x[self.velocity()],
            ahead: x[AHEAD] * x[R_DOT],
            gravity: x[WEIGHT],
            inertia: Smooth::constant(0.0),
        };
        (k, at)
    }

    /// Input of the motor with its derivatives, as [`Loop::seeded`] has them.
    pub(super) fn input(&self, at: &Point<'_>, a: Option<usize>, b: Option<usize>) -> Smooth {
        self.limited(&self.seeded(at, a, b)).0
    }

    /// Input of the motor, and how it moves with the output of the law.
    fn limited(&self, x: &[Smooth; MOST]) -> (Smooth, Smooth) {
        let (k, at) = self.seen(x);
        let mut out = (
            unlimited(&self.servo, &k, &at, x[W]).u,
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
        let hides = self.places[F].is_some() && self.servo.falling.is_none();
        let unused = if hides { V } else { MOST };
        let all = [Q, V, R, KP, KD, KV, W, AHEAD, R_DOT, F, SHARE];
        let used = all.into_iter().filter(move |&a| a != unused);
        let all = used.chain(MOST..self.places.len());
        all.filter(|&a| self.places[a].is_some())
    }

    /// How fast a memory grows.
    fn growth(&self, memory: Memory, x: &[Smooth; MOST]) -> Smooth {
        match memory {
            Memory::Integral => {
                let (k, at) = self.seen(x);
                growth(&self.servo, &k, &at) * self.limited(x).1
            }
            Memory::Filter => (x[V] - x[F]) / x[TIME],
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
        let limited = self.servo.limit.is_some();
        let cascade = self.servo.has(Gain::Kv);
        let mut all = match memory {
            Memory::Integral => vec![Q, R, KI, W_DOT],
            Memory::Filter => vec![V, F, F_DOT, TIME],
        };
        if memory == Memory::Integral && cascade {
            all.extend([self.velocity(), KP, AHEAD, R_DOT]);
        }
        if memory == Memory::Integral && limited {
            all.extend(self.acting());
        }
        all.retain(|&a| self.places[a].is_some());
        all.sort_unstable();
        all.dedup();
        all
    }
}
