//! Positions of points of a declared robot.

use pid_derive::kinematics::Tree;
use pid_derive::model::Robot;
use pid_derive::vector::{Vector, add, apply, constant};
use pid_derive::{Blanks, Symbols};
use pid_runtime::dynamics::{At, Dims, Dynamics};
use pid_runtime::kinematics::ForwardKinematics;
use pid_symbolic::{Graph, Id, diff};
use thiserror::Error;

use crate::function::Function;
use crate::nominal::{DeclaredError, declaration};

/// A point fixed to a link.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// Name of the link.
    pub link: String,
    /// Where in the link's frame, m.
    pub at: [f64; 3],
}

/// Why points have no positions.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum KinematicsError {
    /// The model carries no declaration.
    #[error(transparent)]
    Declared(#[from] DeclaredError),
    /// No such link.
    #[error("`{robot}` has no link `{link}`; {found}")]
    NoLink {
        /// Name of the robot.
        robot: String,
        /// The link asked for.
        link: String,
        /// The links that it has.
        found: String,
    },
    /// A place that is no number.
    #[error("the point on link `{link}` is at {at:?}\n  help: give three finite numbers in metres")]
    Place {
        /// The link.
        link: String,
        /// The place.
        at: [f64; 3],
    },
}

/// Positions of chosen points as programs on the expression graph.
#[derive(Debug, Clone)]
pub struct Kinematics {
    names: Vec<String>,
    positions: Function,
    /// Positions, then ∂x/∂q.
    jacobian: Function,
    /// Entries of the lower triangle of ∂²(λᵀx)/∂q² that are not zero, and their values.
    places: Vec<(usize, usize)>,
    hessian: Function,
}

impl Kinematics {
    /// Of a model that carries its declaration. Points are named after their links; several on one
    /// link are numbered.
    ///
    /// # Errors
    /// If the model is no declared robot, a link does not exist, or a place is not finite.
    pub fn of_declared(model: &dyn Dynamics, points: &[Point]) -> Result<Self, KinematicsError> {
        Self::new(&declaration(model)?, points)
    }

    /// Of a robot.
    ///
    /// # Errors
    /// If a link does not exist or a place is not finite.
    pub fn new(robot: &Robot, points: &[Point]) -> Result<Self, KinematicsError> {
        let dims = Dims {
            nq: robot.nq(),
            nu: robot.inputs.len(),
            np: robot.params.len(),
        };
        let mut g = Graph::new();
        let symbols = Symbols::new(&mut g, robot, Blanks::Zero);
        let tree = Tree::new(&mut g, robot, &symbols);
        let mut x: Vec<Id> = Vec::with_capacity(3 * points.len());
        for point in points {
            x.extend(position(&mut g, robot, &tree, point)?);
        }
        let slopes = diff::jacobian(&mut g, &x, &symbols.q).concat();
        let multipliers: Vec<Id> = (0..x.len()).map(|k| g.var(dims.nz() + k)).collect();
        let terms: Vec<Id> = x
            .iter()
            .zip(&multipliers)
            .map(|(x, l)| g.mul(*x, *l))
            .collect();
        let weighted = g.sum(terms);
        let entries = diff::hessian(&mut g, weighted, &symbols.q);
        let values: Vec<Id> = entries.iter().map(|entry| entry.value).collect();
        let function = |outputs: &[Id]| Function::with_multipliers(&g, dims, x.len(), outputs);
        Ok(Self {
            names: names(points),
            positions: function(&x),
            jacobian: function(&[x.clone(), slopes].concat()),
            places: entries.iter().map(|entry| (entry.row, entry.col)).collect(),
            hessian: function(&values),
        })
    }
}

fn position(
    g: &mut Graph,
    robot: &Robot,
    tree: &Tree,
    point: &Point,
) -> Result<Vector, KinematicsError> {
    let link = robot.links.iter().position(|link| link.name == point.link);
    let Some(frame) = link.and_then(|link| tree.link_frame(g, link)) else {
        let links: Vec<String> = robot
            .links
            .iter()
            .map(|l| format!("`{}`", l.name))
            .collect();
        return Err(KinematicsError::NoLink {
            robot: robot.name.clone(),
            link: point.link.clone(),
            found: match links.is_empty() {
                true => "it is declared by its Lagrangian, without links".to_owned(),
                false => format!("it has {}", links.join(", ")),
            },
        });
    };
    if !point.at.iter().all(|x| x.is_finite()) {
        return Err(KinematicsError::Place {
            link: point.link.clone(),
            at: point.at,
        });
    }
    let at = constant(g, point.at);
    let turned = apply(g, &frame.rotation, at);
    Ok(add(g, frame.origin, turned))
}

/// `forearm`, or `forearm_2` for the second point on it.
fn names(points: &[Point]) -> Vec<String> {
    let name = |(i, point): (usize, &Point)| {
        let before = points[..i].iter().filter(|p| p.link == point.link).count();
        match before {
            0 => point.link.clone(),
            _ => format!("{}_{}", point.link, before + 1),
        }
    };
    points.iter().enumerate().map(name).collect()
}

fn at<'a>(q: &'a [f64], p: &'a [f64]) -> At<'a> {
    At {
        q,
        v: &[],
        a: &[],
        u: &[],
        p,
    }
}

impl ForwardKinematics for Kinematics {
    fn points(&self) -> &[String] {
        &self.names
    }

    fn positions(&self, q: &[f64], p: &[f64], x: &mut [f64]) {
        self.positions.eval(&at(q, p), &[], [x]);
    }

    fn jacobian(&self, q: &[f64], p: &[f64], x: &mut [f64], slope: &mut [f64]) {
        self.jacobian.eval(&at(q, p), &[], [x, slope]);
    }

    fn hessian_places(&self) -> &[(usize, usize)] {
        &self.places
    }

    fn hessian(&self, q: &[f64], p: &[f64], lambda: &[f64], values: &mut [f64]) {
        self.hessian.eval(&at(q, p), lambda, [values]);
    }
}
