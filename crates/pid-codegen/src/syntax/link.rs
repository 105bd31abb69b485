//! Links: `link fore { mass: m2; com: [sx2, sy2, sz2]; inertia at com: diag(ix2, iy2, iz2); }`.

use proc_macro2::{Delimiter, Group, Ident, Span};

use super::cursor::{Cursor, Parsed};
use super::expr::{Entry, Vector};
use super::items::unknown_item;
use super::names::Names;
use super::shape::{self, Shape};
use super::unit::UnitExpr;
use crate::diag::{Diagnostics, Loc};
use pid_derive::model::About;

/// A link, or a range of links with the same body.
#[derive(Debug, Clone)]
pub struct LinkDecl {
    /// `///` lines.
    pub docs: Vec<String>,
    /// Its name or names.
    pub names: Names,
    /// Mass.
    pub mass: Option<Entry>,
    /// Centre of mass.
    pub com: Option<Vector>,
    /// Inertia.
    pub inertia: Option<Inertia>,
    /// `inertial: free`; values given beside it are nominal values.
    pub free: Option<Free>,
    /// `inertial: solid …`: mass and inertia of a homogeneous body.
    pub shape: Option<Shape>,
}

/// `inertial: free` or `inertial: free at com`.
#[derive(Debug, Clone, Copy)]
pub struct Free {
    /// Ten standard parameters about the link origin, or m, s, I about the centre of mass.
    pub about: About,
    /// The words.
    pub loc: Loc,
}

/// An inertia tensor.
#[derive(Debug, Clone)]
pub struct Inertia {
    /// Its reference point.
    pub about: About,
    /// xx, yy, zz.
    pub diagonal: [Entry; 3],
    /// xy, xz, yz; none for `diag(..)`.
    pub products: Option<[Entry; 3]>,
    /// The unit of the bare numbers in it.
    pub unit: Option<UnitExpr>,
    /// The tensor.
    pub loc: Loc,
}

const FIELDS: &[&str] = &["mass", "com", "inertia", "inertial"];

/// A link after its keyword.
pub(super) fn parse(c: &mut Cursor, docs: Vec<String>, diag: &mut Diagnostics) -> Parsed<LinkDecl> {
    let names = Names::parse(c, "the name of a link")?;
    let group = c.group(
        Delimiter::Brace,
        "`{ mass: …; com: […]; inertia at com: …; }` after the name of a link",
    )?;
    let mut link = LinkDecl {
        docs,
        names,
        mass: None,
        com: None,
        inertia: None,
        free: None,
        shape: None,
    };
    let mut seen: Vec<(String, Span)> = Vec::new();
    super::items::items(&mut Cursor::inside(&group), diag, |c, _, diag| {
        let keyword = c.ident("one of `mass`, `com`, `inertia`, `inertial`")?;
        let again = super::items::once(&mut seen, &keyword);
        match keyword.to_string().as_str() {
            "mass" => {
                c.punct(":", "after `mass`")?;
                link.mass = Some(Entry::parse(c)?);
            }
            "com" => {
                c.punct(":", "after `com`")?;
                link.com = Some(Vector::parse(c, "the centre of mass")?);
            }
            "inertia" => link.inertia = Some(inertia(c)?),
            "inertial" => {
                c.punct(":", "after `inertial`")?;
                if c.peek_word("solid") || c.peek_word("hollow") {
                    link.shape = Some(shape::parse(c, diag)?);
                    // Braces end an item.
                    c.eat_punct(";");
                    return again;
                }
                link.free = Some(free(c, &keyword)?);
            }
            _ => return Err(unknown_item(&keyword, FIELDS)),
        }
        c.semicolon(&format!("`{keyword}` of a link"))?;
        again
    });
    Ok(link)
}

fn about(c: &mut Cursor) -> Parsed<About> {
    if c.eat_word("com").is_some() {
        Ok(About::Com)
    } else if c.eat_word("origin").is_some() {
        Ok(About::Origin)
    } else {
        Err(c.expected("`com` or `origin`"))
    }
}

fn free(c: &mut Cursor, keyword: &Ident) -> Parsed<Free> {
    if c.eat_word("free").is_none() {
        return Err(c.expected("`free`, `free at com` or a body such as `solid cylinder { … }`"));
    }
    let about = match c.eat_word("at") {
        Some(_) => about(c)?,
        None => About::Origin,
    };
    Ok(Free {
        about,
        loc: c.since(keyword.span()),
    })
}

fn inertia(c: &mut Cursor) -> Parsed<Inertia> {
    if c.eat_word("at").is_none() {
        return Err(c.expected("`at com:` or `at origin:` after `inertia`"));
    }
    let about = about(c)?;
    c.punct(":", "after the reference point of the inertia")?;
    let start = c.here();
    let (diagonal, products) = if c.eat_word("diag").is_some() {
        let group = c.group(Delimiter::Parenthesis, "`(Ixx, Iyy, Izz)` after `diag`")?;
        let entries = Cursor::list(&group, Entry::parse)?;
        let loc = c.since(start);
        let diagonal = <[Entry; 3]>::try_from(entries).map_err(|found| {
            loc.error(format!(
                "`diag` has {} entries, but needs three: `diag(Ixx, Iyy, Izz)`",
                found.len()
            ))
        })?;
        (diagonal, None)
    } else {
        let group = c.group(
            Delimiter::Bracket,
            "`diag(Ixx, Iyy, Izz)` or `[xx: …, yy: …, zz: …, xy: …, xz: …, yz: …]`",
        )?;
        let (d, p) = tensor(&group, c.since(start))?;
        (d, Some(p))
    };
    let unit = UnitExpr::optional(c)?;
    Ok(Inertia {
        about,
        diagonal,
        products,
        unit,
        loc: c.since(start),
    })
}

/// `[xx: a, yy: b, zz: c, xy: d, xz: e, yz: f]`, in any order.
fn tensor(group: &Group, loc: Loc) -> Parsed<([Entry; 3], [Entry; 3])> {
    const NAMES: [&str; 6] = ["xx", "yy", "zz", "xy", "xz", "yz"];
    let mut found: [Option<Entry>; 6] = Default::default();
    let mut seen = Vec::new();
    Cursor::list(group, |c| {
        let name = c.ident("an entry of the tensor: `xx: …`")?;
        let Some(k) = NAMES.iter().position(|n| name == n) else {
            return Err(unknown_item(&name, &NAMES));
        };
        super::items::once(&mut seen, &name)?;
        c.punct(":", &format!("after `{name}`"))?;
        found[k] = Some(Entry::parse(c)?);
        Ok(())
    })?;
    let missing: Vec<&str> = NAMES
        .iter()
        .zip(&found)
        .filter(|(_, e)| e.is_none())
        .map(|(n, _)| *n)
        .collect();
    match found {
        [Some(xx), Some(yy), Some(zz), Some(xy), Some(xz), Some(yz)] => {
            Ok(([xx, yy, zz], [xy, xz, yz]))
        }
        _ => Err(loc.error(format!(
            "the tensor lacks {}\nhelp: name all six entries, with 0 for those that vanish by symmetry, or write `diag(Ixx, Iyy, Izz)`",
            crate::diag::one_of(&missing).replace(" or ", " and ")
        ))),
    }
}
