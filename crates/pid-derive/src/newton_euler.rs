//! `M a + b` by the recursive Newton-Euler algorithm (J. Luh, M. Walker, R. Paul, 1980), symbolic.
//!
//! Outwards, in the axes of each body: angular velocity ω, angular acceleration α and acceleration
//! of the origin, the base accelerating with −g. Inwards: force and moment at the origin of each
//! body,
//!
//! ```text
//! f = m a + α × h + ω × (ω × h),        n = I α + ω × I ω + h × a.
//! ```
//!
//! It shares nothing with the energies: agreement with [`lagrangian`](super::lagrangian) proves
//! both by evaluation.

use pid_symbolic::{Graph, Id};

use super::kinematics::{Body, Motion, Tree};
use super::vector::{self, Vector};

/// Inputs of the recursion. They are expressions, so that it also gives columns of M (unit
/// accelerations) or gravity alone.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Motions {
    /// Joint velocities.
    pub v: Vec<Id>,
    /// Joint accelerations.
    pub a: Vec<Id>,
    /// Gravity in the base frame.
    pub gravity: Vector,
}

/// Joint forces, by coordinate.
pub fn equations(g: &mut Graph, tree: &Tree, motions: &Motions) -> Vec<Id> {
    let mut states: Vec<State> = Vec::with_capacity(tree.bodies.len());
    let mut wrenches = Vec::with_capacity(tree.bodies.len());
    let base = State {
        w: vector::zero(g),
        dw: vector::zero(g),
        acceleration: vector::neg(g, motions.gravity),
    };
    for body in &tree.bodies {
        let parent = body.parent.map_or(&base, |parent| &states[parent]);
        let state = State::of(g, body, parent, motions);
        wrenches.push(state.wrench(g, body));
        states.push(state);
    }
    let mut forces = felt(g, tree, motions, wrenches);
    for rotor in &tree.rotors {
        let acceleration = rotor.rates.of(g, &motions.a);
        let felt = g.mul(rotor.armature, acceleration);
        rotor.rates.add_force(g, felt, &mut forces);
    }
    forces
}

/// Angular velocity, its rate and the acceleration of the origin of a body, in its frame; that of the base is
/// minus gravity.
struct State {
    w: Vector,
    dw: Vector,
    acceleration: Vector,
}

impl State {
    /// Outward: of a body from that of its parent.
    fn of(g: &mut Graph, body: &Body, parent: &State, motions: &Motions) -> Self {
        let turned = |g: &mut Graph, x| vector::apply_transposed(g, &body.frame.rotation, x);
        let State {
            w,
            dw,
            acceleration,
        } = *parent;
        let at_origin = accelerated(g, w, dw, acceleration, body.frame.origin);
        let mut acceleration = turned(g, at_origin);
        let (mut w, mut dw) = (turned(g, w), turned(g, dw));
        let (rate, rate_of_rate) = (body.rates.of(g, &motions.v), body.rates.of(g, &motions.a));
        match body.motion {
            Motion::Revolute(axis) => {
                let own = vector::scale(g, rate, axis);
                let turned = vector::cross(g, w, own);
                let own_rate = vector::scale(g, rate_of_rate, axis);
                dw = vector::add(g, dw, own_rate);
                dw = vector::add(g, dw, turned);
                w = vector::add(g, w, own);
            }
            Motion::Prismatic(axis) => {
                let two = g.constant(2.0);
                let twice = g.mul(two, rate);
                let own = vector::scale(g, twice, axis);
                let coriolis = vector::cross(g, w, own);
                let own_rate = vector::scale(g, rate_of_rate, axis);
                acceleration = vector::add(g, acceleration, own_rate);
                acceleration = vector::add(g, acceleration, coriolis);
            }
        }
        State {
            w,
            dw,
            acceleration,
        }
    }

    /// Force and moment that move a body, about its origin.
    fn wrench(&self, g: &mut Graph, body: &Body) -> (Vector, Vector) {
        let (m, h) = (body.inertia.mass, body.inertia.moment);
        let translation = vector::scale(g, m, self.acceleration);
        let force = accelerated(g, self.w, self.dw, translation, h);
        let angular = vector::apply(g, &body.inertia.tensor, self.w);
        let gyroscopic = vector::cross(g, self.w, angular);
        let mut moment = vector::apply(g, &body.inertia.tensor, self.dw);
        moment = vector::add(g, moment, gyroscopic);
        let lever = vector::cross(g, h, self.acceleration);
        (force, vector::add(g, moment, lever))
    }
}

/// Inward: what the joints feel of the wrenches of the bodies.
fn felt(
    g: &mut Graph,
    tree: &Tree,
    motions: &Motions,
    mut wrenches: Vec<(Vector, Vector)>,
) -> Vec<Id> {
    let zero = g.zero();
    let mut forces = vec![zero; motions.v.len()];
    for (index, body) in tree.bodies.iter().enumerate().rev() {
        let (force, moment) = wrenches[index];
        let mut felt = match body.motion {
            Motion::Revolute(axis) => vector::dot(g, axis, moment),
            Motion::Prismatic(axis) => vector::dot(g, axis, force),
        };
        if let Some(armature) = body.armature {
            let acceleration = body.rates.of(g, &motions.a);
            let rotor = g.mul(armature, acceleration);
            felt = g.add(felt, rotor);
        }
        body.rates.add_force(g, felt, &mut forces);
        if let Some(parent) = body.parent {
            let force = vector::apply(g, &body.frame.rotation, force);
            let moment = vector::apply(g, &body.frame.rotation, moment);
            let lever = vector::cross(g, body.frame.origin, force);
            let moment = vector::add(g, moment, lever);
            let (at_parent_f, at_parent_n) = wrenches[parent];
            wrenches[parent] = (
                vector::add(g, at_parent_f, force),
                vector::add(g, at_parent_n, moment),
            );
        }
    }
    forces
}

/// `a + α × d + ω × (ω × d)`.
fn accelerated(g: &mut Graph, w: Vector, dw: Vector, a: Vector, d: Vector) -> Vector {
    let tangential = vector::cross(g, dw, d);
    let turning = vector::cross(g, w, d);
    let centripetal = vector::cross(g, w, turning);
    let sum = vector::add(g, a, tangential);
    vector::add(g, sum, centripetal)
}
