//! The effects at one joint: the change of the residual, and its derivatives.

use std::sync::{Arc, LazyLock};

use pid_runtime::dynamics::{At, Dims};

use super::arguments;
use super::error::{EffectError, Obstacle};
use super::roles::JointRoles;
use crate::constants::{Constant, Constants};
use crate::effect::{Commands, Effect, Forces, Friction, Law, Site};
use crate::nominal::Nominal;
use crate::scalar::Scalar;
use crate::smooth::{JAM, Smooth};

/// Places of the arguments: own and partner's position and velocity, input, acceleration, friction,
/// gain; effects' parameters follow.
const Q: usize = 0;
const V: usize = 2;
const INPUT: usize = 4;
const ACCELERATION: usize = 5;
const COULOMB: usize = 6;
const VISCOUS: usize = 7;
const GAIN: usize = 8;
const OWN: usize = 9;
/// Most arguments: four effects of the most parameters at one joint.
const MOST: usize = OWN + 16;

/// What an effect does.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Hooks {
    pub(super) friction: bool,
    pub(super) viscous: bool,
    pub(super) input: bool,
    pub(super) load: bool,
    /// Rotor inertia per unit of the first parameter.
    pub(super) rotor: f64,
}

/// An effect of the group: parameters at `first..` among the arguments.
struct Member {
    effect: Arc<dyn Effect>,
    first: usize,
    count: usize,
    hooks: Hooks,
}

/// The effects at one joint.
pub(super) struct Group {
    pub(super) joint: usize,
    rows: Vec<usize>,
    rest: f64,
    members: Vec<Member>,
    /// Place in z of each argument.
    places: Vec<Option<usize>>,
    /// Arguments on which the change depends.
    active: Vec<usize>,
    dims: Dims,
}

/// Transition velocity where the model has no Coulomb friction, rad/s or m/s.
pub(super) const REST: f64 = 0.02;

/// Commands of effects without a look back in time.
fn nothing<'a>(u: &'a [f64]) -> Commands<'a> {
    Commands {
        u,
        h: 1.0,
        linear: false,
        begin: 0.0,
        t: 1.5,
        dt: 0.5,
    }
}

/// The equation of no effect.
struct Nothing;
impl Law<f64> for Nothing {}

/// A robot on which effects are tried.
static TRIED: LazyLock<Nominal> = LazyLock::new(|| {
    let text = include_str!("arm.toml");
    Nominal::parse(text, "arm.toml".as_ref()).expect("invariant: the text is part of the program")
});

/// Constants of which an effect may change any: those that belong to bodies and gravity, and the
/// rotor of the second joint.
fn tried(law: &dyn Law<f64>, e: &[f64]) -> (Vec<f64>, f64) {
    let mut constants = Constants::<f64>::new(&TRIED, &vec![0.0; TRIED.size()]);
    law.constants(e, 1, &mut constants);
    let structure = (0..3).map(Constant::Gravity).chain((0..2).flat_map(|b| {
        let moments = (0..3).map(move |i| Constant::Moment(b, i));
        let inertias = (0..6).map(move |i| Constant::Inertia(b, i));
        [Constant::Mass(b)]
            .into_iter()
            .chain(moments)
            .chain(inertias)
    }));
    let structure = structure.map(|which| constants.get(which)).collect();
    (structure, constants.get(Constant::Rotor(1)))
}

/// What an effect does, found by trying its hooks on numbers.
///
/// # Errors
/// What it does that equations of motion cannot take.
pub(super) fn hooks(effect: &dyn Effect) -> Result<Hooks, Obstacle> {
    let info = effect.info();
    let law = effect.plain();
    let e: Vec<f64> = (0..info.parameters.len())
        .map(|i| 0.37 + 0.11 * i as f64)
        .collect();
    if law.gear(&e).is_some() {
        return Err(Obstacle::Gear);
    }
    if law.tip_force(&e, 0.0, 1.0).is_some() {
        return Err(Obstacle::Tool);
    }
    if effect.needs_inputs() {
        return Err(Obstacle::Inputs);
    }
    if effect.stage().is_some() {
        return Err(Obstacle::Loop);
    }
    if law.base_acceleration(&e, 0.4).is_some() {
        return Err(Obstacle::Time);
    }
    let reads = law.sense(&e, 0.4, 0.7) != (0.4, 0.7);
    if reads || law.reading_delay(&e).is_some() || law.velocity_lag(&e).is_some() {
        return Err(Obstacle::Reading);
    }
    if effect.memory() > 0 {
        return Err(Obstacle::Memory);
    }
    let mut found = Hooks::default();
    let input = |u: f64, around: &[f64]| law.input(&e, u, &nothing(around), &mut []);
    if input(5.0, &[1.0, 2.0, 3.0]) != input(5.0, &[2.0, -1.0, 4.0]) {
        return Err(Obstacle::Delay);
    }
    let later = Commands {
        begin: 3.0,
        ..nothing(&[0.0; 3])
    };
    if law.input(&e, 0.7, &later, &mut []) != input(0.7, &[0.0; 3]) {
        return Err(Obstacle::Time);
    }
    found.input = [-4.0, -0.1, 0.1, 0.7, 4.0]
        .iter()
        .any(|&u| input(u, &[0.0; 3]) != u);
    let friction = |load: f64, t: f64| {
        let site = Site {
            joint: 1,
            q: &[0.1, 0.2],
            v: &[0.3, 0.9],
            load: &[load, load],
            t,
            dt: 1e-3,
            rest: None,
        };
        let mut f = Friction {
            forward: 1.0,
            backward: 1.0,
            viscous: 1.0,
        };
        law.friction(&e, &site, &[], &mut f);
        let (mut value, mut rate) = ([0.0; 2], [0.0; 2]);
        let mut forces = Forces {
            value: &mut value,
            rate: &mut rate,
        };
        law.force(&e, &site, &[], &mut forces, &Constants::none(&TRIED));
        ([f.forward, f.backward, f.viscous], value, rate)
    };
    let here = friction(1.0, 0.0);
    if here != friction(1.0, 3.0) {
        return Err(Obstacle::Time);
    }
    found.friction = here.0[..2] != [1.0; 2];
    found.viscous = here.0[2] != 1.0;
    found.load = here != friction(2.0, 0.0);
    let (before, after) = (tried(&Nothing, &e), tried(law, &e));
    if after.0 != before.0 {
        return Err(Obstacle::Structure);
    }
    found.rotor = (after.1 - before.1) / e.first().copied().unwrap_or(1.0);
    Ok(found)
}

impl Group {
    pub(super) fn new(joint: usize, roles: &JointRoles, before: Dims) -> Self {
        let mut places = vec![None; OWN];
        let partner = joint.checked_sub(1);
        // The partner comes first, as among joints.
        if let Some(other) = partner {
            places[Q] = Some(other);
            places[V] = Some(before.v() + other);
        }
        places[Q + 1] = Some(joint);
        places[V + 1] = Some(before.v() + joint);
        places[ACCELERATION] = Some(before.a() + joint);
        places[INPUT] = roles.input.map(|i| before.u() + i);
        places[COULOMB] = roles.coulomb.map(|k| before.p() + k);
        places[VISCOUS] = roles.viscous.map(|k| before.p() + k);
        places[GAIN] = roles.gain.map(|k| before.p() + k);
        Self {
            joint,
            rows: partner.into_iter().chain([joint]).collect(),
            rest: roles.rest.unwrap_or(REST),
            members: Vec::new(),
            places,
            active: Vec::new(),
            dims: before,
        }
    }

    /// Adds an effect whose parameters stand at `first..` in p.
    pub(super) fn add(
        &mut self,
        effect: &Arc<dyn Effect>,
        start: &[f64],
        first: usize,
        (label, joint): (&str, &str),
    ) -> Result<(), EffectError> {
        let obstacle = |obstacle| EffectError::Obstacle {
            effect: label.to_owned(),
            obstacle,
        };
        let hooks = hooks(&**effect).map_err(obstacle)?;
        let needed = [
            (hooks.friction, COULOMB, "Coulomb friction"),
            (hooks.viscous, VISCOUS, "viscous friction"),
            (hooks.input || hooks.load, GAIN, "gain"),
        ];
        for (needs, place, what) in needed {
            if needs && self.places[place].is_none() {
                return Err(EffectError::Missing {
                    effect: label.to_owned(),
                    what,
                    joint: joint.to_owned(),
                });
            }
        }
        if self.places.len() + start.len() > MOST {
            // More than a person would put at one joint.
            return Err(obstacle(Obstacle::Structure));
        }
        self.members.push(Member {
            effect: effect.clone(),
            first: self.places.len(),
            count: start.len(),
            hooks,
        });
        let p = self.dims.p();
        self.places
            .extend((0..start.len()).map(|i| Some(p + first + i)));
        Ok(())
    }

    /// Once all effects are there: which arguments matter.
    pub(super) fn settle(&mut self, dims: Dims) {
        self.dims = dims;
        let all: Vec<usize> = (0..self.places.len())
            .filter(|&a| self.places[a].is_some())
            .collect();
        let matters = |a: &usize| {
            (0..4).any(|point| {
                let mut x = [Smooth::constant(0.0); MOST];
                for (i, x) in x[..self.places.len()].iter_mut().enumerate() {
                    let wave = (1.3 * i as f64 + 0.9 * f64::from(point)).sin();
                    // Velocities within the transition, everything else positive.
                    *x = Smooth::constant(match i {
                        V | 3 => self.rest * wave,
                        _ => 0.6 + 0.4 * wave,
                    });
                }
                x[*a].0.eps1 = 1.0;
                self.change(&x).iter().any(|c| c.0.eps1 != 0.0)
            })
        };
        self.active = all.into_iter().filter(matters).collect();
    }

    /// Rows of the residual that change: the partner's, if there is one, and the joint's.
    pub(super) fn rows(&self) -> &[usize] {
        &self.rows
    }

    pub(super) fn jacobian_places(&self) -> Vec<(u32, u32)> {
        arguments::jacobian_places(&self.places, &self.rows, &self.active)
    }

    pub(super) fn hessian_places(&self) -> Vec<(u32, u32)> {
        arguments::hessian_places(&self.places, &self.active)
    }

    /// Inertia that effects add to the rotor.
    pub(super) fn rotor(&self, p: &[f64]) -> f64 {
        let own = self.members.iter().filter(|m| m.hooks.rotor != 0.0);
        let value = |m: &Member| {
            let place = self.places[m.first];
            place.map_or(0.0, |z| m.hooks.rotor * p[z - self.dims.p()])
        };
        own.map(value).sum()
    }

    /// Arguments at a point; without accelerations where none are given.
    fn arguments(&self, at: &At<'_>) -> [Smooth; MOST] {
        arguments::arguments(&self.places, at, &self.dims)
    }

    /// Change of the residual, partner's row first; zero for a partner that is none.
    fn change(&self, x: &[Smooth; MOST]) -> [Smooth; 2] {
        let zero = Smooth::constant(0.0);
        let (q, v) = ([x[Q], x[Q + 1]], [x[V], x[V + 1]]);
        let sign = (v[1] / self.rest).hyperbolic_tangent();
        let dry = x[COULOMB] * sign + x[VISCOUS] * v[1];
        let drive = x[GAIN] * x[INPUT];
        let mut friction = Friction {
            forward: x[COULOMB],
            backward: x[COULOMB],
            viscous: x[VISCOUS],
        };
        let (mut loaded, mut slope) = (Friction::none(zero), zero);
        let (mut value, mut rate) = ([zero; 2], [zero; 2]);
        let mut input = x[INPUT];
        let mut rotor = zero;
        let constants = Constants::none(&TRIED);
        for m in &self.members {
            let law: &dyn Law<Smooth> = m.effect.smooth();
            let e = &x[m.first..m.first + m.count];
            let site = Site {
                joint: 1,
                q: &q,
                v: &v,
                load: &[zero, drive - dry],
                t: 0.0,
                dt: 1.0,
                rest: Some(self.rest),
            };
            let mut forces = Forces {
                value: &mut value,
                rate: &mut rate,
            };
            law.force(e, &site, &[], &mut forces, &constants);
            match law.load_slope(e, &site) {
                Some(own) => {
                    law.friction(e, &site, &[], &mut loaded);
                    slope += own;
                }
                None => law.friction(e, &site, &[], &mut friction),
            }
            input = law.input(e, input, &nothing(&[0.0; 3]), &mut []);
            if m.hooks.rotor != 0.0 {
                rotor += e[0] * m.hooks.rotor;
            }
        }
        let (up, down) = ((sign + 1.0) * 0.5, (-sign + 1.0) * 0.5);
        let now = up * friction.forward - down * friction.backward + friction.viscous * v[1];
        // What friction takes does not reach the gear: τ = τ_d − f(τ), by a step of Newton's method from τ_d, which is
        // exact where f is linear in |τ|.
        let reach = sign * slope + 1.0;
        let eased = (reach + (reach * reach + JAM * JAM).root()) * 0.5;
        let now = now + (up * loaded.forward - down * loaded.backward) / eased;
        [
            rate[0] * v[0] - value[0],
            now - dry + rate[1] * v[1] - value[1] - x[GAIN] * (input - x[INPUT])
                + rotor * x[ACCELERATION],
        ]
    }

    /// The part of [`Self::change`] that has rows.
    fn of_rows(&self, change: [Smooth; 2]) -> impl Iterator<Item = Smooth> {
        change.into_iter().skip(2 - self.rows.len())
    }

    /// Change of the residual, row by row.
    pub(super) fn value(&self, at: &At<'_>) -> impl Iterator<Item = f64> {
        let x = self.arguments(at);
        self.of_rows(self.change(&x)).map(|c| c.0.re)
    }

    /// The change without the part that accelerates the rotor.
    pub(super) fn force(&self, at: &At<'_>) -> impl Iterator<Item = f64> {
        let mut x = self.arguments(at);
        x[ACCELERATION] = Smooth::constant(0.0);
        self.of_rows(self.change(&x)).map(|c| c.0.re)
    }

    /// Adds the change to the residual and its first derivatives to their slots.
    pub(super) fn first(&self, at: &At<'_>, r: &mut [f64], slots: &[usize], values: &mut [f64]) {
        let mut x = self.arguments(at);
        for (&row, c) in self.rows.iter().zip(self.of_rows(self.change(&x))) {
            r[row] += c.0.re;
        }
        let width = self.active.len();
        for (k, &a) in self.active.iter().enumerate() {
            x[a].0.eps1 = 1.0;
            for (i, c) in self.of_rows(self.change(&x)).enumerate() {
                values[slots[i * width + k]] += c.0.eps1;
            }
            x[a].0.eps1 = 0.0;
        }
    }

    /// Adds the second derivatives of λᵀ change to their slots.
    pub(super) fn second(&self, at: &At<'_>, lambda: &[f64], slots: &[usize], values: &mut [f64]) {
        let mut x = self.arguments(at);
        let mut slots = slots.iter();
        for (i, &a) in self.active.iter().enumerate() {
            for &b in &self.active[..=i] {
                let Some(&slot) = slots.next() else { return };
                x[a].0.eps1 = 1.0;
                x[b].0.eps2 = 1.0;
                let change = self.of_rows(self.change(&x));
                let sum: f64 = (self.rows.iter().zip(change))
                    .map(|(&row, c)| lambda[row] * c.0.eps1eps2)
                    .sum();
                values[slot] += sum;
                x[a].0.eps1 = 0.0;
                x[b].0.eps2 = 0.0;
            }
        }
    }
}
