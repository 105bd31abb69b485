//! Parameters and inputs: `m1: kg = 6.0 in 0.5..=30.0;`, `input current: A;`.

use proc_macro2::{Delimiter, Group, Ident, Span};

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
    /// Its range or ranges.
    pub range: Option<Ranges>,
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

/// A range.
#[derive(Debug, Clone)]
pub enum Ranges {
    /// One range.
    One(Range),
    /// A range per joint.
    List(Vec<Range>, Loc),
}

impl Ranges {
    /// All of them.
    pub fn iter(&self) -> std::slice::Iter<'_, Range> {
        match self {
            Ranges::One(r) => std::slice::from_ref(r).iter(),
            Ranges::List(all, _) => all.iter(),
        }
    }
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
    super::items::items(&mut Cursor::inside(&group), diag, |c, docs, _| {
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
            Some(_) if c.peek_group(Delimiter::Bracket) => {
                let group = c.group(Delimiter::Bracket, "values")?;
                let values = Cursor::list(&group, Expr::parse)?;
                Some(Nominal::List(values, whole(&group)))
            }
            Some(_) => Some(Nominal::One(Expr::parse(c)?)),
        };
        let range = match c.eat_word("in") {
            Some(_) if c.peek_group(Delimiter::Bracket) => {
                let group = c.group(Delimiter::Bracket, "ranges")?;
                let ranges = Cursor::list(&group, Range::parse)?;
                Some(Ranges::List(ranges, whole(&group)))
            }
            Some(_) => Some(Ranges::One(Range::parse(c)?)),
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

fn whole(group: &Group) -> Loc {
    Loc {
        start: group.span_open(),
        end: group.span_close(),
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
