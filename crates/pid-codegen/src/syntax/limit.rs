//! The limit on operations: `limit ops 500_000;`.

use proc_macro2::TokenTree;

use super::cursor::{Cursor, Parsed};
use super::items::unknown_item;

/// `ops n;` after `limit`: operations that a part of `emit` may take.
pub(super) fn parse(c: &mut Cursor) -> Parsed<usize> {
    let what = c.ident("`ops` after `limit`")?;
    if what != "ops" {
        return Err(unknown_item(&what, &["ops"]));
    }
    let operations = match c.peek() {
        Some(TokenTree::Literal(literal)) => match syn::Lit::new(literal.clone()) {
            syn::Lit::Int(n) if n.suffix().is_empty() => n.base10_parse().ok(),
            _ => None,
        },
        _ => None,
    };
    let Some(operations) = operations else {
        return Err(c.expected("a whole number after `limit ops`, such as `limit ops 500_000;`"));
    };
    c.bump();
    c.semicolon("`limit ops`")?;
    Ok(operations)
}
