//! Mass matrix and bias with the constants of the bodies as variables, and with a force on a tool.
//!
//! Simulations change constants that no parameter stands for: a payload, a tilted base, another
//! rotor. Here gravity, the ten inertial parameters of each body and the rotor inertia of each
//! coordinate are variables of their own, and their values are functions of the declared
//! parameters. Rotor inertias are left out of M: a drive may sit behind a gear that gives way.

use pid_symbolic::{Cost, Graph, Id, diff};

use super::composite;
use super::equations::{Derivations, by_derivative, mass_matrix};
use super::kinematics::{Rates, Tree};
use super::newton_euler::{self, Motions};
use super::regroup::{listed, of_list, regroup};
use super::symbols::{Blanks, Symbols};
use super::vector;
use crate::model::Robot;

/// Constants of one body.
pub const PER_BODY: usize = 10;
/// Constants of gravity, which come first.
pub const GRAVITY: usize = 3;

/// A point on a link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tool {
    /// Index of the link.
    pub link: usize,
    /// The point in its frame, m.
    pub at: [f64; 3],
}

/// Mass matrix and bias of a robot.
#[derive(Debug, Clone, PartialEq)]
pub struct Links {
    /// Variables.
    pub symbols: Symbols,
    /// Bodies: none of a robot declared by its Lagrangian.
    pub bodies: usize,
    /// Body of each coordinate's joint, if it has one.
    pub body_of: Vec<Option<usize>>,
    /// Body of the tool's link.
    pub tool_body: Option<usize>,
    /// Number of the first variable of the constants: gravity (3), mass, first moment, xx, yy, zz,
    /// xy, xz, yz about the origin of each body (10 each), rotor inertia of each coordinate.
    pub first: usize,
    /// The constants as functions of the parameters.
    pub values: Vec<Id>,
    /// Variables of a force on the tool, N, in base axes.
    pub force: [Id; 3],
    /// Lower triangle of M without rotors, row by row.
    pub mass_matrix: Vec<Id>,
    /// b.
    pub bias: Vec<Id>,
    /// M a + b without rotors, by one recursion: fewer operations than both apart.
    pub inertial: Vec<Id>,
    /// b − Jᵀ f with the force f on the tool; `None` without a tool or bodies.
    pub pushed: Option<Vec<Id>>,
}

/// Derives them, each in the form with the fewest operations.
pub fn links(g: &mut Graph, robot: &Robot, tool: Option<Tool>) -> Links {
    let symbols = Symbols::new(g, robot, Blanks::Zero);
    let nq = symbols.q.len();
    let mut tree = Tree::new(g, robot, &symbols);
    let first = symbols.z().len() + nq;
    let rotors = own_rotors(g, &mut tree, nq);
    let mut values: Vec<Id> = tree.gravity.to_vec();
    for body in &tree.bodies {
        values.extend(listed(&body.inertia));
    }
    values.extend(rotors);
    let constants: Vec<Id> = (0..values.len()).map(|k| g.var(first + k)).collect();
    let force = [0, 1, 2].map(|k| g.var(first + values.len() + k));

    tree.gravity = [constants[0], constants[1], constants[2]];
    for (index, body) in tree.bodies.iter_mut().enumerate() {
        // A link without mass, as between two axes of a wrist, stays one.
        if listed(&body.inertia).iter().all(|&x| g.is_zero(x)) {
            continue;
        }
        let at = GRAVITY + PER_BODY * index;
        body.inertia = of_list(&std::array::from_fn(|k| constants[at + k]));
    }
    let body_of = (0..nq)
        .map(|j| {
            (tree.bodies.iter()).position(
                |b| matches!(&b.rates.0[..], [(i, one)] if *i == j && g.value(*one) == Some(1.0)),
            )
        })
        .collect();
    regroup(g, &mut tree, &symbols.q);
    let Forces {
        mass_matrix,
        bias,
        inertial,
    } = match robot.lagrangian {
        Some(_) => of_lagrangian(g, robot, &tree, &symbols),
        None => of_bodies(g, robot, &tree, &symbols),
    };
    let pushed = tool.and_then(|tool| {
        let frame = tree.link_frame(g, tool.link)?;
        let at = vector::constant(g, tool.at);
        let turned = vector::apply(g, &frame.rotation, at);
        let place = vector::add(g, frame.origin, turned);
        let work = vector::dot(g, force, place);
        let push = diff::gradient(g, work, &symbols.q);
        let less = bias.iter().zip(push).map(|(&b, push)| g.sub(b, push));
        Some(less.collect())
    });
    Links {
        bodies: tree.bodies.len(),
        tool_body: tool.and_then(|tool| tree.body_of_link(tool.link)),
        body_of,
        symbols,
        first,
        values,
        force,
        mass_matrix,
        bias,
        inertial,
        pushed,
    }
}

/// M, b and M a + b.
struct Forces {
    mass_matrix: Vec<Id>,
    bias: Vec<Id>,
    inertial: Vec<Id>,
}

/// Takes the rotor inertias that belong to one coordinate each out of the tree.
fn own_rotors(g: &mut Graph, tree: &mut Tree, nq: usize) -> Vec<Id> {
    let mut rotors = vec![g.zero(); nq];
    let single = |g: &Graph, rates: &Rates| match rates.0[..] {
        [(j, ratio)] if g.value(ratio) == Some(1.0) => Some(j),
        _ => None,
    };
    for body in &mut tree.bodies {
        if let (Some(j), Some(armature)) = (single(g, &body.rates), body.armature) {
            rotors[j] = g.add(rotors[j], armature);
            body.armature = None;
        }
    }
    tree.rotors.retain(|rotor| match single(g, &rotor.rates) {
        Some(j) => {
            rotors[j] = g.add(rotors[j], rotor.armature);
            false
        }
        None => true,
    });
    rotors
}

fn of_bodies(g: &mut Graph, robot: &Robot, tree: &Tree, symbols: &Symbols) -> Forces {
    let nq = symbols.q.len();
    let motions = |a: Vec<Id>| Motions {
        v: symbols.v.clone(),
        a,
        gravity: tree.gravity,
    };
    let zero = g.zero();
    let mut bias = newton_euler::equations(g, tree, &motions(vec![zero; nq]));
    let mut inertial = newton_euler::equations(g, tree, &motions(symbols.a.clone()));
    let candidates = [
        mass_matrix(g, tree, symbols, &inertial),
        composite::mass_matrix(g, tree, nq),
    ];
    let cost = |m: &Vec<Id>| Cost::of(g, &[&m[..], &bias].concat()).total();
    let [by_forces, by_composites] = candidates;
    let mass_matrix = match cost(&by_composites) < cost(&by_forces) {
        true => by_composites,
        false => by_forces,
    };
    if let Some(extra) = &robot.potential {
        let extra = symbols.expression(g, extra);
        let slope = diff::gradient(g, extra, &symbols.q);
        for ((bias, inertial), slope) in bias.iter_mut().zip(&mut inertial).zip(slope) {
            *bias = g.add(*bias, slope);
            *inertial = g.add(*inertial, slope);
        }
    }
    Forces {
        mass_matrix,
        bias,
        inertial,
    }
}

fn of_lagrangian(g: &mut Graph, robot: &Robot, tree: &Tree, symbols: &Symbols) -> Forces {
    let nq = symbols.q.len();
    let inertial = Derivations::new(g, robot, tree, symbols).lagrange;
    let zero = g.zero();
    let bias = g.substitute(&inertial, |_, var| {
        (2 * nq..3 * nq).contains(&(var as usize)).then_some(zero)
    });
    Forces {
        mass_matrix: by_derivative(g, symbols, &inertial),
        bias,
        inertial,
    }
}
