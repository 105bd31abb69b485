//! From the resolved robot to expressions: kinematics, equations of motion, exact derivatives, and
//! proofs about them.
//!
//! Everything is built on one hash-consed [`Graph`](pid_symbolic::Graph). There are no tokens and
//! no text here: `pid-codegen` writes down the results.
//!
//! - [`model`]: the resolved robot, the input of everything here;
//! - [`symbols`]: the variables `z = (q, v, a, u, p)` and the translation of [`Expr`](crate::model::Expr);
//! - [`vector`]: 3-vectors, rotations, frames; [`inertia`]: rigid-body inertia in the linear parameters;
//! - [`kinematics`]: the tree of moving bodies, fixed joints merged;
//! - [`lagrangian`], [`newton_euler`]: two independent derivations of `M a + b`;
//! - [`links`](mod@links): M and b with the constants of the bodies as variables; [`composite`]: M
//!   by composite bodies; [`regroup`]: inertial parameters moved towards the base;
//! - [`equations`](mod@equations): their comparison, and all that is read off the residual;
//! - [`derivatives`](mod@derivatives): Jacobian and Hessian with their patterns;
//! - [`facts`](mod@facts): proofs for the checker;
//! - [`mechanism`]: a tree of driven bodies in numbers, as readers of robot files make it;
//! - [`plausible`]: which masses and inertias a body can have;
//! - [`identifiability`](mod@identifiability): which combinations of parameters a motion
//!   determines; [`dense`]: ranks;
//! - [`regressor`](mod@regressor), [`base_parameters`](mod@base_parameters): the equations as a
//!   linear function of parameters;
//! - [`readable`]: the equations as text and LaTeX.

pub mod base_parameters;
pub mod composite;
pub mod dense;
pub mod derivatives;
pub mod equations;
pub mod facts;
pub mod identifiability;
pub mod inertia;
pub mod kinematics;
pub mod lagrangian;
pub mod links;
pub mod mechanism;
pub mod model;
pub mod newton_euler;
pub mod plausible;
pub mod readable;
pub mod regressor;
pub mod regroup;
pub mod sample;
pub mod symbols;
pub mod vector;

pub use base_parameters::{BaseParameters, base_parameters};
pub use derivatives::{Derivatives, derivatives};
pub use equations::{Equations, equations};
pub use facts::{Facts, facts};
pub use identifiability::{Identifiability, identifiability};
pub use links::{Links, links};
pub use regressor::{Regressor, regressor};
pub use symbols::{Blanks, Symbols};

use thiserror::Error;

/// Why no equations of motion could be derived.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// The two derivations differ: a defect of this crate, never of the robot.
    #[error(
        "the Lagrange and Newton-Euler forms of the equations of `{robot}` differ in the equation of joint `{joint}`: \
         {lagrange:e} and {newton_euler:e} at the same point; this is a defect of robot!, please report it with the declaration"
    )]
    DerivationsDisagree {
        /// Name of the robot.
        robot: String,
        /// Name of the joint.
        joint: String,
        /// Value by Euler-Lagrange.
        lagrange: f64,
        /// Value by Newton-Euler.
        newton_euler: f64,
    },
    /// A regressor was asked for, but the torques are not linear in the parameters of links,
    /// geometry and rotors.
    #[error(
        "the torques of `{robot}` are not linear in `{first}` and `{second}`, which its regressor needs; \
         give the links mass, first moment and inertia about their origin as parameters"
    )]
    NotLinear {
        /// Name of the robot.
        robot: String,
        /// A parameter.
        first: String,
        /// A parameter whose product with the first enters, or the same.
        second: String,
    },
    /// The equations are not finite at any of the points tried.
    #[error(
        "the equations of `{robot}` are not finite at any of {points} random points within the parameter ranges; \
         look for divisions by zero, or `ln` and `sqrt` of values that may be negative, in masses, geometry and force laws"
    )]
    NowhereFinite {
        /// Name of the robot.
        robot: String,
        /// Number of points tried.
        points: usize,
    },
}
