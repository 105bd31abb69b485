//! What to generate: `emit { dynamics, first_derivatives, second_derivatives, regressor, base_parameters,
//! lanes }`.

use proc_macro2::{Delimiter, Ident, Span};

use super::cursor::{Cursor, Parsed};
use super::items::unknown_item;
use crate::emit::size::Part;

/// The `emit` item.
#[derive(Debug, Clone, Default)]
pub struct EmitDecl {
    /// Place of `dynamics`.
    pub dynamics: Option<Span>,
    /// Place of `first_derivatives`.
    pub first: Option<Span>,
    /// Place of `second_derivatives`.
    pub second: Option<Span>,
    /// Place of `regressor`.
    pub regressor: Option<Span>,
    /// Place of `base_parameters`.
    pub base: Option<Span>,
    /// Place of `lanes`.
    pub lanes: Option<Span>,
}

impl EmitDecl {
    /// Place at which a part is asked for, by its own word or by one that brings it along.
    pub fn place(&self, part: Part) -> Option<Span> {
        match part {
            Part::Dynamics => self.dynamics,
            Part::FirstDerivatives => self.first.or(self.second),
            Part::SecondDerivatives => self.second,
        }
    }
}

/// `{ … }` after `emit`.
pub(super) fn parse(c: &mut Cursor) -> Parsed<EmitDecl> {
    const PARTS: &[&str] = &[
        "dynamics",
        "first_derivatives",
        "second_derivatives",
        "regressor",
        "base_parameters",
        "lanes",
    ];
    let group = c.group(Delimiter::Brace, "`{` after `emit`")?;
    let mut emit = EmitDecl::default();
    let parts: Vec<Ident> = Cursor::list(&group, |c| c.ident("what to emit"))?;
    for part in parts {
        match part.to_string().as_str() {
            "dynamics" => emit.dynamics = Some(part.span()),
            "first_derivatives" => emit.first = Some(part.span()),
            "second_derivatives" => emit.second = Some(part.span()),
            "regressor" => emit.regressor = Some(part.span()),
            "base_parameters" => emit.base = Some(part.span()),
            "lanes" => emit.lanes = Some(part.span()),
            _ => return Err(unknown_item(&part, PARTS)),
        }
    }
    Ok(emit)
}
