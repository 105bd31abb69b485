//! Joints: `joint elbow: revolute about y { upper -> fore at [0, 0, 0.3] m; limits: -2..=2 rad; }`.

use proc_macro2::{Delimiter, Ident, Span, TokenTree};

use super::cursor::{Cursor, Parsed};
use super::expr::{Expr, Range, Vector};
use super::items::unknown_item;
use super::unit::UnitExpr;
use crate::diag::{Diagnostics, Loc, nearest};

/// A joint.
#[derive(Debug, Clone)]
pub struct JointDecl {
    /// `///` lines.
    pub docs: Vec<String>,
    /// Its name.
    pub name: Ident,
    /// Its motion.
    pub motion: Motion,
    /// Parent link or `base`.
    pub parent: Ident,
    /// Child link.
    pub child: Ident,
    /// Origin of the joint frame in the parent frame.
    pub at: Option<Vector>,
    /// Roll, pitch, yaw of the joint frame.
    pub rpy: Option<Vector>,
    /// Range of the coordinate.
    pub limits: Option<Range>,
    /// `follows …`: its position as a combination of other joints.
    pub follows: Option<Expr>,
}

/// Motion of a joint.
#[derive(Debug, Clone)]
pub enum Motion {
    /// `revolute about …`
    Revolute(Axis),
    /// `prismatic along …` (or `about`, read the same)
    Prismatic(Axis),
    /// `fixed`
    Fixed,
    /// A coordinate of a bare Lagrangian, in its unit.
    Coordinate(UnitExpr),
}

/// An axis as written.
#[derive(Debug, Clone)]
pub struct Axis {
    /// Its entries.
    pub direction: AxisKind,
    /// Where.
    pub loc: Loc,
}

/// A named or a given axis.
#[derive(Debug, Clone)]
pub enum AxisKind {
    /// `x`, `y`, `z`: 0, 1, 2.
    Named(usize),
    /// `[x, y, z]`, constants.
    Given(Box<Vector>),
}

/// A joint after its keyword.
pub(super) fn parse(
    c: &mut Cursor,
    docs: Vec<String>,
    diag: &mut Diagnostics,
) -> Parsed<JointDecl> {
    let name = c.ident("the name of a joint")?;
    c.punct(":", &format!("and the type of joint `{name}`"))?;
    let motion = motion(c, &name)?;
    let group = c.group(
        Delimiter::Brace,
        &format!("`{{ parent -> child; }}` of joint `{name}`"),
    )?;
    let mut edge = None;
    let mut limits = None;
    let mut follows = None;
    let mut seen = Vec::new();
    let before = diag.count();
    super::items::items(&mut Cursor::inside(&group), diag, |c, _, _| {
        let first = c.ident("`parent -> child`, `limits: …` or `follows …`")?;
        if first == "follows" && !c.peek_punct("->") {
            let again = super::items::once(&mut seen, &first);
            follows = Some(Expr::parse(c)?);
            c.semicolon("what a joint follows")?;
            return again;
        }
        if first == "limits" && c.peek_punct(":") {
            let again = super::items::once(&mut seen, &first);
            c.punct(":", "after `limits`")?;
            limits = Some(Range::parse(c)?);
            c.semicolon("the limits of a joint")?;
            return again;
        }
        if edge.is_some() && c.peek_punct("->") {
            return Err(Loc::from(&first).error(format!(
                "joint `{name}` already connects two links\nhelp: declare another joint for this pair"
            )));
        }
        edge = Some(Edge::parse(c, first)?);
        Ok(())
    });
    let Some(edge) = edge else {
        // An error inside the braces explains it already.
        let e = Loc::from(&name).error(format!(
            "joint `{name}` connects no links\nhelp: write `parent -> child;` in its braces"
        ));
        return Err(if diag.count() > before {
            diag.pop().unwrap_or(e)
        } else {
            e
        });
    };
    Ok(JointDecl {
        docs,
        name,
        motion,
        parent: edge.parent,
        child: edge.child,
        at: edge.at,
        rpy: edge.rpy,
        limits,
        follows,
    })
}

/// The links that a joint connects, and its place on the parent.
struct Edge {
    parent: Ident,
    child: Ident,
    at: Option<Vector>,
    rpy: Option<Vector>,
}

impl Edge {
    /// `parent -> child at [x, y, z] m rpy [r, p, y] rad;`, at the arrow.
    fn parse(c: &mut Cursor, parent: Ident) -> Parsed<Self> {
        if c.eat_punct("->").is_none() {
            return Err(if c.peek_punct(":") {
                unknown_item(&parent, &["limits", "follows"])
            } else {
                c.expected(format!("`->` and the child link after `{parent}`"))
            });
        }
        let child = c.ident("the child link after `->`")?;
        let (mut at, mut rpy) = (None, None);
        loop {
            if at.is_none() && c.eat_word("at").is_some() {
                at = Some(Vector::parse(c, "the origin of the joint")?);
            } else if rpy.is_none() && c.eat_word("rpy").is_some() {
                rpy = Some(Vector::parse(c, "the orientation of the joint")?);
            } else {
                break;
            }
        }
        if !c.peek_punct(";") {
            return Err(c.expected(format!(
                "`at [x, y, z] m`, `rpy [r, p, y] rad` or `;` after `{parent} -> {child}`"
            )));
        }
        c.semicolon("a joint's links")?;
        Ok(Self {
            parent,
            child,
            at,
            rpy,
        })
    }
}

fn motion(c: &mut Cursor, name: &Ident) -> Parsed<Motion> {
    let kind = c.ident("`revolute`, `prismatic` or `fixed`")?;
    match kind.to_string().as_str() {
        "revolute" => axis(c, name, "revolute", "about").map(Motion::Revolute),
        "prismatic" => axis(c, name, "prismatic", "along").map(Motion::Prismatic),
        "fixed" => match c.peek_word("about") || c.peek_word("along") {
            true => Err(c.expected(format!("`{{`: the fixed joint `{name}` has no axis"))),
            false => Ok(Motion::Fixed),
        },
        other => {
            let hint = match nearest(other, ["revolute", "prismatic", "fixed"]) {
                Some(n) => format!("did you mean `{n}`?"),
                None => "expected `revolute`, `prismatic` or `fixed`".to_string(),
            };
            Err(Loc::from(&kind).error(format!("unknown joint type `{other}`\nhelp: {hint}")))
        }
    }
}

fn axis(c: &mut Cursor, name: &Ident, kind: &str, preposition: &str) -> Parsed<Axis> {
    if c.eat_word("about").is_none() && c.eat_word("along").is_none() {
        return Err(Loc::from(name).error(format!(
            "{kind} joint `{name}` needs an axis\nhelp: write `{kind} {preposition} y` or `{kind} {preposition} [0, 1, 0]`"
        )));
    }
    let start: Span = c.here();
    let direction = match c.peek() {
        Some(TokenTree::Ident(i)) => {
            let k = ["x", "y", "z"].iter().position(|n| i == n);
            let Some(k) = k else {
                return Err(Loc::from(start).error(format!(
                    "unknown axis `{i}`\nhelp: expected `x`, `y`, `z` or a direction such as `[0, 1, 0]`"
                )));
            };
            c.bump();
            AxisKind::Named(k)
        }
        _ => AxisKind::Given(Box::new(Vector::parse(c, "the axis")?)),
    };
    Ok(Axis {
        direction,
        loc: c.since(start),
    })
}
