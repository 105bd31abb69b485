//! Homogeneous bodies: `inertial: solid cylinder { mass: m; radius: r; length: l; axis: z; }` and the like.

use proc_macro2::{Delimiter, Ident, Span};

use super::cursor::{Cursor, Parsed};
use super::expr::{Expr, Vector};
use super::items::unknown_item;
use crate::diag::{Diagnostics, Loc, nearest, one_of};

/// A homogeneous body, its axes along those of the link, its centre at the link's `com`.
#[derive(Debug, Clone)]
pub struct Shape {
    /// Its kind and dimensions.
    pub kind: ShapeKind,
    /// How much of it.
    pub amount: Amount,
    /// From `solid` or `hollow` to the kind.
    pub loc: Loc,
}

/// Kinds of bodies with their dimensions.
#[derive(Debug, Clone)]
pub enum ShapeKind {
    /// `solid cylinder`: radius, length, axis 0, 1, 2.
    Cylinder(Expr, Expr, usize),
    /// `hollow cylinder`: outer and inner radius, length, axis.
    Tube(Expr, Expr, Expr, usize),
    /// `solid box`: edges along x, y, z.
    Box(std::boxed::Box<Vector>),
    /// `solid sphere`: radius.
    Sphere(Expr),
}

/// How much matter a body has.
#[derive(Debug, Clone)]
pub enum Amount {
    /// `mass: …;`
    Mass(Expr),
    /// `density: …;`
    Density(Expr),
}

const SHAPES: [&str; 4] = [
    "solid cylinder",
    "hollow cylinder",
    "solid box",
    "solid sphere",
];

/// `solid cylinder { … }`, at `solid` or `hollow`.
pub(super) fn parse(c: &mut Cursor, diag: &mut Diagnostics) -> Parsed<Shape> {
    let start = c.here();
    let fill = c.ident("`solid` or `hollow`")?;
    let form = c.ident("`cylinder`, `box` or `sphere`")?;
    let loc = c.since(start);
    let name = format!("{fill} {form}");
    let dimensions: &[&str] = match name.as_str() {
        "solid cylinder" => &["radius", "length", "axis"],
        "hollow cylinder" => &["outer", "inner", "length", "axis"],
        "solid box" => &["size"],
        "solid sphere" => &["radius"],
        _ => {
            let help = match nearest(&name, SHAPES) {
                Some(n) => format!("did you mean `{n}`?"),
                None => format!("expected {}", one_of(&SHAPES)),
            };
            return Err(loc.error(format!("unknown body `{name}`\nhelp: {help}")));
        }
    };
    let group = c.group(
        Delimiter::Brace,
        &format!("`{{ mass: …; {}: …; }}` after `{name}`", dimensions[0]),
    )?;
    let before = diag.count();
    let mut fields = Fields::parse(&mut Cursor::inside(&group), dimensions, diag);
    let amount = fields.amount()?;
    let kind = fields.kind(&name);
    match (amount, kind) {
        (Some(amount), Some(kind)) => Ok(Shape { kind, amount, loc }),
        // An error inside the braces explains it already.
        _ if diag.count() > before => Err(diag
            .pop()
            .unwrap_or_else(|| loc.error("a body with a mistake in its braces"))),
        (amount, _) => Err(loc.error(fields.lacking(&name, dimensions, amount.is_none()))),
    }
}

/// What stands in the braces of a body.
#[derive(Default)]
struct Fields {
    /// Fields of one number.
    values: Vec<(Ident, Expr)>,
    size: Option<Vector>,
    axis: Option<usize>,
    /// All fields so far, with their places.
    seen: Vec<(String, Span)>,
}

impl Fields {
    /// Fields of a body of these dimensions, which has a mass or a density too.
    fn parse(c: &mut Cursor, dimensions: &[&str], diag: &mut Diagnostics) -> Self {
        let mut found = Self::default();
        let known: Vec<&str> = ["mass", "density"]
            .into_iter()
            .chain(dimensions.iter().copied())
            .collect();
        super::items::items(c, diag, |c, _, _| {
            let field = c.ident(&format!("one of {}", one_of(&known)))?;
            let text = field.to_string();
            if !known.contains(&text.as_str()) {
                return Err(unknown_item(&field, &known));
            }
            let again = super::items::once(&mut found.seen, &field);
            c.punct(":", &format!("after `{text}`"))?;
            match text.as_str() {
                "size" => found.size = Some(Vector::parse(c, "the size of a box")?),
                "axis" => {
                    let word = c.ident("`x`, `y` or `z`")?;
                    let k = ["x", "y", "z"].iter().position(|n| word == n);
                    found.axis = Some(k.ok_or_else(|| {
                        Loc::from(&word).error(format!(
                            "unknown axis `{word}`\nhelp: expected `x`, `y` or `z`; turn the body by a fixed joint with `rpy`"
                        ))
                    })?);
                }
                _ => found.values.push((field, Expr::parse(c)?)),
            }
            c.semicolon(&format!("`{text}` of a body"))?;
            again
        });
        found
    }

    /// The expression of a field, which no later call finds again.
    fn take(&mut self, name: &str) -> Option<Expr> {
        let at = self.values.iter().position(|f| f.0 == name)?;
        Some(self.values.swap_remove(at).1)
    }

    fn amount(&mut self) -> Parsed<Option<Amount>> {
        Ok(match (self.take("mass"), self.take("density")) {
            (Some(m), None) => Some(Amount::Mass(m)),
            (None, Some(d)) => Some(Amount::Density(d)),
            (Some(_), Some(d)) => {
                return Err(d
                    .loc
                    .error("a body has a mass or a density, not both\nhelp: remove one of them"));
            }
            (None, None) => None,
        })
    }

    /// The body `name`, if its dimensions are complete.
    fn kind(&mut self, name: &str) -> Option<ShapeKind> {
        match name {
            "solid cylinder" => Some(ShapeKind::Cylinder(
                self.take("radius")?,
                self.take("length")?,
                self.axis?,
            )),
            "hollow cylinder" => {
                let (outer, inner) = (self.take("outer")?, self.take("inner")?);
                Some(ShapeKind::Tube(
                    outer,
                    inner,
                    self.take("length")?,
                    self.axis?,
                ))
            }
            "solid box" => self.size.take().map(|s| ShapeKind::Box(Box::new(s))),
            _ => self.take("radius").map(ShapeKind::Sphere),
        }
    }

    /// Which fields a body needs and lacks, in words.
    fn lacking(&self, name: &str, dimensions: &[&str], no_amount: bool) -> String {
        let given = |f: &&str| !self.seen.iter().any(|s| s.0 == **f);
        let mut missing: Vec<&str> = dimensions.iter().copied().filter(given).collect();
        if no_amount {
            missing.insert(0, "mass");
        }
        format!(
            "`{name}` lacks {}\nhelp: a {name} needs `mass` or `density` and {}",
            one_of(&missing).replace(" or ", " and "),
            one_of(dimensions).replace(" or ", " and ")
        )
    }
}
