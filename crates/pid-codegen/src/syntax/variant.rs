//! Variants: `variant Held { lock j3..=j6 = 0 rad; emit { dynamics } }`.

use proc_macro2::{Delimiter, Ident};

use super::cursor::{Cursor, Parsed};
use super::expr::Expr;
use super::items::unknown_item;
use super::names::Names;
use super::{EmitDecl, emit};
use crate::diag::Diagnostics;

/// A second model from the same description, with joints held.
#[derive(Debug, Clone)]
pub struct VariantDecl {
    /// `///` lines.
    pub docs: Vec<String>,
    /// Its name.
    pub name: Ident,
    /// The held joints.
    pub locks: Vec<Lock>,
    /// Its own `emit`; that of the robot if left out.
    pub emit: Option<EmitDecl>,
}

/// `lock j3..=j6 = value;`
#[derive(Debug, Clone)]
pub struct Lock {
    /// The joints.
    pub joints: Names,
    /// The position they are held at, a constant.
    pub value: Expr,
}

const ITEMS: &[&str] = &["lock", "emit"];

/// A variant after its keyword.
pub(super) fn parse(
    c: &mut Cursor,
    docs: Vec<String>,
    diag: &mut Diagnostics,
) -> Parsed<VariantDecl> {
    let name = c.type_name("the name of a variant")?;
    let group = c.group(
        Delimiter::Brace,
        &format!("`{{ lock joint = value; }}` of variant `{name}`"),
    )?;
    let mut variant = VariantDecl {
        docs,
        name,
        locks: Vec::new(),
        emit: None,
    };
    let mut seen = Vec::new();
    super::items::items(&mut Cursor::inside(&group), diag, |c, _, _| {
        let keyword = c.ident("`lock joint = value;` or `emit { … }`")?;
        if keyword == "lock" {
            let joints = Names::parse(c, "the name of a joint after `lock`")?;
            c.punct("=", "and the position the joint is held at")?;
            let value = Expr::parse(c)?;
            c.semicolon("`lock`")?;
            variant.locks.push(Lock { joints, value });
            return Ok(());
        }
        if keyword == "emit" {
            let again = super::items::once(&mut seen, &keyword);
            let e = emit::parse(c)?;
            variant.emit.get_or_insert(e);
            return again;
        }
        Err(unknown_item(&keyword, ITEMS))
    });
    Ok(variant)
}
