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

use std::borrow::Cow;
use std::cell::RefCell;
use std::ops::Range;
use std::sync::Arc;

use pid_data::{Dataset, Experiment, InputHold, VelocityKind};
use pid_interpret::nominal::EncoderSide;
use pid_runtime::dynamics::{
    At, Dims, Dynamics, Hessian, InputInfo, Jacobian, JointInfo, ParamInfo, Pattern,
};

use super::error::Obstacle;
use super::group::REST;
use super::merge::Merged;
use super::smooth::Smooth;
use super::{EffectError, Placed, name_parameters, roles};
use crate::effect::{Commands, Effect, Flow};
use crate::scalar::Scalar;

/// Places of the arguments: position, velocity, acceleration and input of the joint; position,
/// velocity and acceleration of the state; friction, gain and rotor inertia; the effect's own follow.
const Q: usize = 0;
const V: usize = 1;
const A: usize = 2;
const U: usize = 3;
const S: usize = 4;
const W: usize = 5;
const W_DOT: usize = 6;
const COULOMB: usize = 7;
const VISCOUS: usize = 8;
const GAIN: usize = 9;
const ROTOR: usize = 10;
const OWN: usize = 11;
/// Most parameters of such an effect: those of backlash.
const MOST: usize = OWN + 3;
/// Most samples that an input may act later: each is a column of the records.
const SAMPLES: usize = 64;

/// What an effect adds to the equations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Gear,
    Memory,
    Delay,
}

/// An effect with a state or a look back in time.
struct Member {
    effect: Arc<dyn Effect>,
    kind: Kind,
    /// Position in z of each argument.
    places: Vec<Option<usize>>,
    /// Arguments on which it depends.
    active: Vec<usize>,
    /// Rows that change: the joint's, then the state's if it has one.
    rows: Vec<usize>,
    /// Inputs of the samples before, oldest first, in u.
    past: Range<usize>,
    /// Velocity over which dry friction changes its sign.
    rest: f64,
    /// Time between samples, s.
    h: f64,
    linear: bool,
}

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

/// Which of the kinds an effect is.
fn kind(effect: &dyn Effect) -> Result<Kind, Obstacle> {
    match super::group::hooks(effect) {
        Err(Obstacle::Gear) => Ok(Kind::Gear),
        Err(Obstacle::Delay) => Ok(Kind::Delay),
        Err(Obstacle::Memory) => {
            let e = vec![Smooth::constant(1.0); effect.info().parameters.len()];
            let one = Smooth::constant(1.0);
            let at = Flow {
                v: one,
                speed: one,
                u: one,
                w: one,
                coulomb: one,
            };
            match effect.smooth().flow(&e, &at) {
                Some(_) => Ok(Kind::Memory),
                None => Err(Obstacle::Memory),
            }
        }
        Err(other) => Err(other),
        Ok(_) => Err(Obstacle::Structure),
    }
}

/// Whether an effect has a form with a state or a look back in time.
pub(super) fn takes(effect: &dyn Effect) -> bool {
    kind(effect).is_ok()
}

/// Median time between the samples of the first record, s.
pub(super) fn step(dataset: &Dataset) -> f64 {
    let t = dataset.experiments.first().map_or(&[][..], |e| &e.t);
    let mut steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or(1.0)
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
        let before = inner.dims();
        let roles = roles(inner.as_ref());
        let h = step(dataset);
        let mut kinds = Vec::with_capacity(effects.len());
        for own in effects {
            let found = kind(&*own.term.effect).map_err(|obstacle| EffectError::Obstacle {
                effect: own.term.label(),
                obstacle,
            })?;
            kinds.push(found);
        }
        let states = kinds.iter().filter(|k| **k != Kind::Delay).count();
        let samples = |own: &Placed| {
            let latest = own.ranges.first().map_or(0.0, |r| r.2);
            ((latest / h).ceil() as usize + 1).min(SAMPLES)
        };
        let late: usize = (effects.iter().zip(&kinds))
            .filter(|(_, k)| **k == Kind::Delay)
            .map(|(own, _)| samples(own))
            .sum();
        let mut params = inner.params().to_vec();
        let mut firsts = Vec::with_capacity(effects.len());
        for own in effects {
            firsts.push(params.len());
            name_parameters(inner.as_ref(), own, &mut params)?;
        }
        let dims = Dims {
            nq: before.nq + states,
            nu: before.nu + states + late,
            np: params.len(),
        };
        let (mut joints, mut inputs) = (inner.joints().to_vec(), inner.inputs().to_vec());
        let (mut members, mut rotors) = (Vec::new(), Vec::new());
        let (mut state, mut past) = (before.nq, before.nu + states);
        for ((own, &kind), first) in effects.iter().zip(&kinds).zip(firsts) {
            let joint = own.term.joint;
            let name = inner.joints()[joint].name.clone();
            let role = &roles[joint];
            let parameter = |k: Option<usize>| k.map(|k| dims.p() + k);
            let mut places = vec![None; OWN];
            places[Q] = Some(joint);
            places[V] = Some(dims.v() + joint);
            places[A] = Some(dims.a() + joint);
            places[U] = role
                .input
                .map(|i| dims.u() + i + if i < before.nq { 0 } else { states });
            places[COULOMB] = parameter(role.coulomb);
            places[VISCOUS] = parameter(role.viscous);
            places[GAIN] = parameter(role.gain);
            places[ROTOR] = parameter(drives.rotors.get(joint).copied().flatten());
            places.extend((0..own.ranges.len()).map(|i| Some(dims.p() + first + i)));
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
            if let Some((_, what)) = needed.iter().find(|(place, _)| places[*place].is_none()) {
                return Err(EffectError::Missing {
                    effect: own.term.label(),
                    what,
                    joint: name.to_string(),
                });
            }
            let mut rows = vec![joint];
            if kind != Kind::Delay {
                (places[S], places[W]) = (Some(state), Some(dims.v() + state));
                places[W_DOT] = Some(dims.a() + state);
                rows.push(state);
                let word = if kind == Kind::Gear { "rotor" } else { "state" };
                joints.push(JointInfo {
                    name: Cow::Owned(format!("{word}_{name}")),
                    limits: None,
                    ..inner.joints()[joint].clone()
                });
                inputs.insert(
                    state,
                    InputInfo {
                        name: Cow::Owned(format!("nothing_{word}_{name}")),
                        unit: Cow::Borrowed(inner.joints()[joint].force_unit()),
                        joint: Some(state),
                    },
                );
                add_state(dataset, joint, kind, &format!("{word}_{name}"));
                state += 1;
            }
            let mut columns = past..past;
            if kind == Kind::Delay {
                columns = past..past + samples(own);
                past = columns.end;
                let input = role.input.unwrap_or(joint);
                for before in (1..=columns.len()).rev() {
                    inputs.push(InputInfo {
                        name: Cow::Owned(format!("input_{name}_{before}_before")),
                        joint: None,
                        ..inner.inputs()[input].clone()
                    });
                }
                add_past(dataset, input, columns.len());
            }
            if let (Kind::Gear, Some(rotor)) = (kind, places[ROTOR]) {
                rotors.push((joint, rows[1], rotor - dims.p()));
            }
            members.push(Member {
                effect: own.term.effect.clone(),
                kind,
                places,
                active: Vec::new(),
                rows,
                past: columns,
                rest: role.rest.unwrap_or(REST),
                h,
                linear: dataset.input_hold == InputHold::Linear,
            });
        }
        for member in &mut members {
            member.settle();
        }
        let place = |z: u32| -> u32 {
            let z = z as usize;
            let place = if z < before.v() {
                z
            } else if z < before.a() {
                dims.v() + z - before.v()
            } else if z < before.u() {
                dims.a() + z - before.a()
            } else if z < before.u() + before.nq {
                dims.u() + z - before.u()
            } else if z < before.p() {
                dims.u() + states + z - before.u()
            } else {
                dims.p() + z - before.p()
            };
            place as u32
        };
        // Places keep their order.
        let moved = |list: &[u32]| -> Vec<u32> { list.iter().map(|&z| place(z)).collect() };
        let own = inner.jacobian_pattern();
        let (rows, cols) = (own.rows.to_vec(), moved(own.cols));
        let jacobian = Merged::new(
            Pattern {
                rows: &rows,
                cols: &cols,
            },
            members.iter().map(Member::jacobian_places),
        );
        let own = inner.hessian_pattern();
        let (rows, cols) = (moved(own.rows), moved(own.cols));
        let hessian = Merged::new(
            Pattern {
                rows: &rows,
                cols: &cols,
            },
            members.iter().map(Member::hessian_places),
        );
        Ok(Self {
            inner,
            dims,
            joints,
            params,
            inputs,
            members,
            rotors,
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
        let before = self.inner.dims();
        let states = self.dims.nq - before.nq;
        let mut u = SCRATCH.with(|s| std::mem::take(&mut *s.borrow_mut()));
        u.clear();
        u.extend_from_slice(&at.u[..before.nq]);
        u.extend_from_slice(&at.u[before.nq + states..before.nu + states]);
        let out = work(&At {
            q: &at.q[..before.nq],
            v: &at.v[..before.nq],
            a: at.a.get(..before.nq).unwrap_or(&[]),
            u: &u,
            p: &at.p[..before.np],
        });
        SCRATCH.with(|s| *s.borrow_mut() = u);
        out
    }
}

impl Member {
    /// Which arguments matter, found at points in motion.
    fn settle(&mut self) {
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

    fn jacobian_places(&self) -> Vec<(u32, u32)> {
        let place = |a: usize| self.places[a].unwrap_or(0) as u32;
        let rows = self.rows.iter();
        rows.flat_map(|&row| self.active.iter().map(move |&a| (row as u32, place(a))))
            .collect()
    }

    fn hessian_places(&self) -> Vec<(u32, u32)> {
        let place = |a: usize| self.places[a].unwrap_or(0) as u32;
        let mut out = Vec::new();
        for (i, &a) in self.active.iter().enumerate() {
            for &b in &self.active[..=i] {
                let (x, y) = (place(a), place(b));
                out.push((x.max(y), x.min(y)));
            }
        }
        out
    }

    /// Arguments at a point; without accelerations where none are given.
    fn arguments(&self, at: &At<'_>, d: &Dims) -> [Smooth; MOST] {
        let mut x = [Smooth::constant(0.0); MOST];
        for (x, place) in x.iter_mut().zip(&self.places) {
            let Some(z) = *place else { continue };
            let value = if z < d.v() {
                at.q[z]
            } else if z < d.a() {
                at.v[z - d.v()]
            } else if z < d.u() {
                at.a.get(z - d.a()).copied().unwrap_or(0.0)
            } else if z < d.p() {
                at.u[z - d.u()]
            } else {
                at.p[z - d.p()]
            };
            *x = Smooth::constant(value);
        }
        x
    }

    /// Dry and viscous friction at a velocity.
    fn friction(&self, x: &[Smooth; MOST], v: Smooth) -> Smooth {
        x[COULOMB] * (v / self.rest).hyperbolic_tangent() + x[VISCOUS] * v
    }

    /// Change of the joint's residual, and the residual of the state.
    fn change(&self, x: &[Smooth; MOST], past: &[f64]) -> [Smooth; 2] {
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
                let through = gear.stiffness * over + gear.damping * rate * touch;
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

    fn past<'a>(&self, at: &At<'a>) -> &'a [f64] {
        &at.u[self.past.clone()]
    }

    /// Adds the change to the residual and its first derivatives to their slots.
    fn first(&self, at: &At<'_>, d: &Dims, r: &mut [f64], slots: &[usize], values: &mut [f64]) {
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
    fn second(&self, at: &At<'_>, d: &Dims, lambda: &[f64], slots: &[usize], values: &mut [f64]) {
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

/// Adds a coordinate that no sensor reads to the records. The rotor of a gear starts where the
/// joint is; a memory starts at zero.
fn add_state(dataset: &mut Dataset, joint: usize, kind: Kind, name: &str) {
    let nq = dataset.nq();
    for e in &mut dataset.experiments {
        add_column(e, nq, joint, kind);
    }
    let mut channel = dataset.joints[joint].clone();
    channel.name = name.to_owned();
    channel.input_unit = dataset.joints[joint].force_unit().to_owned();
    channel.input = match channel.prismatic {
        true => pid_data::InputQuantity::Force,
        false => pid_data::InputQuantity::Torque,
    };
    if kind == Kind::Memory {
        channel.velocity = VelocityKind::Absent;
    }
    dataset.joints.push(channel);
}

fn add_column(e: &mut Experiment, nq: usize, joint: usize, kind: Kind) {
    let nu = e.nu();
    let wide = |x: &[f64], fill: &dyn Fn(usize, f64) -> f64| -> Vec<f64> {
        let rows = x.chunks_exact(nq).enumerate();
        rows.flat_map(|(i, row)| {
            let more = fill(i, row[joint]);
            row.iter().copied().chain([more]).collect::<Vec<f64>>()
        })
        .collect()
    };
    let nothing = |_: usize, _: f64| f64::NAN;
    match kind {
        Kind::Gear => {
            e.q = wide(&e.q, &|_, x| x);
            e.v = e.v.take().map(|v| wide(&v, &|_, x| x));
        }
        _ => {
            // The value is zero at the start of the record and is read nowhere else.
            e.q = wide(&e.q, &|i, _| if i == 0 { 0.0 } else { f64::NAN });
            e.v = e.v.take().map(|v| wide(&v, &nothing));
        }
    }
    e.tau = e.tau.take().map(|x| wide(&x, &nothing));
    e.qref = e.qref.take().map(|x| wide(&x, &nothing));
    let rows = e.u.chunks_exact(nu);
    e.u = rows
        .flat_map(|row| [&row[..nq], &[0.0], &row[nq..]].concat())
        .collect();
    e.nq += 1;
}

/// Adds the inputs of the samples before as columns, oldest first; before the first there is the first.
fn add_past(dataset: &mut Dataset, input: usize, count: usize) {
    for e in &mut dataset.experiments {
        let nu = e.nu();
        let own: Vec<f64> = e.u.iter().skip(input).step_by(nu).copied().collect();
        let rows = e.u.chunks_exact(nu).enumerate();
        e.u = rows
            .flat_map(|(k, row)| {
                let past = (1..=count).rev().map(|b| own[k.saturating_sub(b)]);
                row.iter().copied().chain(past).collect::<Vec<f64>>()
            })
            .collect();
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
