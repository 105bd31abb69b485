//! What the stages make of a declaration.

use proc_macro2::{Ident, Span};

use crate::syntax::Ast;
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
