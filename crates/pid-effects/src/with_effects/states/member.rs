//! One effect with a state or a look back in time: its equations and their derivatives.

use std::ops::Range;
use std::sync::Arc;

use pid_runtime::dynamics::{At, Dims};

use super::super::arguments;
use super::super::error::Obstacle;
use super::super::group::hooks;
use crate::effect::{Commands, Effect, Flow, Flowing};
use crate::scalar::Scalar;
use crate::smooth::Smooth;

/// Places of the arguments: position, velocity, acceleration and input of the joint; position,
/// velocity and acceleration of the state; friction, gain and rotor inertia; the effect's own follow.
pub(super) const Q: usize = 0;
pub(super) const V: usize = 1;
pub(super) const A: usize = 2;
pub(super) const U: usize = 3;
pub(super) const S: usize = 4;
pub(super) const W: usize = 5;
pub(super) const W_DOT: usize = 6;
pub(super) const COULOMB: usize = 7;
pub(super) const VISCOUS: usize = 8;
pub(super) const GAIN: usize = 9;
pub(super) const ROTOR: usize = 10;
pub(super) const OWN: usize = 11;
/// Most parameters of such an effect: those of backlash.
pub(super) const MOST: usize = OWN + 4;
/// Most samples that an input may act later: each is a column of the records.
pub(super) const SAMPLES: usize = 64;

/// What an effect adds to the equations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Gear,
    Memory,
    Delay,
}

/// An effect with a state or a look back in time.
pub(super) struct Member {
    pub(super) effect: Arc<dyn Effect>,
    pub(super) kind: Kind,
    /// Position in z of each argument.
    pub(super) places: Vec<Option<usize>>,
    /// Arguments on which it depends.
    pub(super) active: Vec<usize>,
    /// Rows that change: the joint's, then the state's if it has one.
    pub(super) rows: Vec<usize>,
    /// Inputs of the samples before, oldest first, in u.
    pub(super) past: Range<usize>,
    /// Velocity over which dry friction changes its sign.
    pub(super) rest: f64,
    /// Time between samples, s.
    pub(super) h: f64,
    pub(super) linear: bool,
}

/// The memory of an effect in continuous time, at one point.
pub(super) fn flowing(effect: &dyn Effect) -> Option<Flowing<Smooth>> {
    let one = Smooth::constant(1.0);
    let e = vec![one; effect.info().parameters.len()];
    let at = Flow {
        v: one,
        speed: one,
        u: one,
        w: one,
        coulomb: one,
    };
    effect.smooth().flow(&e, &at)
}

/// Which of the kinds an effect is.
pub(super) fn kind(effect: &dyn Effect) -> Result<Kind, Obstacle> {
    match hooks(effect) {
        Err(Obstacle::Gear) => Ok(Kind::Gear),
        Err(Obstacle::Delay) => Ok(Kind::Delay),
        Err(Obstacle::Memory) if flowing(effect).is_some() => Ok(Kind::Memory),
        Err(other) => Err(other),
        Ok(_) => Err(Obstacle::Structure),
    }
}

impl Member {
    /// Which arguments matter, found at points in motion.
    pub(super) fn settle(&mut self) {
        let all = (0..self.places.len()).filter(|&a| self.places[a].is_some());
        let matters = |a: &usize| {
            (0..4).any(|point| {
                let mut x = [Smooth::constant(0.0); MOST];
                for (i, x) in x[..self.places.len()].iter_mut().enumerate() {
                    let wave = (1.3 * i as f64 + 0.9 * f64::from(point)).sin();
                    *x = Smooth::constant(match i {
                        V | W => self.rest * wave,
                        _ => 0.6 + 0.4 * wave,
                    });
                }
                // The latest input of the past is the one before: a delay within the samples.
                x[OWN] = match self.kind {
                    Kind::Delay => Smooth::constant(0.4 * self.h),
                    _ => x[OWN],
                };
                let past: Vec<f64> = (0..self.past.len()).map(|k| (k as f64).cos()).collect();
                x[*a].0.eps1 = 1.0;
                self.change(&x, &past).iter().any(|c| c.0.eps1 != 0.0)
            })
        };
        self.active = all.filter(matters).collect();
    }

    pub(super) fn jacobian_places(&self) -> Vec<(u32, u32)> {
        arguments::jacobian_places(&self.places, &self.rows, &self.active)
    }

    pub(super) fn hessian_places(&self) -> Vec<(u32, u32)> {
        arguments::hessian_places(&self.places, &self.active)
    }

    /// Arguments at a point; without accelerations where none are given.
    pub(super) fn arguments(&self, at: &At<'_>, d: &Dims) -> [Smooth; MOST] {
        arguments::arguments(&self.places, at, d)
    }

    /// Dry and viscous friction at a velocity.
    fn friction(&self, x: &[Smooth; MOST], v: Smooth) -> Smooth {
        x[COULOMB] * (v / self.rest).hyperbolic_tangent() + x[VISCOUS] * v
    }

    /// Change of the joint's residual, and the residual of the state.
    pub(super) fn change(&self, x: &[Smooth; MOST], past: &[f64]) -> [Smooth; 2] {
        let zero = Smooth::constant(0.0);
        let law = self.effect.smooth();
        let e = &x[OWN..self.places.len()];
        let drive = x[GAIN] * x[U];
        match self.kind {
            Kind::Gear => {
                let Some(gear) = law.gear(e) else {
                    return [zero; 2];
                };
                let (travel, rate) = (x[S] - x[Q], x[W] - x[V]);
                let (over, touch) = travel.beyond(gear.gap);
                let damping = gear.damping * touch + gear.open;
                let through = gear.stiffness * over + damping * rate;
                let rigid = x[ROTOR] * x[A] + self.friction(x, x[V]) - drive;
                let rotor = x[ROTOR] * x[W_DOT] + self.friction(x, x[W]) - drive;
                [-rigid - through, rotor + through]
            }
            Kind::Memory => {
                let at = Flow {
                    v: x[V],
                    speed: x[V] * (x[V] / self.rest).hyperbolic_tangent(),
                    u: x[U],
                    w: x[W],
                    coulomb: x[COULOMB],
                };
                let Some(flow) = law.flow(e, &at) else {
                    return [zero; 2];
                };
                let mut joint = zero;
                if let Some(friction) = flow.friction {
                    let sign = (x[V] / self.rest).hyperbolic_tangent();
                    joint += friction - x[COULOMB] * sign;
                }
                if let Some(input) = flow.input {
                    joint -= x[GAIN] * (input - x[U]);
                }
                [joint, flow.time * x[W_DOT] - flow.rate]
            }
            Kind::Delay => {
                let n = past.len();
                let mut u = [0.0; SAMPLES + 1];
                u[..n].copy_from_slice(past);
                u[n] = x[U].0.re;
                let at = Commands {
                    u: &u[..=n],
                    h: self.h,
                    linear: self.linear,
                    begin: 0.0,
                    t: n as f64 * self.h,
                    dt: self.h,
                };
                let later = law.input(e, x[U], &at, &mut []);
                // The law is linear in the inputs. That of now is a variable; those before are data.
                let mut pulse = [0.0; SAMPLES + 1];
                pulse[n] = 1.0;
                let share = law.input(
                    e,
                    zero,
                    &Commands {
                        u: &pulse[..=n],
                        ..at
                    },
                    &mut [],
                );
                let later = later + share * (x[U] - x[U].0.re);
                [-(x[GAIN] * (later - x[U])), zero]
            }
        }
    }

    pub(super) fn past<'a>(&self, at: &At<'a>) -> &'a [f64] {
        &at.u[self.past.clone()]
    }

    /// Adds the change to the residual and its first derivatives to their slots.
    pub(super) fn first(
        &self,
        at: &At<'_>,
        d: &Dims,
        r: &mut [f64],
        slots: &[usize],
        values: &mut [f64],
    ) {
        let mut x = self.arguments(at, d);
        let past = self.past(at);
        for (&row, c) in self.rows.iter().zip(self.change(&x, past)) {
            r[row] += c.0.re;
        }
        let width = self.active.len();
        for (k, &a) in self.active.iter().enumerate() {
            x[a].0.eps1 = 1.0;
            let change = self.change(&x, past);
            for (i, c) in change.into_iter().take(self.rows.len()).enumerate() {
                values[slots[i * width + k]] += c.0.eps1;
            }
            x[a].0.eps1 = 0.0;
        }
    }

    /// Adds the second derivatives of λᵀ change to their slots.
    pub(super) fn second(
        &self,
        at: &At<'_>,
        d: &Dims,
        lambda: &[f64],
        slots: &[usize],
        values: &mut [f64],
    ) {
        let mut x = self.arguments(at, d);
        let past = self.past(at);
        let mut slots = slots.iter();
        for (i, &a) in self.active.iter().enumerate() {
            for &b in &self.active[..=i] {
                let Some(&slot) = slots.next() else { return };
                x[a].0.eps1 = 1.0;
                x[b].0.eps2 = 1.0;
                let change = self.rows.iter().zip(self.change(&x, past));
                values[slot] += change
                    .map(|(&row, c)| lambda[row] * c.0.eps1eps2)
                    .sum::<f64>();
                x[a].0.eps1 = 0.0;
                x[b].0.eps2 = 0.0;
            }
        }
    }
}
