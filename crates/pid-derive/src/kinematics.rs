//! The tree of moving bodies.
//!
//! Links that are joined rigidly are one body: a fixed or held joint moves the inertia of its child
//! into the body that carries it, so it costs nothing at run time. A joint that follows others is a
//! function of their coordinates. Links fixed to the base have no equations and are left out.

use pid_symbolic::{Graph, Id};

use super::inertia::Inertia;
use super::symbols::Symbols;
use super::vector::{self, Frame, Vector};
use crate::model::{Affine, Joint, JointKind, Robot};

/// How a body moves relative to its parent. Axes are of unit length, in the frame of the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// Rotation about an axis through the origin.
    Revolute(Vector),
    /// Translation along an axis.
    Prismatic(Vector),
}

/// A moving body and the joint that carries it.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// How its joint moves with the coordinates.
    pub rates: Rates,
    /// Position of the parent in [`Tree::bodies`], `None` for the base.
    pub parent: Option<usize>,
    /// Its frame in the frame of the parent, a function of the coordinate.
    pub frame: Frame,
    /// The motion of its joint.
    pub motion: Motion,
    /// Inertia of all links that are rigidly part of it.
    pub inertia: Inertia,
    /// Rotor inertia or mass felt at the joint.
    pub armature: Option<Id>,
}

/// Ratios to coordinates: position `Σ ratio·q` (and an offset), velocity `Σ ratio·v`, forces `ratio·f`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rates(pub Vec<(usize, Id)>);

impl Rates {
    /// `Σ ratio·x`.
    pub fn of(&self, g: &mut Graph, x: &[Id]) -> Id {
        let mut sum = g.zero();
        for &(coord, ratio) in &self.0 {
            let term = g.mul(ratio, x[coord]);
            sum = g.add(sum, term);
        }
        sum
    }

    /// Adds the force `f` on this motion to the forces on the coordinates.
    pub fn add_force(&self, g: &mut Graph, f: Id, forces: &mut [Id]) {
        for &(coord, ratio) in &self.0 {
            let share = g.mul(ratio, f);
            forces[coord] = g.add(forces[coord], share);
        }
    }

    /// Those of an affine combination.
    pub fn new(g: &mut Graph, symbols: &Symbols, affine: &Affine) -> Self {
        let term = |(coord, ratio): &(usize, _)| (*coord, symbols.expression(g, ratio));
        Self(affine.terms.iter().map(term).collect())
    }

    /// Those of a joint; empty if it does not move.
    pub fn of_joint(g: &mut Graph, symbols: &Symbols, joint: &Joint) -> Self {
        match (joint.coord, &joint.follows) {
            (Some(coord), _) => Self(vec![(coord, g.one())]),
            (None, Some(affine)) => Self::new(g, symbols, affine),
            (None, None) => Self(Vec::new()),
        }
    }
}

/// The inertia of a drive that moves several joints.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rotor {
    /// How it moves with the coordinates.
    pub rates: Rates,
    /// Its inertia.
    pub armature: Id,
}

/// A link's frame: the body it is part of, `None` for the base, and its place in that body.
type Carried = (Option<usize>, Frame);

/// Moving bodies, parents before children, and gravity.
#[derive(Debug, Clone, PartialEq)]
pub struct Tree {
    /// The bodies.
    pub bodies: Vec<Body>,
    /// Each link's frame; `None` for a link that no joint carries.
    links: Vec<Option<Carried>>,
    /// Drives that move several joints.
    pub rotors: Vec<Rotor>,
    /// Gravity in the base frame.
    pub gravity: Vector,
}

impl Tree {
    /// The tree of a robot.
    pub fn new(g: &mut Graph, robot: &Robot, symbols: &Symbols) -> Self {
        let mut bodies: Vec<Body> = Vec::new();
        // The body that carries each link, with the link's frame in it; `None` before its joint was visited.
        let mut carrier: Vec<Option<Carried>> = vec![None; robot.links.len()];
        let base = Frame::identity(g);
        for &index in &robot.order {
            let joint = &robot.joints[index];
            let (parent, parent_frame) = match joint.parent {
                None => (None, base),
                Some(link) => carrier[link].expect("`order` has the joint of a parent link first"),
            };
            let rpy = symbols.vector(g, &joint.rpy);
            let origin = symbols.vector(g, &joint.origin);
            let placed = Frame {
                rotation: vector::roll_pitch_yaw(g, rpy),
                origin,
            };
            let at_zero = parent_frame.then(g, &placed);
            let link = Inertia::of_link(g, symbols, &robot.links[joint.child].inertial);

            let rates = Rates::of_joint(g, symbols, joint);
            let mut position = rates.of(g, &symbols.q);
            if let (None, Some(affine)) = (joint.coord, &joint.follows) {
                let offset = symbols.expression(g, &affine.offset);
                position = g.add(position, offset);
            }
            let (motion, frame) = match joint.kind {
                JointKind::Fixed | JointKind::Angle | JointKind::Length => (None, at_zero),
                JointKind::Revolute(axis) => {
                    let turn = Frame {
                        rotation: vector::rotation(g, axis, position),
                        origin: vector::zero(g),
                    };
                    (
                        Some(Motion::Revolute(vector::constant(g, axis))),
                        at_zero.then(g, &turn),
                    )
                }
                JointKind::Prismatic(axis) => {
                    let axis = vector::constant(g, axis);
                    let slide = Frame {
                        rotation: vector::identity(g),
                        origin: vector::scale(g, position, axis),
                    };
                    (Some(Motion::Prismatic(axis)), at_zero.then(g, &slide))
                }
            };
            let Some(motion) = motion.filter(|_| !rates.0.is_empty()) else {
                if let Some(body) = parent {
                    let seen = link.seen_from_parent(g, &frame);
                    bodies[body].inertia = bodies[body].inertia.plus(g, &seen);
                }
                carrier[joint.child] = Some((parent, frame));
                continue;
            };
            carrier[joint.child] = Some((Some(bodies.len()), base));
            bodies.push(Body {
                rates,
                parent,
                frame,
                motion,
                inertia: link,
                armature: joint
                    .armature
                    .as_ref()
                    .map(|armature| symbols.expression(g, armature)),
            });
        }
        let rotors = robot
            .motors
            .iter()
            .filter_map(|motor| {
                Some(Rotor {
                    armature: symbols.expression(g, motor.armature.as_ref()?),
                    rates: Rates::new(g, symbols, &motor.moves),
                })
            })
            .collect();
        Self {
            bodies,
            links: carrier,
            rotors,
            gravity: symbols.vector(g, &robot.gravity),
        }
    }

    /// The body that a link is part of, its place in [`Tree::bodies`]; `None` for the base and for
    /// a link that no joint carries.
    pub fn body_of_link(&self, link: usize) -> Option<usize> {
        self.links.get(link)?.as_ref()?.0
    }

    /// The frame of a link in the base frame, a function of the coordinates; `None` for a link that
    /// no joint carries.
    pub fn link_frame(&self, g: &mut Graph, link: usize) -> Option<Frame> {
        let (mut body, mut frame) = *self.links.get(link)?.as_ref()?;
        while let Some(index) = body {
            frame = self.bodies[index].frame.then(g, &frame);
            body = self.bodies[index].parent;
        }
        Some(frame)
    }
}
