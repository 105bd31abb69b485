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
mod resolved;
pub mod tree;
pub mod units;
pub mod uses;
pub mod values;
pub mod variants;

use crate::diag::Diagnostics;
use crate::syntax::{Ast, Vector};
#[cfg(feature = "show")]
pub(crate) use collect::LINEAR;
use pid_derive::Identifiability;
use pid_derive::model::Robot;
pub(crate) use resolved::emit;
pub use resolved::{Places, Resolved};

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
