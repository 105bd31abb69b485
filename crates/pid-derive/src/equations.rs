//! The equations of motion of a robot, and the quantities read off them.
//!
//! ```text
//! r(q, v, a, u, p) = M(q, p) a + b(q, v, p) − f_L(q, v, p, u)
//! ```
//!
//! `M a + b` is derived twice, by Euler-Lagrange and by Newton-Euler. Both are evaluated at random
//! points and must agree; the one with fewer operations is used.

use std::fmt;

use pid_symbolic::random::Random;
use pid_symbolic::{Cost, Graph, Id, Tape, diff};

use super::kinematics::{Rates, Tree};
use super::lagrangian::{self, Energies};
use super::newton_euler::{self, Motions};
use super::symbols::{Blanks, Symbols};
use super::{Error, sample, vector};
use crate::model::Robot;

/// The two derivations must agree to this share of the largest force at the point.
const AGREEMENT: f64 = 1e-11;
/// Number of comparison points that must be finite, and number of points tried to find them.
const POINTS: (usize, usize) = (4, 40);

/// A derivation of `M a + b`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Derivation {
    /// Euler-Lagrange.
    Lagrange,
    /// Recursive Newton-Euler.
    NewtonEuler,
}

impl fmt::Display for Derivation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Lagrange => "Euler-Lagrange",
            Self::NewtonEuler => "recursive Newton-Euler",
        })
    }
}

/// The equations of motion as expressions.
#[derive(Debug, Clone, PartialEq)]
pub struct Equations {
    /// Variables.
    pub symbols: Symbols,
    /// r, one per coordinate.
    pub residual: Vec<Id>,
    /// Lower triangle of M, row by row.
    pub mass_matrix: Vec<Id>,
    /// b.
    pub bias: Vec<Id>,
    /// b at v = 0.
    pub gravity: Vec<Id>,
    /// f_L.
    pub applied_force: Vec<Id>,
    /// T and U.
    pub energies: Energies,
    /// The derivation that the residual is written in.
    pub derivation: Derivation,
    /// Operations of r by Euler-Lagrange.
    pub lagrange: Cost,
    /// Operations of r by Newton-Euler; there is none of a bare Lagrangian.
    pub newton_euler: Option<Cost>,
}

/// Both derivations of `M a + b`, not yet compared.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Derivations {
    /// T and U.
    pub energies: Energies,
    /// By Euler-Lagrange.
    pub lagrange: Vec<Id>,
    /// By Newton-Euler, where there are bodies.
    pub newton_euler: Option<Vec<Id>>,
}

impl Derivations {
    /// Derives `M a + b` twice; once if the robot is given by its Lagrangian.
    pub fn new(g: &mut Graph, robot: &Robot, tree: &Tree, symbols: &Symbols) -> Self {
        let extra = robot.potential.as_ref().map(|u| symbols.expression(g, u));
        if let Some(given) = &robot.lagrangian {
            let mut lagrangian = symbols.expression(g, given);
            if let Some(extra) = extra {
                lagrangian = g.sub(lagrangian, extra);
            }
            return Self {
                energies: lagrangian::energies_of(g, lagrangian, symbols),
                lagrange: lagrangian::equations(g, lagrangian, symbols),
                newton_euler: None,
            };
        }
        let mut energies = lagrangian::energies(g, tree, symbols);
        if let Some(extra) = extra {
            energies.potential = g.add(energies.potential, extra);
        }
        let lagrangian = g.sub(energies.kinetic, energies.potential);
        let lagrange = lagrangian::equations(g, lagrangian, symbols);
        let motions = Motions {
            v: symbols.v.clone(),
            a: symbols.a.clone(),
            gravity: tree.gravity,
        };
        let mut newton_euler = newton_euler::equations(g, tree, &motions);
        if let Some(extra) = extra {
            let slope = diff::gradient(g, extra, &symbols.q);
            for (force, slope) in newton_euler.iter_mut().zip(slope) {
                *force = g.add(*force, slope);
            }
        }
        Self {
            energies,
            lagrange,
            newton_euler: Some(newton_euler),
        }
    }

    /// Evaluates both at random points.
    ///
    /// # Errors
    /// If they differ, or are finite at no point.
    pub fn compare(&self, g: &Graph, robot: &Robot) -> Result<(), Error> {
        let nq = robot.nq();
        let outputs: Vec<Id> = self
            .lagrange
            .iter()
            .chain(self.newton_euler.as_ref().unwrap_or(&self.lagrange))
            .copied()
            .collect();
        let tape = Tape::new(g, &outputs);
        let mut random = Random::new(0x1a67);
        let mut values = vec![0.0; 2 * nq];
        let mut finite = 0;
        for _ in 0..POINTS.1 {
            tape.eval(&sample::point(robot, &mut random), &mut values);
            if !values.iter().all(|value| value.is_finite()) {
                continue;
            }
            let scale = values
                .iter()
                .fold(0.0_f64, |scale, value| scale.max(value.abs()));
            for coord in 0..nq {
                let (lagrange, newton_euler) = (values[coord], values[nq + coord]);
                if (lagrange - newton_euler).abs() > AGREEMENT * scale {
                    let joint = robot.joints.iter().find(|joint| joint.coord == Some(coord));
                    return Err(Error::DerivationsDisagree {
                        robot: robot.name.clone(),
                        joint: joint.map_or_else(String::new, |joint| joint.name.clone()),
                        lagrange,
                        newton_euler,
                    });
                }
            }
            finite += 1;
            if finite == POINTS.0 {
                return Ok(());
            }
        }
        if finite == 0 {
            return Err(Error::NowhereFinite {
                robot: robot.name.clone(),
                points: POINTS.1,
            });
        }
        Ok(())
    }
}

/// f_L, one per coordinate.
pub fn applied_force(g: &mut Graph, robot: &Robot, symbols: &Symbols) -> Vec<Id> {
    let mut forces = vec![g.zero(); robot.nq()];
    for joint in &robot.joints {
        if let Some(force) = &joint.force {
            let force = symbols.expression(g, force);
            Rates::of_joint(g, symbols, joint).add_force(g, force, &mut forces);
        }
    }
    for motor in &robot.motors {
        if let Some(force) = &motor.force {
            let force = symbols.expression(g, force);
            Rates::new(g, symbols, &motor.moves).add_force(g, force, &mut forces);
        }
    }
    forces
}

/// The equations of a robot; entries written `_` are zero.
///
/// # Errors
/// If the two derivations differ, or are finite at no point.
pub fn equations(g: &mut Graph, robot: &Robot) -> Result<Equations, Error> {
    let symbols = Symbols::new(g, robot, Blanks::Zero);
    let tree = Tree::new(g, robot, &symbols);
    let derivations = Derivations::new(g, robot, &tree, &symbols);
    derivations.compare(g, robot)?;

    let applied_force = applied_force(g, robot, &symbols);
    let minus_force = |g: &mut Graph, inertial: &[Id]| -> Vec<Id> {
        inertial
            .iter()
            .zip(&applied_force)
            .map(|(&inertial, &force)| g.sub(inertial, force))
            .collect()
    };
    let by_lagrange = minus_force(g, &derivations.lagrange);
    let lagrange = Cost::of(g, &by_lagrange);
    let by_newton_euler = derivations.newton_euler.map(|inertial| {
        let residual = minus_force(g, &inertial);
        (Cost::of(g, &residual), inertial, residual)
    });
    let newton_euler = by_newton_euler.as_ref().map(|(cost, ..)| *cost);
    let (derivation, inertial, residual) = match by_newton_euler {
        Some((cost, inertial, residual)) if cost.total() <= lagrange.total() => {
            (Derivation::NewtonEuler, inertial, residual)
        }
        _ => (Derivation::Lagrange, derivations.lagrange, by_lagrange),
    };

    let zero = g.zero();
    let nq = symbols.q.len();
    let bias = g.substitute(&inertial, |_, var| {
        (2 * nq..3 * nq).contains(&(var as usize)).then_some(zero)
    });
    let gravity = g.substitute(&bias, |_, var| {
        (nq..2 * nq).contains(&(var as usize)).then_some(zero)
    });
    let mass_matrix = match robot.lagrangian {
        None => mass_matrix(g, &tree, &symbols, &inertial),
        Some(_) => by_derivative(g, &symbols, &inertial),
    };
    Ok(Equations {
        symbols,
        residual,
        mass_matrix,
        bias,
        gravity,
        applied_force,
        energies: derivations.energies,
        derivation,
        lagrange,
        newton_euler,
    })
}

/// Lower triangle of M = ∂(M a + b)/∂a.
pub(crate) fn by_derivative(g: &mut Graph, symbols: &Symbols, inertial: &[Id]) -> Vec<Id> {
    let rows = diff::jacobian(g, inertial, &symbols.a);
    rows.iter()
        .enumerate()
        .flat_map(|(i, row)| row[..=i].to_vec())
        .collect()
}

/// Lower triangle of M: ∂(M a + b)/∂a, or the forces of unit accelerations, whichever is cheaper.
pub(crate) fn mass_matrix(
    g: &mut Graph,
    tree: &Tree,
    symbols: &Symbols,
    inertial: &[Id],
) -> Vec<Id> {
    let by_derivative = by_derivative(g, symbols, inertial);
    let (zero, one) = (g.zero(), g.one());
    let nq = symbols.q.len();
    let columns: Vec<Vec<Id>> = (0..nq)
        .map(|k| {
            let mut a = vec![zero; nq];
            a[k] = one;
            let motions = Motions {
                v: vec![zero; nq],
                a,
                gravity: vector::zero(g),
            };
            newton_euler::equations(g, tree, &motions)
        })
        .collect();
    let by_columns: Vec<Id> = (0..nq)
        .flat_map(|i| (0..=i).map(move |j| (i, j)))
        .map(|(i, j)| columns[j][i])
        .collect();
    if Cost::of(g, &by_columns).total() < Cost::of(g, &by_derivative).total() {
        by_columns
    } else {
        by_derivative
    }
}
