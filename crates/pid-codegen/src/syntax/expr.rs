//! Expressions: numbers with units, names, `q.joint`, `+ - * / ^`, calls; and entries, vectors and
//! ranges of them.

use std::fmt;

use proc_macro2::{Delimiter, Ident, Span, TokenTree};

use super::cursor::{Cursor, Parsed, integer};
use super::unit::{self, UnitExpr};
use crate::diag::Loc;

/// An expression as written.
#[derive(Debug, Clone)]
pub struct Expr {
    /// Its kind.
    pub kind: ExprKind,
    /// Where it is.
    pub loc: Loc,
}

/// Kinds of expressions.
#[derive(Debug, Clone)]
pub enum ExprKind {
    /// A number, with a unit if one follows it.
    Number(f64, Option<UnitExpr>),
    /// A parameter, input, coordinate or `pi`.
    Name(Ident),
    /// `q.elbow`, `v.elbow`.
    Member(Ident, Ident),
    /// `-x`.
    Neg(Box<Expr>),
    /// `x + y` and the like; the span is the operator's.
    Binary(Op, Span, Box<Expr>, Box<Expr>),
    /// `x^2`.
    Pow(Box<Expr>, i32),
    /// `tanh(x)`.
    Call(Ident, Vec<Expr>),
}

/// Operators of two operands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Op {
    /// `+`
    Add,
    /// `-`
    Sub,
    /// `*`
    Mul,
    /// `/`
    Div,
}

/// An entry of a mass, vector or tensor.
#[derive(Debug, Clone)]
pub enum Entry {
    /// `_`: does not enter the equations.
    Blank(Span),
    /// A value.
    Value(Expr),
}

impl Entry {
    /// Where it is.
    pub fn loc(&self) -> Loc {
        match self {
            Entry::Blank(s) => (*s).into(),
            Entry::Value(e) => e.loc,
        }
    }
}

/// `[x, y, z] m`.
#[derive(Debug, Clone)]
pub struct Vector {
    /// Its entries; the grammar makes sure there are three.
    pub entries: [Entry; 3],
    /// The unit of the bare numbers in it.
    pub unit: Option<UnitExpr>,
    /// The whole.
    pub loc: Loc,
}

/// `lo..=hi unit`; an end left out is open.
#[derive(Debug, Clone)]
pub struct Range {
    /// Lower end.
    pub lo: Option<Expr>,
    /// Upper end.
    pub hi: Option<Expr>,
    /// The unit of both ends.
    pub unit: Option<UnitExpr>,
    /// The whole.
    pub loc: Loc,
}

/// Deepest nesting of an expression; deeper input is refused instead of exhausting the stack.
const DEPTH: usize = 64;

/// Most terms of a sum and factors of a product; they nest in the resolved expression.
const LENGTH: usize = 512;

fn too_long(at: Span, what: &str) -> syn::Error {
    Loc::from(at).error(format!(
        "{what} of more than {LENGTH} operands\nhelp: split it into several `force` laws, which are added up"
    ))
}

impl Expr {
    /// An expression in which numbers may carry units.
    pub(super) fn parse(c: &mut Cursor) -> Parsed<Expr> {
        sum(c, true, 0)
    }

    /// An expression of bare numbers, as the ends of a range.
    pub(super) fn parse_bare(c: &mut Cursor) -> Parsed<Expr> {
        sum(c, false, 0)
    }
}

fn sum(c: &mut Cursor, units: bool, depth: usize) -> Parsed<Expr> {
    let start = c.here();
    let mut left = product(c, units, depth)?;
    for _ in 0..LENGTH {
        // `->` is never an operator of an expression.
        let op = match c.peek() {
            Some(TokenTree::Punct(p)) if p.as_char() == '+' => Op::Add,
            Some(TokenTree::Punct(p)) if p.as_char() == '-' => Op::Sub,
            _ => return Ok(left),
        };
        let at = c.here();
        c.bump();
        let right = product(c, units, depth)?;
        left = binary(op, at, left, right, c.since(start));
    }
    Err(too_long(start, "a sum"))
}

fn product(c: &mut Cursor, units: bool, depth: usize) -> Parsed<Expr> {
    let start = c.here();
    // A leading sign belongs to the whole product, so that messages show the term without it.
    if depth <= DEPTH && c.eat_punct("-").is_some() {
        let x = product(c, units, depth + 1)?;
        return Ok(Expr {
            kind: ExprKind::Neg(Box::new(x)),
            loc: c.since(start),
        });
    }
    let mut left = signed(c, units, depth)?;
    for _ in 0..LENGTH {
        let op = match c.peek() {
            Some(TokenTree::Punct(p)) if p.as_char() == '*' => Op::Mul,
            Some(TokenTree::Punct(p)) if p.as_char() == '/' => Op::Div,
            _ => return Ok(left),
        };
        let at = c.here();
        c.bump();
        let right = signed(c, units, depth)?;
        left = binary(op, at, left, right, c.since(start));
    }
    Err(too_long(start, "a product"))
}

fn binary(op: Op, at: Span, left: Expr, right: Expr, loc: Loc) -> Expr {
    Expr {
        kind: ExprKind::Binary(op, at, Box::new(left), Box::new(right)),
        loc,
    }
}

fn signed(c: &mut Cursor, units: bool, depth: usize) -> Parsed<Expr> {
    let start = c.here();
    if depth > DEPTH {
        return Err(Loc::from(start).error(format!(
            "expression is nested more than {DEPTH} deep\nhelp: split it into several `force` laws, which are added up"
        )));
    }
    if c.eat_punct("-").is_some() {
        let x = signed(c, units, depth + 1)?;
        return Ok(Expr {
            kind: ExprKind::Neg(Box::new(x)),
            loc: c.since(start),
        });
    }
    if c.eat_punct("+").is_some() {
        return signed(c, units, depth + 1);
    }
    let base = primary(c, units, depth)?;
    if c.eat_punct("^").is_none() {
        return Ok(base);
    }
    let n = integer(c)?;
    Ok(Expr {
        kind: ExprKind::Pow(Box::new(base), n),
        loc: c.since(start),
    })
}

fn primary(c: &mut Cursor, units: bool, depth: usize) -> Parsed<Expr> {
    let start = c.here();
    match c.peek() {
        Some(TokenTree::Literal(_)) => {
            let value = number(c)?;
            let unit = match units && unit::starts_unit(c) {
                true => Some(UnitExpr::after_number(c)?),
                false => None,
            };
            Ok(Expr {
                kind: ExprKind::Number(value, unit),
                loc: c.since(start),
            })
        }
        Some(TokenTree::Ident(i)) if i != "_" => {
            let name = c.ident("a name")?;
            let kind = if c.peek_group(Delimiter::Parenthesis) {
                let group = c.group(Delimiter::Parenthesis, "arguments")?;
                ExprKind::Call(name, Cursor::list(&group, |c| sum(c, units, depth + 1))?)
            } else if !c.peek_punct("..") && c.eat_punct(".").is_some() {
                ExprKind::Member(name, c.ident("the name of a joint after `.`")?)
            } else {
                ExprKind::Name(name)
            };
            Ok(Expr {
                kind,
                loc: c.since(start),
            })
        }
        Some(TokenTree::Ident(_)) => Err(Loc::from(start)
            .error("`_` can only stand for a whole entry of a mass, a vector or a tensor")),
        Some(TokenTree::Group(g)) if g.delimiter() == Delimiter::Parenthesis => {
            let mut inner = Cursor::inside(g);
            c.bump();
            let mut e = sum(&mut inner, units, depth + 1)?;
            if !inner.is_done() {
                return Err(inner.expected("an operator or `)`"));
            }
            e.loc = c.since(start);
            Ok(e)
        }
        _ => Err(c.expected("a number, a name or `(`")),
    }
}

/// A number literal.
fn number(c: &mut Cursor) -> Parsed<f64> {
    let at = c.here();
    let Some(TokenTree::Literal(l)) = c.peek().cloned() else {
        return Err(c.expected("a number"));
    };
    let (value, digits, suffix) = match syn::Lit::new(l.clone()) {
        syn::Lit::Int(i) => (
            i.base10_parse::<f64>().ok(),
            i.base10_digits().to_string(),
            i.suffix().to_string(),
        ),
        syn::Lit::Float(f) => (
            f.base10_parse::<f64>().ok(),
            f.base10_digits().to_string(),
            f.suffix().to_string(),
        ),
        _ => return Err(c.expected("a number")),
    };
    if !suffix.is_empty() {
        return Err(Loc::from(at).error(format!(
            "number and unit must be separated by a space\nhelp: write `{digits} {suffix}`"
        )));
    }
    match value {
        Some(v) if v.is_finite() => {
            c.bump();
            Ok(v)
        }
        _ => Err(Loc::from(at).error(format!("`{l}` is not a finite number"))),
    }
}

impl Entry {
    /// `_` or an expression.
    pub(super) fn parse(c: &mut Cursor) -> Parsed<Entry> {
        match c.eat_word("_") {
            Some(span) => Ok(Entry::Blank(span)),
            None => Expr::parse(c).map(Entry::Value),
        }
    }
}

impl Vector {
    /// `[x, y, z]` and the unit of its bare numbers.
    pub(super) fn parse(c: &mut Cursor, what: &str) -> Parsed<Vector> {
        let start = c.here();
        let group = c.group(
            Delimiter::Bracket,
            &format!("{what} as `[x, y, z]` with a unit"),
        )?;
        let entries = Cursor::list(&group, Entry::parse)?;
        let here = c.since(start);
        let entries = <[Entry; 3]>::try_from(entries).map_err(|found| {
            here.error(format!(
                "{what} has {} entries, but needs three: `[x, y, z]`",
                found.len()
            ))
        })?;
        let unit = UnitExpr::optional(c)?;
        Ok(Vector {
            entries,
            unit,
            loc: c.since(start),
        })
    }
}

impl Range {
    /// `lo..=hi`, `lo..`, `..=hi`, and a unit if one follows.
    pub(super) fn parse(c: &mut Cursor) -> Parsed<Range> {
        let start = c.here();
        let lo = match c.peek_punct("..") {
            true => None,
            false => Some(Expr::parse_bare(c)?),
        };
        let dots = c.here();
        let hi = if c.eat_punct("..=").is_some() {
            Some(Expr::parse_bare(c)?)
        } else if c.eat_punct("..").is_some() {
            if matches!(c.peek(), Some(TokenTree::Literal(_))) || c.peek_punct("-") {
                return Err(Loc::from(dots)
                    .error("ranges include their upper end\nhelp: write `..=` instead of `..`"));
            }
            None
        } else {
            return Err(c.expected("`..=` and the upper end of the range"));
        };
        let unit = UnitExpr::optional(c)?;
        Ok(Range {
            lo,
            hi,
            unit,
            loc: c.since(start),
        })
    }
}

impl Op {
    fn sign(self) -> &'static str {
        match self {
            Op::Add => " + ",
            Op::Sub => " - ",
            Op::Mul => "*",
            Op::Div => "/",
        }
    }

    fn is_sum(self) -> bool {
        matches!(self, Op::Add | Op::Sub)
    }
}

/// The expression in the language's own form, for messages.
impl fmt::Display for Expr {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.kind {
            ExprKind::Number(x, None) => write!(f, "{x}"),
            ExprKind::Number(x, Some(u)) => write!(f, "{x} {u}"),
            ExprKind::Name(i) => write!(f, "{i}"),
            ExprKind::Member(a, b) => write!(f, "{a}.{b}"),
            ExprKind::Neg(x) => write!(f, "-{}", Operand(x, true)),
            ExprKind::Binary(op, _, a, b) => {
                let inner = !op.is_sum();
                let right = inner || *op == Op::Sub;
                write!(f, "{}{}{}", Operand(a, inner), op.sign(), Operand(b, right))
            }
            ExprKind::Pow(x, n) => write!(f, "{}^{n}", Operand(x, true)),
            ExprKind::Call(name, args) => {
                let args: Vec<String> = args.iter().map(ToString::to_string).collect();
                write!(f, "{name}({})", args.join(", "))
            }
        }
    }
}

/// An operand, in parentheses if it is a sum and `.1`.
struct Operand<'a>(&'a Expr, bool);

impl fmt::Display for Operand<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0.kind {
            ExprKind::Binary(op, ..) if self.1 && op.is_sum() => write!(f, "({})", self.0),
            _ => write!(f, "{}", self.0),
        }
    }
}

/// The unit as the user wrote it.
impl fmt::Display for UnitExpr {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.factors.first().is_none_or(|t| t.1 < 0) {
            f.write_str("1")?;
        }
        for (k, (name, n)) in self.factors.iter().enumerate() {
            let sign = match (*n < 0, k) {
                (true, _) => "/",
                (false, 0) => "",
                (false, _) => "*",
            };
            write!(f, "{sign}{name}")?;
            if n.abs() != 1 {
                write!(f, "^{}", n.abs())?;
            }
        }
        Ok(())
    }
}
