//! `pub robot Arm from urdf "robots/arm.urdf" { … }`: the items that a robot from a file takes.

use proc_macro2::{Delimiter, Ident, Span, TokenStream, TokenTree};

use super::cursor::{Cursor, Parsed};
use super::expr::Vector;
use super::items::unknown_item;
use super::{Ast, emit, expect, limit, params};
use crate::diag::{Diagnostics, Loc, one_of};

/// A robot whose links and joints stand in a file.
#[derive(Debug, Clone)]
pub struct FromUrdf {
    /// Its name, docs, `gravity`, `params`, `emit`, `limit` and `expect`.
    pub ast: Ast,
    /// Path of the file, as written.
    pub path: String,
    /// Its place.
    pub place: Span,
    /// `inertial: free;`: whether masses and inertias are parameters.
    pub inertial: Option<bool>,
    /// `friction: free;`
    pub friction: Option<bool>,
    /// `armature: free;`
    pub armature: Option<bool>,
}

const ITEMS: &[&str] = &[
    "inertial",
    "friction",
    "armature",
    "gravity",
    "params",
    "emit",
    "limit ops",
    "expect",
];

/// Whether tokens declare a robot from a file: `robot X from` after attributes and visibility.
pub(crate) fn is_meant(input: &TokenStream) -> bool {
    let words: Vec<String> = input
        .clone()
        .into_iter()
        .filter_map(|tree| match tree {
            TokenTree::Ident(ident) => Some(ident.to_string()),
            _ => None,
        })
        .take(5)
        .collect();
    words
        .windows(3)
        .any(|words| words[0] == "robot" && words[2] == "from")
}

/// Reads a declaration. `None` without a name and a path; items with mistakes are left out.
pub(crate) fn parse(input: TokenStream, diag: &mut Diagnostics) -> Option<FromUrdf> {
    let mut c = Cursor::new(input, Span::call_site());
    let (mut declared, mut body) = match header(&mut c) {
        Ok(head) => head,
        Err(e) => {
            diag.push(e);
            return None;
        }
    };
    if !c.is_done() {
        diag.error(
            c.here(),
            "one `robot!` declares one robot\nhelp: put the next one into a `robot!` of its own",
        );
    }
    let mut seen = Vec::new();
    super::items::items(&mut body, diag, |c, _, diag| {
        item(c, &mut declared, &mut seen, diag)
    });
    Some(declared)
}

fn header(c: &mut Cursor) -> Parsed<(FromUrdf, Cursor)> {
    let ast = super::head(c)?;
    let name = ast.name.clone();
    if c.eat_word("from").is_none() || c.eat_word("urdf").is_none() {
        return Err(c.expected("`from urdf \"path\"` after the name of the robot"));
    }
    let place = c.here();
    let path = match c.peek() {
        Some(TokenTree::Literal(l)) => match syn::Lit::new(l.clone()) {
            syn::Lit::Str(text) => Some(text.value()),
            _ => None,
        },
        _ => None,
    };
    let Some(path) = path else {
        return Err(c.expected("the path of a file in quotes after `from urdf`"));
    };
    c.bump();
    let group = c.group(
        Delimiter::Brace,
        &format!("`{{ … }}` after the path of robot `{name}`"),
    )?;
    let declared = FromUrdf {
        ast,
        path,
        place,
        inertial: None,
        friction: None,
        armature: None,
    };
    Ok((declared, Cursor::inside(&group)))
}

fn item(
    c: &mut Cursor,
    declared: &mut FromUrdf,
    seen: &mut Vec<(String, Span)>,
    diag: &mut Diagnostics,
) -> Parsed<()> {
    let keyword = c.ident(&format!("one of {}", one_of(ITEMS)))?;
    let ast = &mut declared.ast;
    let choice = match keyword.to_string().as_str() {
        "params" => {
            ast.params.extend(params::parse_block(c, diag)?);
            return Ok(());
        }
        "expect" => {
            ast.expect.push(expect::parse(c)?);
            return Ok(());
        }
        "emit" => {
            let again = super::items::once(seen, &keyword);
            ast.emit = Some(emit::parse(c)?);
            return again;
        }
        "limit" => {
            let again = super::items::once(seen, &keyword);
            ast.limit = Some(limit::parse(c)?);
            return again;
        }
        "gravity" => {
            let again = super::items::once(seen, &keyword);
            c.punct(":", "after `gravity`")?;
            ast.gravity = Some(Vector::parse(c, "gravity")?);
            c.semicolon("`gravity`")?;
            return again;
        }
        "inertial" => &mut declared.inertial,
        "friction" => &mut declared.friction,
        "armature" => &mut declared.armature,
        _ => return Err(unknown_item(&keyword, ITEMS)),
    };
    let again = super::items::once(seen, &keyword);
    c.punct(":", &format!("after `{keyword}`"))?;
    *choice = Some(free(c, &keyword)?);
    c.semicolon(&format!("`{keyword}`"))?;
    again
}

/// `free` or `fixed`.
fn free(c: &mut Cursor, keyword: &Ident) -> Parsed<bool> {
    let word = c.ident(&format!("`free` or `fixed` after `{keyword}:`"))?;
    match word.to_string().as_str() {
        "free" => Ok(true),
        "fixed" => Ok(false),
        other => Err(Loc::from(&word).error(format!(
            "expected `free` or `fixed`, found `{other}`\nhelp: `free` makes parameters of them, `fixed` keeps the numbers of the file"
        ))),
    }
}
