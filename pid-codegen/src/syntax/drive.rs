//! Drives: `per joint { … }` blocks and `force on joint = …;`.

use proc_macro2::{Delimiter, Ident, Span};

use super::Names;
use super::cursor::{Cursor, Parsed};
use super::expr::Expr;
use super::params::{InputDecl, ParamDecl};
use crate::diag::Diagnostics;

/// Declarations and laws repeated for several joints.
#[derive(Debug, Clone)]
pub struct PerJoint {
    /// The word `joint`.
    pub at: Span,
    /// The joints meant, all moving ones if none are named.
    pub joints: Option<Vec<Names>>,
    /// Inputs.
    pub inputs: Vec<InputDecl>,
    /// Parameters.
    pub params: Vec<ParamDecl>,
    /// Rotor inertia as felt at the joint.
    pub armature: Option<Expr>,
    /// Force law.
    pub force: Option<Expr>,
}

/// A law for one joint.
#[derive(Debug, Clone)]
pub struct ForceOn {
    /// The joint.
    pub joint: Ident,
    /// Force law.
    pub force: Expr,
}

/// `per joint … { … }` after `per`.
pub(super) fn parse_per_joint(c: &mut Cursor, diag: &mut Diagnostics) -> Parsed<PerJoint> {
    let at = c.here();
    if c.eat_word("joint").is_none() {
        return Err(c.expected("`joint` after `per`"));
    }
    let mut joints = None;
    while !c.peek_group(Delimiter::Brace) {
        let list = joints.get_or_insert_with(Vec::new);
        list.push(Names::parse(c, "the name of a joint or `{`")?);
        if c.eat_punct(",").is_none() && !c.peek_group(Delimiter::Brace) {
            return Err(c.expected("`,` or `{` after the name of a joint"));
        }
    }
    let group = c.group(Delimiter::Brace, "`{` after `per joint`")?;
    let mut block = PerJoint {
        at,
        joints,
        inputs: Vec::new(),
        params: Vec::new(),
        armature: None,
        force: None,
    };
    let mut seen = Vec::new();
    super::items(&mut Cursor::inside(&group), diag, |c, docs, _| {
        let first = c.ident("`input`, a parameter, `armature = …` or `force = …`")?;
        let law = (first == "armature" || first == "force") && c.peek_punct("=");
        if law {
            let again = super::once(&mut seen, &first);
            c.punct("=", "")?;
            let e = Expr::parse(c)?;
            c.semicolon(&format!("`{first}`"))?;
            if first == "force" {
                block.force.get_or_insert(e);
            } else {
                block.armature.get_or_insert(e);
            }
            return again;
        }
        if first == "input" && c.peek_ident().is_some() {
            block.inputs.push(InputDecl::parse(c, docs)?);
            return Ok(());
        }
        if !c.peek_punct(":") {
            return Err(super::unknown_item(
                &first,
                &["input", "armature =", "force =", "name: unit"],
            ));
        }
        c.back();
        block.params.push(ParamDecl::parse(c, docs)?);
        Ok(())
    });
    Ok(block)
}

/// `force on j = …;` after `force`.
pub(super) fn parse_force(c: &mut Cursor) -> Parsed<ForceOn> {
    if c.eat_word("on").is_none() {
        return Err(
            c.expected("`on` and a joint after `force` (or the law inside a `per joint` block)")
        );
    }
    let joint = c.ident("the name of a joint")?;
    c.punct("=", &format!("and the force on `{joint}`"))?;
    let force = Expr::parse(c)?;
    c.semicolon("a force law")?;
    Ok(ForceOn { joint, force })
}
