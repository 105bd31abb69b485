//! A model with effects of the library in its equations of motion: every estimator that takes a
//! model takes this one.
//!
//! An effect enters as a force on the joint, a change of its dry and viscous friction, a function
//! of its input, or an inertia of its rotor. Its equation is the library's own, with tanh(v/v₀) for
//! the sign of the velocity and rounded corners ([`Smooth`]); first and second derivatives come
//! from the same equation by hyper-dual numbers. Effects change the friction and the gain that the
//! model has: these parameters are recognised by what they do ([`roles`]).
//!
//! The torque through the gear, on which
//! [`LoadDependentFriction`](crate::effects::LoadDependentFriction) depends, is taken as that of
//! the drive less the friction that the model has and that which grows with it: the part that accelerates the rotor
//! counts as load, and other effects at the joint do not change it.

mod arguments;
mod assembled;
mod error;
mod group;
mod loops;
mod merge;
mod roles;
mod source;
mod states;
mod structure;

use std::borrow::Cow;

use pid_interpret::nominal as description;
use pid_runtime::dynamics::{
    At, Dims, Dynamics, Hessian, InputInfo, Jacobian, JointInfo, ParamInfo, Pattern,
};

use crate::described::{described, range, unit};
use crate::effect::{Effect, Parameter, Term, Unit};

pub use crate::smooth::Smooth;
pub use assembled::{AssembleError, Assembled};
pub use error::{EffectError, Obstacle};
use group::Group;
pub use loops::{WithLoops, gain_name};
use merge::Merged;
pub use roles::{JointRoles, roles};
pub use source::{SourceError, source};
pub use states::{Drives, WithStates};
pub use structure::with_masses;

/// An effect at a joint with the ranges of its parameters.
#[derive(Debug, Clone)]
pub struct Placed {
    /// Effect and joint.
    pub term: Term,
    /// Start, lower and upper end of each parameter, SI.
    pub ranges: Vec<(f64, f64, f64)>,
    /// Units of the parameters.
    pub units: Vec<String>,
}

/// Factor between a positive parameter and the ends of the range in which it is sought.
const DECADE: f64 = 10.0;
/// Half width of a range, in sizes of the value or of its interval.
const WIDE: f64 = 5.0;

/// Ends between which a parameter that a description states is sought: wide against its interval,
/// within what is possible.
fn sought(p: &Parameter, value: f64, interval: Option<(f64, f64)>) -> (f64, f64) {
    let (low, high) = range(p);
    if p.lower > 0.0 {
        return ((value / DECADE).max(low), (value * DECADE).min(high));
    }
    let spread = interval.map_or(0.0, |(a, b)| 0.5 * (b - a));
    let half = WIDE * value.abs().max(spread).max(1e-6);
    ((value - half).max(low), (value + half).min(high))
}

impl Placed {
    /// An effect at a joint, from the middle of its starts; `size` is that of a unit at the joint in
    /// the records.
    pub fn at(
        term: Term,
        nominal: &description::Nominal,
        size: &dyn Fn(Unit, usize) -> f64,
    ) -> Self {
        let info = term.effect.info();
        let start = info.starts.get(info.starts.len() / 2).copied();
        let ranges = info.parameters.iter().enumerate().map(|(i, p)| {
            let size = size(p.unit, term.joint);
            let start = start.and_then(|s| s.get(i)).copied().unwrap_or(p.lower);
            (start * size, p.lower * size, p.upper * size)
        });
        let units = info.parameters.iter();
        Placed {
            ranges: ranges.collect(),
            units: units.map(|p| unit(nominal, term.joint, p)).collect(),
            term,
        }
    }

    /// The effects of a description.
    ///
    /// # Errors
    /// As [`described`].
    pub fn of(nominal: &description::Nominal) -> Result<Vec<Self>, description::NominalError> {
        let all = described(nominal)?.into_iter().zip(nominal.effects());
        Ok(all
            .map(|((term, own), stated)| {
                let parameters = term.effect.info().parameters;
                let interval = |name: &str| {
                    let mut all = stated.parameters.iter();
                    all.find(|p| p.name == name).and_then(|p| p.interval)
                };
                Placed {
                    ranges: (parameters.iter().zip(&own))
                        .map(|(p, &x)| {
                            let (low, high) = sought(p, x, interval(p.name));
                            (x, low, high)
                        })
                        .collect(),
                    units: parameters
                        .iter()
                        .map(|p| unit(nominal, term.joint, p))
                        .collect(),
                    term,
                }
            })
            .collect())
    }
}

/// A model and the effects added to it. The parameters of the effects follow those of the model, each named
/// `EFFECT_PARAMETER_JOINT`.
pub struct WithEffects<'m> {
    inner: Box<dyn Hessian + 'm>,
    dims: Dims,
    params: Vec<ParamInfo>,
    groups: Vec<Group>,
    jacobian: Merged,
    hessian: Merged,
}

impl<'m> WithEffects<'m> {
    /// Adds effects to a model.
    ///
    /// # Errors
    /// [`EffectError`].
    pub fn new(inner: Box<dyn Hessian + 'm>, effects: &[Placed]) -> Result<Self, EffectError> {
        let roles = roles(inner.as_ref());
        let before = inner.dims();
        let mut params = inner.params().to_vec();
        let mut groups: Vec<Group> = Vec::new();
        for placed in effects {
            let first = params.len();
            name_parameters(inner.as_ref(), placed, &mut params)?;
            let joint = placed.term.joint;
            let at = match groups.iter().position(|g| g.joint == joint) {
                Some(at) => at,
                None => {
                    groups.push(Group::new(joint, &roles[joint], before));
                    groups.len() - 1
                }
            };
            let name = inner.joints()[joint].name.as_ref();
            let label = format!("{}:{name}", placed.term.effect.info().id);
            let start: Vec<f64> = placed.ranges.iter().map(|r| r.0).collect();
            groups[at].add(&placed.term.effect, &start, first, (&label, name))?;
        }
        let dims = Dims {
            np: params.len(),
            ..before
        };
        for group in &mut groups {
            group.settle(dims);
        }
        let jacobian = Merged::new(
            inner.jacobian_pattern(),
            groups.iter().map(Group::jacobian_places),
        );
        let hessian = Merged::new(
            inner.hessian_pattern(),
            groups.iter().map(Group::hessian_places),
        );
        Ok(Self {
            inner,
            dims,
            params,
            groups,
            jacobian,
            hessian,
        })
    }

    fn own<'a>(&self, at: &At<'a>) -> At<'a> {
        At {
            p: &at.p[..self.inner.dims().np],
            ..*at
        }
    }
}

/// Adds the parameters of an effect to those of a model.
fn name_parameters(
    model: &dyn Hessian,
    placed: &Placed,
    params: &mut Vec<ParamInfo>,
) -> Result<(), EffectError> {
    let info = placed.term.effect.info();
    let joint = model.joints()[placed.term.joint].name.as_ref();
    for ((p, unit), &(nominal, lower, upper)) in
        (info.parameters.iter().zip(&placed.units)).zip(&placed.ranges)
    {
        let name = match info.has_joint {
            true => format!("{}_{}_{joint}", info.id, p.name),
            false => format!("{}_{}", info.id, p.name),
        };
        if params.iter().any(|known| known.name == name) {
            return Err(EffectError::Twice {
                effect: format!("{}:{joint}", info.id),
                parameter: name,
            });
        }
        params.push(ParamInfo {
            name: Cow::Owned(name),
            unit: Cow::Owned(unit.clone()),
            doc: Cow::Borrowed(info.title),
            nominal,
            lower,
            upper,
            fixed: lower >= upper,
        });
    }
    Ok(())
}

/// Whether the equations of motion can take an effect, whatever the model.
///
/// # Errors
/// What stands in the way.
pub fn takes(effect: &dyn Effect) -> Result<(), Obstacle> {
    group::hooks(effect).map(|_| ())
}

impl Dynamics for WithEffects<'_> {
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
        self.inner.joints()
    }
    fn inputs(&self) -> &[InputInfo] {
        self.inner.inputs()
    }
    fn mass_matrix(&self, at: &At<'_>, m: &mut [f64]) {
        self.inner.mass_matrix(&self.own(at), m);
        for group in &self.groups {
            let j = group.joint;
            m[j * (j + 1) / 2 + j] += group.rotor(at.p);
        }
    }
    fn bias(&self, at: &At<'_>, b: &mut [f64]) {
        self.inner.bias(&self.own(at), b);
    }
    fn applied_force(&self, at: &At<'_>, f: &mut [f64]) {
        self.inner.applied_force(&self.own(at), f);
        for group in &self.groups {
            for (&row, x) in group.rows().iter().zip(group.force(at)) {
                f[row] -= x;
            }
        }
    }
    fn residual(&self, at: &At<'_>, r: &mut [f64]) {
        self.inner.residual(&self.own(at), r);
        for group in &self.groups {
            for (&row, x) in group.rows().iter().zip(group.value(at)) {
                r[row] += x;
            }
        }
    }
    fn kinetic_energy(&self, at: &At<'_>) -> f64 {
        let rotors = self.groups.iter();
        let rotors = rotors.map(|g| 0.5 * g.rotor(at.p) * at.v[g.joint].powi(2));
        self.inner.kinetic_energy(&self.own(at)) + rotors.sum::<f64>()
    }
    fn potential_energy(&self, at: &At<'_>) -> f64 {
        self.inner.potential_energy(&self.own(at))
    }
}

impl Jacobian for WithEffects<'_> {
    fn jacobian_pattern(&self) -> Pattern<'_> {
        self.jacobian.pattern()
    }
    fn residual_jacobian(&self, at: &At<'_>, r: &mut [f64], values: &mut [f64]) {
        let own = self.jacobian.own();
        self.inner
            .residual_jacobian(&self.own(at), r, &mut values[..own]);
        self.jacobian.spread(values);
        for (group, slots) in self.groups.iter().zip(self.jacobian.slots()) {
            group.first(at, r, slots, values);
        }
    }
}

impl Hessian for WithEffects<'_> {
    fn hessian_pattern(&self) -> Pattern<'_> {
        self.hessian.pattern()
    }
    fn residual_hessian(&self, at: &At<'_>, lambda: &[f64], values: &mut [f64]) {
        let own = self.hessian.own();
        self.inner
            .residual_hessian(&self.own(at), lambda, &mut values[..own]);
        self.hessian.spread(values);
        for (group, slots) in self.groups.iter().zip(self.hessian.slots()) {
            group.second(at, lambda, slots, values);
        }
    }
}

#[cfg(test)]
mod tests;
