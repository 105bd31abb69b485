//! Energies, and the Euler-Lagrange equations by automatic differentiation.
//!
//! With the twist `(v, ω)` of each body in its own frame, at its origin,
//!
//! ```text
//! T = Σ ½ m v·v + v·(ω × h) + ½ ω·I ω  +  ½ armature·v_joint²,        U = −g · Σ (first moments, in the base frame)
//! ```
//!
//! and `d/dt ∂T/∂v − ∂(T − U)/∂q = f_L`: both gradients by one reverse sweep, the time derivative
//! by one directional derivative along `(v, a)`. Christoffel symbols are never formed.

use pid_symbolic::{Graph, Id, diff};

use super::kinematics::{Motion, Tree};
use super::symbols::Symbols;
use super::vector;

/// Kinetic and potential energy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Energies {
    /// T(q, v, p), J.
    pub kinetic: Id,
    /// U(q, p), J; zero of the potential at the base origin.
    pub potential: Id,
}

/// The energies of a tree.
pub fn energies(g: &mut Graph, tree: &Tree, symbols: &Symbols) -> Energies {
    let half = g.constant(0.5);
    let mut kinetic = g.zero();
    let mut twists = Vec::with_capacity(tree.bodies.len());
    for body in &tree.bodies {
        let (of_parent_v, of_parent_w) = match body.parent {
            Some(parent) => twists[parent],
            None => (vector::zero(g), vector::zero(g)),
        };
        // At the body's origin: v_p + ω_p × d, then in the body's axes.
        let carried = vector::cross(g, of_parent_w, body.frame.origin);
        let at_origin = vector::add(g, of_parent_v, carried);
        let mut v = vector::apply_transposed(g, &body.frame.rotation, at_origin);
        let mut w = vector::apply_transposed(g, &body.frame.rotation, of_parent_w);
        let rate = body.rates.of(g, &symbols.v);
        match body.motion {
            Motion::Revolute(axis) => {
                let own = vector::scale(g, rate, axis);
                w = vector::add(g, w, own);
            }
            Motion::Prismatic(axis) => {
                let own = vector::scale(g, rate, axis);
                v = vector::add(g, v, own);
            }
        }
        twists.push((v, w));

        let speed = vector::dot(g, v, v);
        let translation = g.mul(body.inertia.mass, speed);
        let angular = vector::apply(g, &body.inertia.tensor, w);
        let rotation = vector::dot(g, w, angular);
        let twice = g.add(translation, rotation);
        let mut own = g.mul(half, twice);
        let lever = vector::cross(g, w, body.inertia.moment);
        let mixed = vector::dot(g, v, lever);
        own = g.add(own, mixed);
        if let Some(armature) = body.armature {
            let rotor = spinning(g, armature, rate);
            own = g.add(own, rotor);
        }
        kinetic = g.add(kinetic, own);
    }
    for rotor in &tree.rotors {
        let rate = rotor.rates.of(g, &symbols.v);
        let own = spinning(g, rotor.armature, rate);
        kinetic = g.add(kinetic, own);
    }
    Energies {
        kinetic,
        potential: potential(g, tree),
    }
}

/// `½ J w²`.
fn spinning(g: &mut Graph, inertia: Id, rate: Id) -> Id {
    let square = g.mul(rate, rate);
    let twice = g.mul(inertia, square);
    let half = g.constant(0.5);
    g.mul(half, twice)
}

/// Energies of a Lagrangian that is quadratic in the velocities: `T = ½ v·(∂L/∂v − ∂L/∂v|₀)`,
/// `U = −L|₀`, both at v = 0 where marked. T + U is conserved without applied forces; terms linear
/// in v (gyroscopic) do no work and are in neither.
pub fn energies_of(g: &mut Graph, lagrangian: Id, symbols: &Symbols) -> Energies {
    let momentum = diff::gradient(g, lagrangian, &symbols.v);
    let at_rest = at_rest(g, &momentum, symbols);
    let mut twice = g.zero();
    for ((&p, &p0), &v) in momentum.iter().zip(&at_rest).zip(&symbols.v) {
        let moving = g.sub(p, p0);
        let term = g.mul(v, moving);
        twice = g.add(twice, term);
    }
    let half = g.constant(0.5);
    let resting = self::at_rest(g, &[lagrangian], symbols)[0];
    Energies {
        kinetic: g.mul(half, twice),
        potential: g.neg(resting),
    }
}

fn at_rest(g: &mut Graph, outputs: &[Id], symbols: &Symbols) -> Vec<Id> {
    let zero = g.zero();
    let nq = symbols.q.len();
    g.substitute(outputs, |_, var| {
        (nq..2 * nq).contains(&(var as usize)).then_some(zero)
    })
}

/// U = −g·h, h the first moment of all bodies in the base frame, gathered from the tips inwards.
fn potential(g: &mut Graph, tree: &Tree) -> Id {
    let mut gathered: Vec<_> = tree
        .bodies
        .iter()
        .map(|body| (body.inertia.mass, body.inertia.moment))
        .collect();
    let mut in_base = vector::zero(g);
    for index in (0..tree.bodies.len()).rev() {
        let body = &tree.bodies[index];
        let (mass, moment) = gathered[index];
        let turned = vector::apply(g, &body.frame.rotation, moment);
        let moved = vector::scale(g, mass, body.frame.origin);
        let seen = vector::add(g, turned, moved);
        match body.parent {
            Some(parent) => {
                gathered[parent] = (
                    g.add(gathered[parent].0, mass),
                    vector::add(g, gathered[parent].1, seen),
                );
            }
            None => in_base = vector::add(g, in_base, seen),
        }
    }
    let work = vector::dot(g, tree.gravity, in_base);
    g.neg(work)
}

/// `d/dt ∂L/∂v − ∂L/∂q`, which is `M a + b`, one expression per coordinate.
pub fn equations(g: &mut Graph, lagrangian: Id, symbols: &Symbols) -> Vec<Id> {
    let momentum = diff::gradient(g, lagrangian, &symbols.v);
    let of_position = diff::gradient(g, lagrangian, &symbols.q);
    let along: Vec<(Id, Id)> = symbols
        .q
        .iter()
        .chain(&symbols.v)
        .copied()
        .zip(symbols.v.iter().chain(&symbols.a).copied())
        .collect();
    let rate = diff::directional(g, &momentum, &along);
    rate.into_iter()
        .zip(of_position)
        .map(|(rate, force)| g.sub(rate, force))
        .collect()
}
