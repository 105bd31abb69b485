//! Units as written: `kg*m^2`, `N*m*s/rad`, `1/s`, `m/(s*A)`.

use proc_macro2::{Delimiter, Ident, Span, TokenTree};

use super::cursor::{Cursor, Parsed, integer};
use crate::diag::Loc;
use crate::si;

/// A product of powers of named units.
#[derive(Debug, Clone)]
pub struct UnitExpr {
    /// Names with exponents, in order.
    pub factors: Vec<(Ident, i32)>,
    /// The whole unit.
    pub loc: Loc,
}

/// How far a unit reaches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Reach {
    /// The unit is all that may follow: after `:` or a list.
    Greedy,
    /// After a number in an expression: a `*` or `/` belongs to the unit only if a known unit follows it.
    Known,
}

impl UnitExpr {
    /// A unit where nothing else can stand.
    pub(super) fn parse(c: &mut Cursor) -> Parsed<UnitExpr> {
        parse(c, Reach::Greedy)
    }

    /// The unit of a number inside an expression.
    pub(super) fn after_number(c: &mut Cursor) -> Parsed<UnitExpr> {
        parse(c, Reach::Known)
    }

    /// The unit in a text, if it is one.
    pub fn of_text(text: &str) -> Option<UnitExpr> {
        let tokens = text.parse().ok()?;
        let mut c = Cursor::new(tokens, Span::call_site());
        UnitExpr::parse(&mut c).ok().filter(|_| c.is_done())
    }

    /// A unit, if one follows.
    pub(super) fn optional(c: &mut Cursor) -> Parsed<Option<UnitExpr>> {
        match starts_unit(c) {
            true => UnitExpr::parse(c).map(Some),
            false => Ok(None),
        }
    }
}

/// Whether a unit may start here: an identifier that is no keyword of the places where numbers stand.
pub(super) fn starts_unit(c: &Cursor) -> bool {
    // `name:` is the next item, behind a `;` that was forgotten.
    let item = matches!(c.peek_second(), Some(TokenTree::Punct(p)) if p.as_char() == ':');
    c.peek_ident()
        .is_some_and(|i| !item && !["in", "fixed", "rpy", "at", "about"].iter().any(|k| i == k))
}

fn parse(c: &mut Cursor, reach: Reach) -> Parsed<UnitExpr> {
    let start = c.here();
    let mut factors = Vec::new();
    // `1/s`, or `1` for a number.
    let one = matches!(c.peek(), Some(TokenTree::Literal(l)) if l.to_string() == "1");
    if one {
        c.bump();
    } else {
        factor(c, 1, &mut factors)?;
    }
    loop {
        let sign = match (c.peek_punct("*"), c.peek_punct("/")) {
            (true, _) => 1,
            (_, true) => -1,
            _ => break,
        };
        if reach == Reach::Known && !c.unit_follows_operator() {
            break;
        }
        c.bump();
        factor(c, sign, &mut factors)?;
    }
    Ok(UnitExpr {
        factors,
        loc: c.since(start),
    })
}

fn factor(c: &mut Cursor, sign: i32, out: &mut Vec<(Ident, i32)>) -> Parsed<()> {
    if c.peek_group(Delimiter::Parenthesis) {
        let group = c.group(Delimiter::Parenthesis, "a unit")?;
        let mut inner = Cursor::inside(&group);
        let unit = parse(&mut inner, Reach::Greedy)?;
        if !inner.is_done() {
            return Err(inner.expected("`*`, `/` or `)` in a unit"));
        }
        let n = sign * exponent(c)?;
        out.extend(
            unit.factors
                .into_iter()
                .map(|(i, k)| (i, k.saturating_mul(n))),
        );
        return Ok(());
    }
    let name = c.ident("a unit such as `kg`, `m/s` or `N*m`")?;
    let n = sign * exponent(c)?;
    out.push((name, n));
    Ok(())
}

fn exponent(c: &mut Cursor) -> Parsed<i32> {
    match c.eat_punct("^") {
        Some(_) => integer(c),
        None => Ok(1),
    }
}

impl Cursor {
    /// After a number with a unit: whether `*` or `/` belongs to the unit.
    fn unit_follows_operator(&self) -> bool {
        matches!(self.peek_second(), Some(TokenTree::Ident(i)) if si::is_unit(&i.to_string()))
    }
}
