//! Links that move as one: bodies of a description, and the [`Mechanism`] they form.

use pid_derive::mechanism::{Body, Distribution, Follows, InertiaSource, Mechanism, Place};

use crate::description::{Description, Motion};
use crate::names;

/// The links that one moving joint carries rigidly.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Rigid {
    /// The joint.
    pub(crate) joint: usize,
    /// Index of the body that carries the joint, `None` for the base.
    pub(crate) parent: Option<usize>,
    /// Place of the joint's frame in the frame of that body, or of the root link.
    pub(crate) place: Place,
    /// Whether no fixed joint stands between the joint and the frame that carries it.
    direct: bool,
    /// Links with their places in the frame of the body; the first one is the child of the joint.
    pub(crate) links: Vec<(usize, Place)>,
}

impl Description {
    /// Moving bodies, depth first.
    pub(crate) fn rigid(&self) -> Vec<Rigid> {
        let mut bodies: Vec<Rigid> = Vec::new();
        let mut carrier = vec![(None, Place::IDENTITY, true); self.links.len()];
        for &index in &self.order {
            let joint = &self.joints[index];
            let (body, place, direct) = carrier[joint.parent];
            if joint.moves() {
                bodies.push(Rigid {
                    joint: index,
                    parent: body,
                    place: place.then(&Place::new(joint.origin, joint.rpy)),
                    direct,
                    links: vec![(joint.child, Place::IDENTITY)],
                });
                carrier[joint.child] = (Some(bodies.len() - 1), Place::IDENTITY, true);
                continue;
            }
            let place = place.then(&joint.place(joint.held.unwrap_or(0.0)));
            if let Some(body) = body {
                bodies[body].links.push((joint.child, place));
            }
            carrier[joint.child] = (body, place, false);
        }
        bodies
    }

    /// Mass distribution of a body in its frame.
    pub(crate) fn merged(&self, body: &Rigid) -> Distribution {
        let parts = body.links.iter().filter_map(|(link, place)| {
            let inertial = self.links[*link].inertial.as_ref()?;
            Some(inertial.distribution().placed(place))
        });
        parts
            .reduce(|all, part| all.with(&part))
            .unwrap_or_default()
    }

    /// The moving bodies in numbers, depth first in the order of the file; `gravity` in the frame of
    /// the root link, m/s². Friction of zero counts as not stated: files of many tools have it
    /// throughout.
    pub fn mechanism(&self, gravity: [f64; 3]) -> Mechanism {
        let rigid = self.rigid();
        let body_of = |joint: usize| rigid.iter().position(|body| body.joint == joint);
        let bodies = rigid.iter().map(|body| {
            let joint = &self.joints[body.joint];
            let (prismatic, axis) = match joint.motion {
                Motion::Prismatic(axis) => (true, axis),
                Motion::Revolute(axis) => (false, axis),
                Motion::Fixed => (false, [0.0; 3]),
            };
            // Untouched numbers stay exactly as they are written.
            let (origin, rpy) = match body.direct {
                true => (joint.origin, joint.rpy),
                false => (body.place.origin, body.place.rpy()),
            };
            let all = self.merged(body);
            let sources = body.links.iter().map(|(link, _)| self.links[*link].source);
            let stated = |x: f64| (x > 0.0).then_some(x);
            Body {
                joint: joint.identifier.clone(),
                link: self.links[joint.child].name.clone(),
                prismatic,
                axis,
                parent: body.parent,
                origin,
                rpy,
                follows: joint.mimic.and_then(|mimic| {
                    Some(Follows {
                        body: body_of(mimic.joint)?,
                        ratio: mimic.multiplier,
                        offset: mimic.offset,
                    })
                }),
                limits: joint.limits,
                mass: all.mass,
                com: all.com,
                inertia: all.inertia,
                source: sources.max().unwrap_or(InertiaSource::Stated),
                rotor: None,
                coulomb: stated(joint.friction),
                viscous: stated(joint.damping),
                effort: joint.effort,
                speed: joint.speed,
            }
        });
        Mechanism {
            name: names::type_name(&self.name),
            gravity,
            bodies: bodies.collect(),
        }
    }
}
