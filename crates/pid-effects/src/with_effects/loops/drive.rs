//! The loop of one drive over [`Smooth`]: its input of the motor and the growth of its states.

use pid_interpret::nominal::{Gain, Servo};
use pid_runtime::dynamics::{At, Dims};

use crate::drives::{Gains, Seen, growth, unlimited};
use crate::scalar::Scalar;
use crate::smooth::{CORNER, Smooth};
use crate::with_effects::arguments;

/// Places of the arguments: position, velocity, target, gains, the integral and how fast it grows, the share of the
/// target's velocity and that velocity, the velocity behind a filter, how fast that grows, and the filter's time.
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
/// Number of arguments.
pub(super) const MOST: usize = 14;

/// Place of a number of a loop among the arguments; `None` of one that is no parameter of the equations.
pub(super) fn argument(gain: Gain) -> Option<usize> {
    match gain {
        Gain::Kp => Some(KP),
        Gain::Kd => Some(KD),
        Gain::Ki => Some(KI),
        Gain::Kv => Some(KV),
        Gain::VelocityAhead => Some(AHEAD),
        Gain::VelocityTime => Some(TIME),
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
    /// Place of each argument in z.
    pub(super) places: [Option<usize>; MOST],
}

impl Loop {
    pub(super) fn arguments(&self, at: &At<'_>, d: &Dims) -> [Smooth; MOST] {
        arguments::arguments(&self.places, at, d)
    }

    /// Where the velocity stands that the law uses.
    fn velocity(&self) -> usize {
        if self.places[F].is_some() { F } else { V }
    }

    /// Gains, and what the law sees.
    fn seen(&self, x: &[Smooth; MOST]) -> (Gains<Smooth>, Seen<Smooth>) {
        let none = Smooth::constant(0.0);
        let k = Gains::of(|gain| argument(gain).map(|a| x[a]));
        let at = Seen {
            r: x[R],
            q: x[Q],
            v: x[self.velocity()],
            ahead: x[AHEAD] * x[R_DOT],
            gravity: none,
            inertia: none,
        };
        (k, at)
    }

    /// Input of the motor, and the slope of its limit.
    pub(super) fn input(&self, x: &[Smooth; MOST]) -> (Smooth, Smooth) {
        let (k, at) = self.seen(x);
        let free = unlimited(&self.servo, &k, &at, x[W]).u;
        let Some(limit) = self.servo.limit else {
            return (free, Smooth::constant(1.0));
        };
        let round = (2.0 * limit * CORNER).powi(2);
        let slope = |end: f64| {
            let x = free - end;
            x / (x * x + round).root()
        };
        let end = Smooth::constant(limit);
        let slope = (slope(-limit) - slope(limit)) * 0.5;
        (free.limit(-end, end), slope)
    }

    /// Arguments on which the input depends, ascending.
    pub(super) fn acting(&self) -> impl Iterator<Item = usize> + '_ {
        let unused = if self.places[F].is_some() { V } else { F };
        let all = [Q, V, R, KP, KD, KV, W, AHEAD, R_DOT, F];
        let used = all.into_iter().filter(move |&a| a != unused);
        used.filter(|&a| self.places[a].is_some())
    }

    /// How fast a memory grows.
    pub(super) fn growth(&self, memory: Memory, x: &[Smooth; MOST]) -> Smooth {
        match memory {
            Memory::Integral => {
                let (k, at) = self.seen(x);
                growth(&self.servo, &k, &at) * self.input(x).1
            }
            Memory::Filter => (x[V] - x[F]) / x[TIME],
        }
    }

    /// Residual of a memory.
    pub(super) fn residual(&self, memory: Memory, x: &[Smooth; MOST]) -> Smooth {
        x[memory.places()[1]] - self.growth(memory, x)
    }

    /// Arguments on which the residual of a memory depends, ascending.
    pub(super) fn active(&self, memory: Memory) -> Vec<usize> {
        let limited = self.servo.limit.is_some();
        let cascade = self.servo.has(Gain::Kv);
        let mut all = match memory {
            Memory::Integral => vec![Q, R, KI, W_DOT],
            Memory::Filter => vec![V, F, F_DOT, TIME],
        };
        if memory == Memory::Integral && (limited || cascade) {
            all.extend([self.velocity(), KP, AHEAD, R_DOT]);
        }
        if memory == Memory::Integral && limited {
            all.extend([KD, KV, W]);
        }
        all.retain(|&a| self.places[a].is_some());
        all.sort_unstable();
        all
    }
}
