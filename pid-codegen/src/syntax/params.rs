//! Parameters and inputs: `m1: kg = 6.0 in 0.5..=30.0;`, `input current: A;`.

use proc_macro2::{Delimiter, Ident, Span};

use super::cursor::{Cursor, Parsed};
use super::expr::{Expr, Range};
use super::unit::UnitExpr;
use crate::diag::{Diagnostics, Loc};

/// A declared parameter.
#[derive(Debug, Clone)]
pub struct ParamDecl {
    /// `///` lines.
    pub docs: Vec<String>,
    /// Its name.
    pub name: Ident,
    /// Its unit.
    pub unit: UnitExpr,
    /// Its nominal value or values.
    pub nominal: Option<Nominal>,
    /// Its range.
    pub range: Option<Range>,
    /// The word `fixed`.
    pub fixed: Option<Span>,
}

/// A nominal value.
#[derive(Debug, Clone)]
pub enum Nominal {
    /// One value.
    One(Expr),
    /// A value per joint.
    List(Vec<Expr>, Loc),
}

/// A declared input.
#[derive(Debug, Clone)]
pub struct InputDecl {
    /// `///` lines.
    pub docs: Vec<String>,
    /// Its name.
    pub name: Ident,
    /// Its unit.
    pub unit: UnitExpr,
}

/// `params { … }` after its keyword.
pub(super) fn parse_block(c: &mut Cursor, diag: &mut Diagnostics) -> Parsed<Vec<ParamDecl>> {
    let group = c.group(Delimiter::Brace, "`{` after `params`")?;
    let mut out = Vec::new();
    super::items(&mut Cursor::inside(&group), diag, |c, docs, _| {
        out.push(ParamDecl::parse(c, docs)?);
        Ok(())
    });
    Ok(out)
}

impl ParamDecl {
    /// `name: unit = value in range fixed;`
    pub(super) fn parse(c: &mut Cursor, docs: Vec<String>) -> Parsed<ParamDecl> {
        let name = c.ident("the name of a parameter")?;
        c.punct(":", &format!("and the unit of `{name}`"))?;
        let unit = UnitExpr::parse(c)?;
        let nominal = match c.eat_punct("=") {
            None => None,
            Some(start) if c.peek_group(Delimiter::Bracket) => {
                let group = c.group(Delimiter::Bracket, "values")?;
                let values = Cursor::list(&group, Expr::parse)?;
                let _ = start;
                Some(Nominal::List(
                    values,
                    Loc {
                        start: group.span_open(),
                        end: group.span_close(),
                    },
                ))
            }
            Some(_) => Some(Nominal::One(Expr::parse(c)?)),
        };
        let range = match c.eat_word("in") {
            Some(_) => Some(Range::parse(c)?),
            None => None,
        };
        let fixed = c.eat_word("fixed");
        if !c.peek_punct(";") {
            let next = match (&nominal, &range, &fixed) {
                (_, _, Some(_)) => "`;`",
                (_, Some(_), _) => "`fixed` or `;`",
                (Some(_), ..) => "`in`, `fixed` or `;`",
                _ => "`=`, `in`, `fixed` or `;`",
            };
            return Err(c.expected(format!("{next} after parameter `{name}`")));
        }
        c.semicolon("a parameter")?;
        Ok(ParamDecl {
            docs,
            name,
            unit,
            nominal,
            range,
            fixed,
        })
    }
}

impl InputDecl {
    /// `name: unit;` after `input`.
    pub(super) fn parse(c: &mut Cursor, docs: Vec<String>) -> Parsed<InputDecl> {
        let name = c.ident("the name of an input")?;
        c.punct(":", &format!("and the unit of input `{name}`"))?;
        let unit = UnitExpr::parse(c)?;
        c.semicolon(&format!("input `{name}`"))?;
        Ok(InputDecl { docs, name, unit })
    }
}
