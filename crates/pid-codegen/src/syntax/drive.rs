//! Drives: `per joint { … }` blocks, `motor`s of several joints, and `force on joint = …;`.

use proc_macro2::{Delimiter, Group, Ident, Span};

use super::cursor::{Cursor, Parsed};
use super::expr::Expr;
use super::names::Names;
use super::params::{InputDecl, ParamDecl};
use super::unit::UnitExpr;
use crate::diag::{Diagnostics, Loc, nearest};

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
    /// `drive: …`; its input is among the inputs.
    pub drive: Option<DriveDecl>,
}

/// A motor with gear: a force law in product form.
#[derive(Debug, Clone)]
pub struct DriveDecl {
    /// Kind of its input.
    pub kind: DriveKind,
    /// The word after `drive:`.
    pub loc: Loc,
    /// Name of its input.
    pub input: Ident,
    /// Turns of the motor per turn of the joint (rad/m on a prismatic joint).
    pub ratio: Option<Expr>,
    /// Inertia of the rotor.
    pub rotor: Option<Expr>,
    /// Torque per ampere, and volts per rad/s.
    pub gain: Option<Expr>,
    /// Resistance of the winding.
    pub resistance: Option<Expr>,
}

/// Kind of a drive's input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DriveKind {
    /// Torque of the motor.
    Torque,
    /// Current.
    Current,
    /// Voltage at the winding.
    Voltage,
}

/// `motor m6: j5 + j6 { … }`: a drive that moves several joints.
#[derive(Debug, Clone)]
pub struct MotorDecl {
    /// `///` lines.
    pub docs: Vec<String>,
    /// Its name.
    pub name: Ident,
    /// Its position as a combination of joints.
    pub moves: Expr,
    /// Declarations and laws, as of `per joint`.
    pub body: PerJoint,
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
    Ok(block(&group, at, joints, diag))
}

/// `m6: j5 + j6 { … }` after `motor`.
pub(super) fn parse_motor(
    c: &mut Cursor,
    docs: Vec<String>,
    diag: &mut Diagnostics,
) -> Parsed<MotorDecl> {
    let at = c.here();
    let name = c.ident("the name of a motor")?;
    c.punct(":", &format!("and what motor `{name}` moves: `j5 + j6`"))?;
    let moves = Expr::parse(c)?;
    let group = c.group(
        Delimiter::Brace,
        &format!("`{{ force = …; }}` of motor `{name}`"),
    )?;
    Ok(MotorDecl {
        docs,
        name,
        moves,
        body: block(&group, at, None, diag),
    })
}

/// The contents of `per joint` and `motor`.
fn block(group: &Group, at: Span, joints: Option<Vec<Names>>, diag: &mut Diagnostics) -> PerJoint {
    let mut block = PerJoint {
        at,
        joints,
        inputs: Vec::new(),
        params: Vec::new(),
        armature: None,
        force: None,
        drive: None,
    };
    let mut seen = Vec::new();
    super::items::items(&mut Cursor::inside(group), diag, |c, docs, diag| {
        let first = c.ident("`input`, a parameter, `drive: …`, `armature = …` or `force = …`")?;
        let law = (first == "armature" || first == "force") && c.peek_punct("=");
        if law {
            let again = super::items::once(&mut seen, &first);
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
        if first == "drive" && c.peek_punct(":") {
            let again = super::items::once(&mut seen, &first);
            c.punct(":", "")?;
            let drive = drive(c, diag)?;
            if block.drive.is_none() {
                block.inputs.push(drive_input(&drive, docs));
                block.drive = Some(drive);
            }
            return again;
        }
        if first == "input" && c.peek_ident().is_some() {
            block.inputs.push(InputDecl::parse(c, docs)?);
            return Ok(());
        }
        if !c.peek_punct(":") {
            return Err(super::items::unknown_item(
                &first,
                &["input", "drive:", "armature =", "force =", "name: unit"],
            ));
        }
        c.back();
        block.params.push(ParamDecl::parse(c, docs)?);
        Ok(())
    });
    block
}

/// `torque;`, `current { gain: k; }`, `voltage { gain: k; resistance: r; ratio: n; rotor: j; }`.
fn drive(c: &mut Cursor, diag: &mut Diagnostics) -> Parsed<DriveDecl> {
    const KINDS: [&str; 3] = ["torque", "current", "voltage"];
    let word = c.ident("`torque`, `current` or `voltage`")?;
    let (kind, needed): (_, &[&str]) = match word.to_string().as_str() {
        "torque" => (DriveKind::Torque, &[]),
        "current" => (DriveKind::Current, &["gain"]),
        "voltage" => (DriveKind::Voltage, &["gain", "resistance"]),
        other => {
            let help = match nearest(other, KINDS) {
                Some(n) => format!("did you mean `{n}`?"),
                None => format!("expected {}", crate::diag::one_of(&KINDS)),
            };
            return Err(Loc::from(&word).error(format!("unknown drive `{other}`\nhelp: {help}")));
        }
    };
    let mut drive = DriveDecl {
        kind,
        loc: (&word).into(),
        input: word.clone(),
        ratio: None,
        rotor: None,
        gain: None,
        resistance: None,
    };
    let known: Vec<&str> = needed.iter().copied().chain(["ratio", "rotor"]).collect();
    let before = diag.count();
    if c.peek_group(Delimiter::Brace) {
        let group = c.group(Delimiter::Brace, "`{`")?;
        let mut seen = Vec::new();
        super::items::items(&mut Cursor::inside(&group), diag, |c, _, _| {
            let field = c.ident(&format!("one of {}", crate::diag::one_of(&known)))?;
            if !known.iter().any(|k| field == k) {
                return Err(super::items::unknown_item(&field, &known));
            }
            let again = super::items::once(&mut seen, &field);
            c.punct(":", &format!("after `{field}`"))?;
            let e = Expr::parse(c)?;
            c.semicolon(&format!("`{field}` of a drive"))?;
            let place = match field.to_string().as_str() {
                "ratio" => &mut drive.ratio,
                "rotor" => &mut drive.rotor,
                "gain" => &mut drive.gain,
                _ => &mut drive.resistance,
            };
            place.get_or_insert(e);
            again
        });
        // `{ … };` and `{ … }` are the same.
        c.eat_punct(";");
    } else {
        c.semicolon(&format!("`drive: {word}`"))?;
    }
    let lacks = needed.iter().find(|n| match **n {
        "gain" => drive.gain.is_none(),
        _ => drive.resistance.is_none(),
    });
    if let Some(lacks) = lacks
        && diag.count() == before
    {
        return Err(Loc::from(&word).error(format!(
            "`drive: {word}` needs its `{lacks}`\nhelp: write `drive: {word} {{ {}: …; }}`",
            needed.join(": …; ")
        )));
    }
    Ok(drive)
}

/// The input of a drive, named after its kind.
fn drive_input(drive: &DriveDecl, docs: Vec<String>) -> InputDecl {
    let (text, factors): (_, &[&str]) = match drive.kind {
        DriveKind::Torque => ("Torque of the motor.", &["N", "m"]),
        DriveKind::Current => ("Current of the motor.", &["A"]),
        DriveKind::Voltage => ("Voltage at the winding of the motor.", &["V"]),
    };
    let factors = factors
        .iter()
        .map(|n| (Ident::new(n, drive.loc.start), 1))
        .collect();
    InputDecl {
        docs: if docs.is_empty() {
            vec![text.to_string()]
        } else {
            docs
        },
        name: drive.input.clone(),
        unit: UnitExpr {
            factors,
            loc: drive.loc,
        },
    }
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
