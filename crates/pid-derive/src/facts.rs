//! Proofs about a robot for the checker: derivatives that vanish at random points, and a
//! factorization of M.

use pid_symbolic::random::Random;
use pid_symbolic::{Cost, Function, Graph, Id, Node, Tape, diff, pattern};

use super::equations::{self, Derivations};
use super::kinematics::Tree;
use super::sample;
use super::symbols::{Blanks, Symbols};
use crate::model::Robot;

/// Coordinates at which M is factorised.
const POINTS: usize = 8;
/// A pivot of M below this share of its diagonal entry is zero.
const PIVOT: f64 = 1e-10;

/// Proved properties of a robot.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Facts {
    /// Entries written `_` that enter an equation: index of the blank, coordinate of the equation.
    pub blank_violations: Vec<(usize, usize)>,
    /// Parameters that enter no equation.
    pub unused_params: Vec<usize>,
    /// Inputs that enter no equation.
    pub unused_inputs: Vec<usize>,
    /// The coordinate whose momentum ∂L/∂v is not linear in the velocities: M would depend on them.
    pub velocity_in_mass: Option<usize>,
    /// The coordinate at which M is not positive definite, at nominal parameters.
    pub singular_mass: Option<usize>,
    /// Whether `abs` or `sign` occur in the equations.
    pub nonsmooth: bool,
    /// Operations of the residual, by the cheaper derivation (blanks counted as parameters).
    pub residual: Cost,
}

/// Proves the facts of a robot.
pub fn facts(robot: &Robot) -> Facts {
    let mut g = Graph::new();
    let symbols = Symbols::new(&mut g, robot, Blanks::Free);
    let tree = Tree::new(&mut g, robot, &symbols);
    let derivations = Derivations::new(&mut g, robot, &tree, &symbols);
    let force = equations::applied_force(&mut g, robot, &symbols);
    let by = |g: &mut Graph, inertial: &[Id]| -> Vec<Id> {
        inertial
            .iter()
            .zip(&force)
            .map(|(&inertial, &force)| g.sub(inertial, force))
            .collect()
    };
    let inertial = derivations.newton_euler.as_ref();
    let inertial = inertial.unwrap_or(&derivations.lagrange);
    let residuals = [by(&mut g, inertial), by(&mut g, &derivations.lagrange)];
    let costs = [0, 1].map(|k| Cost::of(&g, &residuals[k]));
    let cheaper = usize::from(costs[1].total() < costs[0].total());
    let residual = &residuals[cheaper];

    let vars: Vec<Id> = symbols
        .p
        .iter()
        .chain(&symbols.u)
        .chain(&symbols.blanks)
        .copied()
        .collect();
    let rows = diff::jacobian(&mut g, residual, &vars);
    let flat: Vec<Id> = rows.into_iter().flatten().collect();
    let zero = pattern::zeros(&g, &flat);
    let enters = |equation: usize, var: usize| !zero[equation * vars.len() + var];
    let (np, nu, nq) = (symbols.p.len(), symbols.u.len(), symbols.q.len());
    let unused = |first: usize, count: usize| -> Vec<usize> {
        (0..count)
            .filter(|var| !(0..nq).any(|equation| enters(equation, first + var)))
            .collect()
    };
    let blank_violations = (0..robot.blanks.len())
        .flat_map(|blank| (0..nq).map(move |coord| (blank, coord)))
        .filter(|&(blank, coord)| enters(coord, np + nu + blank))
        .collect();

    let velocity_in_mass = robot
        .lagrangian
        .is_some()
        .then(|| velocity_in_mass(&mut g, &symbols, inertial))
        .flatten();

    Facts {
        blank_violations,
        velocity_in_mass,
        unused_params: unused(0, np),
        unused_inputs: unused(np, nu),
        singular_mass: singular_mass(&mut g, robot, &symbols, inertial),
        nonsmooth: g
            .reachable(residual)
            .into_iter()
            .any(|id| matches!(g.node(id), Node::Call(Function::Abs | Function::Sign, _))),
        residual: costs[cheaper],
    }
}

/// The first coordinate whose row of ∂(M a + b)/∂a depends on v.
fn velocity_in_mass(g: &mut Graph, symbols: &Symbols, inertial: &[Id]) -> Option<usize> {
    let rows = diff::jacobian(g, inertial, &symbols.a);
    let flat: Vec<Id> = rows.into_iter().flatten().collect();
    let slopes = diff::jacobian(g, &flat, &symbols.v);
    let slopes: Vec<Id> = slopes.into_iter().flatten().collect();
    let nq = symbols.q.len();
    let enters = pattern::zeros(g, &slopes).iter().position(|zero| !zero)?;
    Some(enters / (nq * nq))
}

/// The first coordinate whose pivot of M is not positive at some random q.
fn singular_mass(
    g: &mut Graph,
    robot: &Robot,
    symbols: &Symbols,
    inertial: &[Id],
) -> Option<usize> {
    let rows = diff::jacobian(g, inertial, &symbols.a);
    let flat: Vec<Id> = rows.into_iter().flatten().collect();
    let tape = Tape::new(g, &flat);
    let nq = symbols.q.len();
    let mut m = vec![0.0; nq * nq];
    let mut random = Random::new(0x3a55);
    for _ in 0..POINTS {
        tape.eval(
            &blanks_zero(robot, sample::nominal_point(robot, &mut random)),
            &mut m,
        );
        // M = L D Lᵀ; column by column, in place.
        for k in 0..nq {
            let diagonal = m[k * nq + k];
            let mut pivot = diagonal;
            for j in 0..k {
                pivot -= m[k * nq + j] * m[k * nq + j] * m[j * nq + j];
            }
            // Written so that NaN counts as singular.
            if !(pivot > PIVOT * diagonal.abs() && pivot > 0.0) {
                return Some(k);
            }
            for i in k + 1..nq {
                let mut entry = m[i * nq + k];
                for j in 0..k {
                    entry -= m[i * nq + j] * m[k * nq + j] * m[j * nq + j];
                }
                m[i * nq + k] = entry / pivot;
            }
            m[k * nq + k] = pivot;
        }
    }
    None
}

fn blanks_zero(robot: &Robot, mut values: Vec<f64>) -> Vec<f64> {
    let end = values.len();
    values[end - robot.blanks.len()..].fill(0.0);
    values
}
