//! The tree of moving bodies.
//!
//! Links that are joined rigidly are one body: a fixed joint moves the inertia of its child into the body that carries it,
//! so it costs nothing at run time. What is fixed to the base has no equations and is left out.

use pid_symbolic::{Graph, Id};

use super::inertia::Inertia;
use super::symbols::Symbols;
use super::vector::{self, Frame, Vector};
use crate::model::{JointKind, Robot};

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
    /// Coordinate of its joint.
    pub coord: usize,
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

/// Moving bodies, parents before children, and gravity.
#[derive(Debug, Clone, PartialEq)]
pub struct Tree {
    /// The bodies.
    pub bodies: Vec<Body>,
    /// Gravity in the base frame.
    pub gravity: Vector,
}

impl Tree {
    /// The tree of a robot.
    pub fn new(g: &mut Graph, robot: &Robot, symbols: &Symbols) -> Self {
        let mut bodies: Vec<Body> = Vec::new();
        // The body that carries each link, with the link's frame in it; `None` before its joint was visited.
        let mut carrier: Vec<Option<(Option<usize>, Frame)>> = vec![None; robot.links.len()];
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

            let (motion, frame) = match joint.kind {
                JointKind::Fixed => {
                    if let Some(body) = parent {
                        let seen = link.seen_from_parent(g, &at_zero);
                        bodies[body].inertia = bodies[body].inertia.plus(g, &seen);
                    }
                    carrier[joint.child] = Some((parent, at_zero));
                    continue;
                }
                JointKind::Revolute(axis) => {
                    let q = symbols.q[joint.coord.expect("a moving joint has a coordinate")];
                    let turn = Frame {
                        rotation: vector::rotation(g, axis, q),
                        origin: vector::zero(g),
                    };
                    (
                        Motion::Revolute(vector::constant(g, axis)),
                        at_zero.then(g, &turn),
                    )
                }
                JointKind::Prismatic(axis) => {
                    let q = symbols.q[joint.coord.expect("a moving joint has a coordinate")];
                    let axis = vector::constant(g, axis);
                    let slide = Frame {
                        rotation: vector::identity(g),
                        origin: vector::scale(g, q, axis),
                    };
                    (Motion::Prismatic(axis), at_zero.then(g, &slide))
                }
            };
            carrier[joint.child] = Some((Some(bodies.len()), base));
            bodies.push(Body {
                coord: joint.coord.expect("a moving joint has a coordinate"),
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
        Self {
            bodies,
            gravity: symbols.vector(g, &robot.gravity),
        }
    }
}
