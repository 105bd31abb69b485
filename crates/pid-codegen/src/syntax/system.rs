//! Energies given as such: `coordinates x: m, th: rad;`, `lagrangian = …;`, `potential += …;`.

use proc_macro2::Ident;

use super::cursor::{Cursor, Parsed};
use super::expr::{Expr, Range};
use super::joint::{JointDecl, Motion};
use super::unit::UnitExpr;

/// `x: m in -1.0..=1.0, th: rad;` after `coordinates`.
pub(super) fn parse_coordinates(c: &mut Cursor) -> Parsed<Vec<JointDecl>> {
    let mut out = Vec::new();
    loop {
        let (docs, _) = super::items::attributes(c)?;
        let name = c.ident("the name of a coordinate")?;
        c.punct(":", &format!("and the unit of coordinate `{name}`"))?;
        let unit = UnitExpr::parse(c)?;
        let limits = match c.eat_word("in") {
            Some(_) => Some(Range::parse(c)?),
            None => None,
        };
        out.push(JointDecl {
            docs,
            motion: Motion::Coordinate(unit),
            // A coordinate connects nothing; the tree of links does not look at it.
            parent: Ident::new("base", name.span()),
            child: name.clone(),
            name,
            at: None,
            rpy: None,
            limits,
            follows: None,
        });
        if c.eat_punct(";").is_some() {
            return Ok(out);
        }
        if c.eat_punct(",").is_none() {
            return Err(c.expected("`,`, `in lo..=hi` or `;` after the unit of a coordinate"));
        }
        if c.eat_punct(";").is_some() {
            return Ok(out);
        }
    }
}

/// `= expr;` after `lagrangian`.
pub(super) fn parse_lagrangian(c: &mut Cursor) -> Parsed<Expr> {
    c.punct("=", "after `lagrangian`")?;
    let e = Expr::parse(c)?;
    c.semicolon("`lagrangian`")?;
    Ok(e)
}

/// `+= expr;` after `potential`.
pub(super) fn parse_potential(c: &mut Cursor) -> Parsed<Expr> {
    c.punct(
        "+=",
        "after `potential`: the energy is added to that of gravity",
    )?;
    let e = Expr::parse(c)?;
    c.semicolon("`potential`")?;
    Ok(e)
}
