//! Mass matrix by composite bodies (M. Walker, D. Orin, 1982), symbolic.
//!
//! A joint that accelerates by one carries everything behind it as one rigid body. The force and
//! moment that this takes, transformed towards the base, are what the joints on the way feel: the
//! entries of M.

use pid_symbolic::{Graph, Id};

use super::kinematics::{Motion, Rates, Tree};
use super::vector::{self, Vector};

/// Lower triangle of M, row by row.
pub fn mass_matrix(g: &mut Graph, tree: &Tree, nq: usize) -> Vec<Id> {
    let mut composite: Vec<_> = tree.bodies.iter().map(|body| body.inertia).collect();
    for index in (0..tree.bodies.len()).rev() {
        let body = &tree.bodies[index];
        if let Some(parent) = body.parent {
            let seen = composite[index].seen_from_parent(g, &body.frame);
            composite[parent] = composite[parent].plus(g, &seen);
        }
    }
    let zero = g.zero();
    let mut m = vec![zero; nq * (nq + 1) / 2];
    for (index, body) in tree.bodies.iter().enumerate() {
        let whole = &composite[index];
        let (mut force, mut moment) = match body.motion {
            Motion::Revolute(axis) => (
                vector::cross(g, axis, whole.moment),
                vector::apply(g, &whole.tensor, axis),
            ),
            Motion::Prismatic(axis) => (
                vector::scale(g, whole.mass, axis),
                vector::cross(g, whole.moment, axis),
            ),
        };
        let mut own = felt(g, &body.motion, force, moment);
        if let Some(armature) = body.armature {
            own = g.add(own, armature);
        }
        add(g, &mut m, &body.rates, &body.rates, own);
        let mut child = body;
        while let Some(parent) = child.parent {
            force = vector::apply(g, &child.frame.rotation, force);
            moment = vector::apply(g, &child.frame.rotation, moment);
            let lever = vector::cross(g, child.frame.origin, force);
            moment = vector::add(g, moment, lever);
            child = &tree.bodies[parent];
            let entry = felt(g, &child.motion, force, moment);
            add(g, &mut m, &body.rates, &child.rates, entry);
            add(g, &mut m, &child.rates, &body.rates, entry);
        }
    }
    for rotor in &tree.rotors {
        add(g, &mut m, &rotor.rates, &rotor.rates, rotor.armature);
    }
    m
}

fn felt(g: &mut Graph, motion: &Motion, force: Vector, moment: Vector) -> Id {
    match *motion {
        Motion::Revolute(axis) => vector::dot(g, axis, moment),
        Motion::Prismatic(axis) => vector::dot(g, axis, force),
    }
}

/// Adds `x · left_i · right_j` to the entries i ≥ j.
fn add(g: &mut Graph, m: &mut [Id], left: &Rates, right: &Rates, x: Id) {
    for &(i, a) in &left.0 {
        for &(j, b) in right.0.iter().filter(|(j, _)| *j <= i) {
            let ratio = g.mul(a, b);
            let share = g.mul(ratio, x);
            let entry = &mut m[i * (i + 1) / 2 + j];
            *entry = g.add(*entry, share);
        }
    }
}
