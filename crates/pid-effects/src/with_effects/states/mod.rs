//! Effects with a state or a look back in time, in equations of motion.
//!
//! A state is one more coordinate s of the model, which no sensor reads:
//!
//! ```text
//! elastic joint    s: rotor.   J s̈ + friction(ṡ) − k u + τ = 0,  τ through the gear, which the link gets
//! memory w         w = ṡ.      T(e) s̈ = rate(v, u, w),  w acts as friction or as the input
//! ```
//!
//! Nothing depends on the value of s where w = ṡ is the state; it starts at zero. An input that acts
//! later reads the inputs of the samples before, which stand in further columns of the records.

mod member;
mod records;

use std::borrow::Cow;
use std::cell::RefCell;

use pid_data::{Dataset, InputHold};
use pid_interpret::nominal::EncoderSide;
use pid_runtime::dynamics::{
    At, Dims, Dynamics, Hessian, InputInfo, Jacobian, JointInfo, ParamInfo, Pattern,
};

use super::arguments::{narrowed, widened};
use super::group::REST;
use super::merge::Merged;
use super::{EffectError, JointRoles, Placed, name_parameters, roles};
use crate::effect::Effect;
use crate::scalar::Scalar;
use crate::smooth::Smooth;
use member::{
    A, COULOMB, GAIN, Kind, Member, OWN, Q, ROTOR, S, SAMPLES, U, V, VISCOUS, W, W_DOT, kind,
};
use records::add_past;
pub(super) use records::{Starts, add_state, step};

/// Sides of the gear and rotor inertias, which only a description states.
#[derive(Debug, Clone)]
pub struct Drives {
    /// Side of the encoders.
    pub side: EncoderSide,
    /// Position of each joint's rotor inertia in p.
    pub rotors: Vec<Option<usize>>,
}

thread_local! {
    /// Inner inputs; kept so that evaluations do not allocate.
    static SCRATCH: RefCell<Vec<f64>> = const { RefCell::new(Vec::new()) };
}

/// A model and effects with states or a look back in time. Coordinates and (idle) inputs of the states
/// follow the joints', the parameters of the effects those of the model.
pub struct WithStates<'m> {
    inner: Box<dyn Hessian + 'm>,
    dims: Dims,
    joints: Vec<JointInfo>,
    params: Vec<ParamInfo>,
    inputs: Vec<InputInfo>,
    members: Vec<Member>,
    /// Members with a rotor of their own: joint, coordinate, rotor inertia in p.
    rotors: Vec<(usize, usize, usize)>,
    side: EncoderSide,
    jacobian: Merged,
    hessian: Merged,
}

/// Whether an effect has a form with a state or a look back in time.
pub(super) fn takes(effect: &dyn Effect) -> bool {
    kind(effect).is_ok()
}

/// Whether the friction of the joint is that of a state: a rotor's, or a memory's own.
pub(super) fn moves_friction(effect: &dyn Effect) -> bool {
    match kind(effect) {
        Ok(Kind::Gear) => true,
        Ok(Kind::Memory) => member::flowing(effect).is_some_and(|f| f.friction.is_some()),
        _ => false,
    }
}

/// Whether a reading at the motor is that of a coordinate of its own.
pub(super) fn moves_reading(effect: &dyn Effect) -> bool {
    kind(effect) == Ok(Kind::Gear)
}

/// A model that is being widened.
struct Widening<'a> {
    inner: &'a dyn Hessian,
    roles: Vec<JointRoles>,
    drives: &'a Drives,
    dims: Dims,
    /// Number of states.
    states: usize,
    /// Time between samples, s.
    h: f64,
    joints: Vec<JointInfo>,
    inputs: Vec<InputInfo>,
    /// Next coordinate of a state, and next input of the samples before.
    next: (usize, usize),
}

impl Widening<'_> {
    /// Samples that an input may act later.
    fn samples(h: f64, own: &Placed) -> usize {
        let latest = own.ranges.first().map_or(0.0, |r| r.2);
        ((latest / h).ceil() as usize + 1).min(SAMPLES)
    }

    /// Places of the arguments but those of a state; the effect's parameters stand at `first..` in p.
    fn places(
        &self,
        own: &Placed,
        kind: Kind,
        first: usize,
    ) -> Result<Vec<Option<usize>>, EffectError> {
        let (joint, d) = (own.term.joint, &self.dims);
        let role = &self.roles[joint];
        let parameter = |k: Option<usize>| k.map(|k| d.p() + k);
        let mut places = vec![None; OWN];
        places[Q] = Some(joint);
        places[V] = Some(d.v() + joint);
        places[A] = Some(d.a() + joint);
        let moved = |i: usize| {
            i + if i < self.inner.dims().nq {
                0
            } else {
                self.states
            }
        };
        places[U] = role.input.map(|i| d.u() + moved(i));
        places[COULOMB] = parameter(role.coulomb);
        places[VISCOUS] = parameter(role.viscous);
        places[GAIN] = parameter(role.gain);
        places[ROTOR] = parameter(self.drives.rotors.get(joint).copied().flatten());
        places.extend((0..own.ranges.len()).map(|i| Some(d.p() + first + i)));
        let needed: &[(usize, &'static str)] = match kind {
            Kind::Gear => &[
                (COULOMB, "Coulomb friction"),
                (VISCOUS, "viscous friction"),
                (GAIN, "gain"),
                (ROTOR, "rotor inertia"),
            ],
            Kind::Memory => &[(COULOMB, "Coulomb friction"), (GAIN, "gain")],
            Kind::Delay => &[(GAIN, "gain")],
        };
        match needed.iter().find(|(place, _)| places[*place].is_none()) {
            None => Ok(places),
            Some(&(_, what)) => Err(EffectError::Missing {
                effect: own.term.label(),
                what,
                joint: self.inner.joints()[joint].name.to_string(),
            }),
        }
    }

    /// Adds an effect, and its columns to the records.
    fn add(
        &mut self,
        own: &Placed,
        kind: Kind,
        first: usize,
        dataset: &mut Dataset,
    ) -> Result<Member, EffectError> {
        let joint = own.term.joint;
        let mut places = self.places(own, kind, first)?;
        let (info, name) = (
            &self.inner.joints()[joint],
            &self.inner.joints()[joint].name,
        );
        let (mut rows, mut past) = (vec![joint], self.next.1..self.next.1);
        if kind == Kind::Delay {
            past.end += Self::samples(self.h, own);
            self.next.1 = past.end;
            let input = self.roles[joint].input.unwrap_or(joint);
            let before = (1..=past.len()).rev();
            self.inputs.extend(before.map(|k| InputInfo {
                name: Cow::Owned(format!("input_{name}_{k}_before")),
                joint: None,
                ..self.inner.inputs()[input].clone()
            }));
            add_past(dataset, input, past.len());
        } else {
            let state = self.next.0;
            self.next.0 += 1;
            (places[S], places[W]) = (Some(state), Some(self.dims.v() + state));
            places[W_DOT] = Some(self.dims.a() + state);
            rows.push(state);
            let word = if kind == Kind::Gear { "rotor" } else { "state" };
            self.joints.push(JointInfo {
                name: Cow::Owned(format!("{word}_{name}")),
                limits: None,
                ..info.clone()
            });
            let idle = InputInfo {
                name: Cow::Owned(format!("nothing_{word}_{name}")),
                unit: Cow::Borrowed(info.force_unit()),
                joint: Some(state),
            };
            self.inputs.insert(state, idle);
            add_state(
                dataset,
                joint,
                match kind {
                    Kind::Gear => Starts::Joint,
                    _ => Starts::Zero,
                },
                &format!("{word}_{name}"),
            );
        }
        let mut member = Member {
            effect: own.term.effect.clone(),
            kind,
            places,
            active: Vec::new(),
            rows,
            past,
            rest: self.roles[joint].rest.unwrap_or(REST),
            h: self.h,
            linear: dataset.input_hold == InputHold::Linear,
        };
        member.settle();
        Ok(member)
    }

    /// Places of the model within in the widened z; they keep their order.
    fn moved(&self, list: &[u32]) -> Vec<u32> {
        let (before, after) = (self.inner.dims(), &self.dims);
        let place = |&z: &u32| widened(&before, after, z as usize) as u32;
        list.iter().map(place).collect()
    }

    /// Patterns of both derivatives.
    fn patterns(&self, members: &[Member]) -> (Merged, Merged) {
        let (first, second) = (self.inner.jacobian_pattern(), self.inner.hessian_pattern());
        let merged = |rows: &[u32], cols: &[u32], places: Vec<Vec<(u32, u32)>>| {
            Merged::new(Pattern { rows, cols }, places.into_iter())
        };
        (
            merged(
                first.rows,
                &self.moved(first.cols),
                members.iter().map(Member::jacobian_places).collect(),
            ),
            merged(
                &self.moved(second.rows),
                &self.moved(second.cols),
                members.iter().map(Member::hessian_places).collect(),
            ),
        )
    }
}

impl<'m> WithStates<'m> {
    /// Adds effects to a model, and columns of their states and past inputs to the records. Columns
    /// of states that no sensor reads hold where the state starts; [`Self::noise`] says so.
    ///
    /// # Errors
    /// [`EffectError`].
    pub fn new(
        inner: Box<dyn Hessian + 'm>,
        effects: &[Placed],
        drives: &Drives,
        dataset: &mut Dataset,
    ) -> Result<Self, EffectError> {
        let (before, h) = (inner.dims(), step(dataset));
        let kinds = effects.iter().map(|own| {
            kind(&*own.term.effect).map_err(|obstacle| EffectError::Obstacle {
                effect: own.term.label(),
                obstacle,
            })
        });
        let kinds: Vec<Kind> = kinds.collect::<Result<_, _>>()?;
        let states = kinds.iter().filter(|k| **k != Kind::Delay).count();
        let late = effects.iter().zip(&kinds);
        let late = late.filter(|(_, k)| **k == Kind::Delay);
        let late: usize = late.map(|(own, _)| Widening::samples(h, own)).sum();
        let mut params = inner.params().to_vec();
        let mut firsts = Vec::with_capacity(effects.len());
        for own in effects {
            firsts.push(params.len());
            name_parameters(inner.as_ref(), own, &mut params)?;
        }
        let mut wide = Widening {
            inner: inner.as_ref(),
            roles: roles(inner.as_ref()),
            drives,
            dims: Dims {
                nq: before.nq + states,
                nu: before.nu + states + late,
                np: params.len(),
            },
            states,
            h,
            joints: inner.joints().to_vec(),
            inputs: inner.inputs().to_vec(),
            next: (before.nq, before.nu + states),
        };
        let mut members = Vec::with_capacity(effects.len());
        for ((own, &kind), first) in effects.iter().zip(&kinds).zip(firsts) {
            members.push(wide.add(own, kind, first, dataset)?);
        }
        let (jacobian, hessian) = wide.patterns(&members);
        let (dims, joints, inputs) = (wide.dims, wide.joints, wide.inputs);
        let geared = members.iter().filter(|m| m.kind == Kind::Gear);
        let rotor = |m: &Member| Some((m.rows[0], m.rows[1], m.places[ROTOR]? - dims.p()));
        Ok(Self {
            rotors: geared.filter_map(rotor).collect(),
            inner,
            dims,
            joints,
            params,
            inputs,
            members,
            side: drives.side,
            jacobian,
            hessian,
        })
    }

    /// Noise of all channels from that of the model within, positions first: without bound where no
    /// sensor reads.
    pub fn noise(&self, stated: &[Option<f64>]) -> Vec<Option<f64>> {
        let (n, all) = (self.inner.dims().nq, self.dims.nq);
        let mut out = vec![Some(f64::INFINITY); 2 * all];
        for part in 0..2 {
            let own = stated.get(part * n..(part + 1) * n).unwrap_or(&[]);
            out[part * all..part * all + own.len()].copy_from_slice(own);
            if self.side == EncoderSide::Motor {
                for &(j, s, _) in &self.rotors {
                    out.swap(part * all + j, part * all + s);
                }
            }
        }
        out
    }

    fn within<R>(&self, at: &At<'_>, work: impl FnOnce(&At<'_>) -> R) -> R {
        let mut u = SCRATCH.with(|s| std::mem::take(&mut *s.borrow_mut()));
        let sizes = (&self.inner.dims(), &self.dims);
        let out = narrowed(sizes, at, &mut u, |_| {}, work);
        SCRATCH.with(|s| *s.borrow_mut() = u);
        out
    }
}

impl Dynamics for WithStates<'_> {
    fn name(&self) -> &str {
        self.inner.name()
    }
    fn dims(&self) -> Dims {
        self.dims
    }
    fn params(&self) -> &[ParamInfo] {
        &self.params
    }
    fn joints(&self) -> &[JointInfo] {
        &self.joints
    }
    fn inputs(&self) -> &[InputInfo] {
        &self.inputs
    }
    fn mass_matrix(&self, at: &At<'_>, m: &mut [f64]) {
        let own = self.inner.dims().nm();
        m[own..].fill(0.0);
        self.within(at, |at| self.inner.mass_matrix(at, &mut m[..own]));
        for &(j, s, rotor) in &self.rotors {
            m[j * (j + 1) / 2 + j] -= at.p[rotor];
            m[s * (s + 1) / 2 + s] = at.p[rotor];
        }
        for member in self.members.iter().filter(|m| m.kind == Kind::Memory) {
            // The residual of the state is T ẇ − rate: T is its slope.
            let (mut x, s) = (member.arguments(at, &self.dims), member.rows[1]);
            x[W_DOT].0.eps1 = 1.0;
            m[s * (s + 1) / 2 + s] = member.change(&x, member.past(at))[1].0.eps1;
        }
    }
    fn bias(&self, at: &At<'_>, b: &mut [f64]) {
        let nq = self.inner.dims().nq;
        b[nq..].fill(0.0);
        self.within(at, |at| self.inner.bias(at, &mut b[..nq]));
    }
    fn applied_force(&self, at: &At<'_>, f: &mut [f64]) {
        let nq = self.inner.dims().nq;
        f[nq..].fill(0.0);
        self.within(at, |at| self.inner.applied_force(at, &mut f[..nq]));
        for member in &self.members {
            let mut x = member.arguments(at, &self.dims);
            (x[A], x[W_DOT]) = (Smooth::constant(0.0), Smooth::constant(0.0));
            let change = member.change(&x, member.past(at));
            for (&row, c) in member.rows.iter().zip(change) {
                f[row] -= c.0.re;
            }
        }
    }
    fn residual(&self, at: &At<'_>, r: &mut [f64]) {
        let nq = self.inner.dims().nq;
        r[nq..].fill(0.0);
        self.within(at, |at| self.inner.residual(at, &mut r[..nq]));
        for member in &self.members {
            let x = member.arguments(at, &self.dims);
            let change = member.change(&x, member.past(at));
            for (&row, c) in member.rows.iter().zip(change) {
                r[row] += c.0.re;
            }
        }
    }
    fn kinetic_energy(&self, at: &At<'_>) -> f64 {
        let inner = self.within(at, |at| self.inner.kinetic_energy(at));
        let rotors = self
            .rotors
            .iter()
            .map(|&(j, s, rotor)| 0.5 * at.p[rotor] * (at.v[s] * at.v[s] - at.v[j] * at.v[j]));
        inner + rotors.sum::<f64>()
    }
    fn potential_energy(&self, at: &At<'_>) -> f64 {
        self.within(at, |at| self.inner.potential_energy(at))
    }
}

impl Jacobian for WithStates<'_> {
    fn jacobian_pattern(&self) -> Pattern<'_> {
        self.jacobian.pattern()
    }
    fn residual_jacobian(&self, at: &At<'_>, r: &mut [f64], values: &mut [f64]) {
        let (nq, own) = (self.inner.dims().nq, self.jacobian.own());
        r[nq..].fill(0.0);
        self.within(at, |at| {
            let inner = &self.inner;
            inner.residual_jacobian(at, &mut r[..nq], &mut values[..own]);
        });
        self.jacobian.spread(values);
        for (member, slots) in self.members.iter().zip(self.jacobian.slots()) {
            member.first(at, &self.dims, r, slots, values);
        }
    }
}

impl Hessian for WithStates<'_> {
    fn hessian_pattern(&self) -> Pattern<'_> {
        self.hessian.pattern()
    }
    fn residual_hessian(&self, at: &At<'_>, lambda: &[f64], values: &mut [f64]) {
        let (nq, own) = (self.inner.dims().nq, self.hessian.own());
        self.within(at, |at| {
            let inner = &self.inner;
            inner.residual_hessian(at, &lambda[..nq], &mut values[..own]);
        });
        self.hessian.spread(values);
        for (member, slots) in self.members.iter().zip(self.hessian.slots()) {
            member.second(at, &self.dims, lambda, slots, values);
        }
    }
}
