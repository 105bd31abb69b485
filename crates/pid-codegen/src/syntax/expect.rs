//! Expectations of the user: `expect rank 14;`, `expect rank 13 at nominal;`.

use proc_macro2::{Span, TokenTree};

use super::cursor::{Cursor, Parsed};
use super::items::unknown_item;

/// An `expect` item.
#[derive(Debug, Clone)]
pub struct ExpectDecl {
    /// The rank expected: combinations of parameters that the motion determines.
    pub rank: usize,
    /// At the nominal values instead of almost everywhere.
    pub nominal: bool,
    /// Place of the number.
    pub number: Span,
}

/// `rank n;` after `expect`.
pub(super) fn parse(c: &mut Cursor) -> Parsed<ExpectDecl> {
    let what = c.ident("`rank` after `expect`")?;
    if what != "rank" {
        return Err(unknown_item(&what, &["rank"]));
    }
    let number = c.here();
    let rank = match c.peek() {
        Some(TokenTree::Literal(literal)) => literal.to_string().parse().ok(),
        _ => None,
    };
    let Some(rank) = rank else {
        return Err(c.expected("a whole number after `expect rank`, such as `expect rank 14;`"));
    };
    c.bump();
    let nominal = c.eat_word("at").is_some();
    if nominal {
        let point = c.ident("`nominal` after `at`")?;
        if point != "nominal" {
            return Err(unknown_item(&point, &["nominal"]));
        }
    }
    c.semicolon("`expect`")?;
    Ok(ExpectDecl {
        rank,
        nominal,
        number,
    })
}
