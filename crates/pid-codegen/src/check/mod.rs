//! From the tree with places to the resolved robot: one stage per file.
//!
//! Stages run in order (names, units and values, tree, physics). A stage reports everything it
//! finds. The first stage with an error is the last to run, since later ones would only echo it.

mod bodies;
mod builder;
pub mod collect;
mod drives;
mod identifiability;
mod joints;
mod linearity;
mod links;
mod meaning;
pub mod motion;
mod moves;
pub mod names;
mod numbers;
pub(crate) mod overrides;
pub mod physics;
mod resolve;
pub mod tree;
pub mod units;
pub mod uses;
pub mod values;
pub mod variants;

use proc_macro2::{Ident, Span};

use crate::diag::Diagnostics;
use crate::syntax::{Ast, Vector};
use pid_derive::Identifiability;
use pid_derive::model::{Emit, Robot};

/// The resolved robot with the places its parts came from, for the messages of the last stage and
/// for emission.
#[derive(Debug, Clone)]
pub struct Resolved {
    /// The robot.
    pub robot: Robot,
    /// Where its parts were declared.
    pub places: Places,
    /// Which combinations of its parameters the motion determines; computed by the last stage.
    pub identifiability: Identifiability,
}

/// Identifiers and places in the user's text, by index of the robot's lists.
#[derive(Debug, Clone)]
pub struct Places {
    /// Fields of the parameter struct. The first joint of a `per joint` declaration carries the
    /// user's place, the others none.
    pub params: Vec<Ident>,
    /// Where each parameter was declared.
    pub param_decls: Vec<Span>,
    /// Fields of the input struct.
    pub inputs: Vec<Ident>,
    /// Where each input was declared.
    pub input_decls: Vec<Span>,
    /// Links.
    pub links: Vec<Ident>,
    /// All joints, fixed ones included.
    pub joints: Vec<Ident>,
    /// Entries written `_`.
    pub blanks: Vec<Span>,
}

/// Runs all stages; `None` after an error.
pub fn resolve(ast: &Ast, diag: &mut Diagnostics) -> Option<Resolved> {
    let symbols = collect::collect(ast, diag);
    uses::check(ast, &symbols, diag);
    variants::check(ast, &symbols, diag);
    if !diag.is_ok() {
        return None;
    }
    let resolved = resolve::robot(ast, &symbols, diag)
        .and_then(|resolved| tree::check(ast, resolved, diag))
        .inspect(|resolved| physics::check(ast, resolved, diag))
        .inspect(|resolved| linearity::check(ast, resolved, diag))
        .map(|resolved| identifiability::check(ast, resolved, diag));
    if resolved.is_none() && diag.is_ok() {
        diag.error(
            &ast.name,
            format!(
                "robot `{}` was refused without a reason; this is a defect of robot!, please report it with the declaration",
                ast.name
            ),
        );
    }
    resolved.filter(|_| diag.is_ok())
}

/// The rank of a robot from a file, compared with what `ast` expects. `None` after an error.
pub(crate) fn rank(ast: &Ast, robot: &Robot, diag: &mut Diagnostics) -> Option<Identifiability> {
    match pid_derive::identifiability(robot) {
        Ok(found) => {
            identifiability::expected(ast, robot, &found, diag);
            Some(found)
        }
        Err(error) => {
            diag.error(&ast.name, error);
            None
        }
    }
}

/// Gravity in numbers.
pub(crate) fn constant_gravity(given: &Vector, diag: &mut Diagnostics) -> Option<[f64; 3]> {
    let symbols = names::Symbols::default();
    let before = diag.count();
    uses::constant_vector(given, &symbols, diag);
    if diag.count() > before {
        return None;
    }
    let units = units::Units::new(&symbols, Vec::new(), Vec::new());
    resolve::constant_gravity(given, &symbols, &units, diag)
}

/// The parts that the user asks for; both derivatives if `emit` is absent.
pub(crate) fn emit(ast: &Ast) -> Emit {
    match &ast.emit {
        None => Emit {
            first_derivatives: true,
            second_derivatives: true,
            ..Emit::default()
        },
        Some(e) => Emit {
            first_derivatives: e.first.is_some() || e.second.is_some(),
            second_derivatives: e.second.is_some(),
            regressor: e.regressor.is_some() || e.base.is_some(),
            base_parameters: e.base.is_some(),
            lanes: e.lanes.is_some(),
        },
    }
}
