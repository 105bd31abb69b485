//! From tokens to a tree with places: one file per construct, no meaning.
//!
//! After a bad item the parser goes on behind its `;` or `}`, so one compilation reports the
//! mistakes of all items.

mod cursor;
mod drive;
mod emit;
mod expect;
mod expr;
mod from_urdf;
mod items;
mod joint;
mod limit;
mod link;
mod names;
mod params;
mod shape;
mod system;
mod unit;
mod variant;

use proc_macro2::{Delimiter, Ident, Span, TokenStream};

use crate::diag::{Diagnostics, one_of};
use cursor::{Cursor, Parsed};
use items::{attributes, items, once, unknown_item};

pub use drive::{DriveDecl, DriveKind, ForceOn, MotorDecl, PerJoint};
pub use emit::EmitDecl;
pub use expect::ExpectDecl;
pub use expr::{Entry, Expr, ExprKind, Op, Range, Vector};
pub use from_urdf::FromUrdf;
pub use joint::{Axis, AxisKind, JointDecl, Motion};
pub use link::{Free, Inertia, LinkDecl};
pub use names::Names;
pub use params::{InputDecl, Nominal, ParamDecl, Ranges};
pub use shape::{Amount, Shape, ShapeKind};
pub use unit::UnitExpr;
pub use variant::{Lock, VariantDecl};

pub(crate) use from_urdf::{is_meant as is_from_urdf, parse as parse_from_urdf};

/// A `robot!` declaration as written.
#[derive(Debug, Clone)]
pub struct Ast {
    /// `///` lines on the robot.
    pub docs: Vec<String>,
    /// `#[allow(…)]` and the like on the robot, for the warnings.
    pub attrs: Vec<TokenStream>,
    /// Its visibility.
    pub vis: TokenStream,
    /// Its name.
    pub name: Ident,
    /// `gravity`.
    pub gravity: Option<Vector>,
    /// `params`, all blocks.
    pub params: Vec<ParamDecl>,
    /// `link`s.
    pub links: Vec<LinkDecl>,
    /// `joint`s.
    pub joints: Vec<JointDecl>,
    /// `coordinates` and `lagrangian` in place of links; the coordinates are among the joints.
    pub lagrangian: Option<Expr>,
    /// `potential +=`.
    pub potentials: Vec<Expr>,
    /// `input`s that belong to no joint.
    pub inputs: Vec<InputDecl>,
    /// `motor`s.
    pub motors: Vec<MotorDecl>,
    /// `per joint` blocks.
    pub per_joint: Vec<PerJoint>,
    /// `force on` laws.
    pub forces: Vec<ForceOn>,
    /// `emit`.
    pub emit: Option<EmitDecl>,
    /// `expect`, all items.
    pub expect: Vec<ExpectDecl>,
    /// `limit ops`: operations that a part of `emit` may take.
    pub limit: Option<usize>,
    /// `variant`s.
    pub variants: Vec<VariantDecl>,
    /// Held joints: empty except in the [`Ast::variant`]s.
    pub locks: Vec<Lock>,
}

impl Ast {
    /// Its visibility; private if the tokens are no visibility.
    pub fn visibility(&self) -> syn::Visibility {
        syn::parse2(self.vis.clone()).unwrap_or(syn::Visibility::Inherited)
    }

    /// Whether the system is given by coordinates and a Lagrangian.
    pub fn is_bare(&self) -> bool {
        let coordinate = |j: &JointDecl| matches!(j.motion, Motion::Coordinate(_));
        self.lagrangian.is_some() || self.joints.iter().any(coordinate)
    }

    /// The declaration as its variant number `k` has it.
    pub fn variant(&self, k: usize) -> Ast {
        let variant = &self.variants[k];
        let mut ast = self.clone();
        if !variant.docs.is_empty() {
            ast.docs.clone_from(&variant.docs);
        }
        ast.name = variant.name.clone();
        ast.locks.clone_from(&variant.locks);
        if variant.emit.is_some() {
            ast.emit.clone_from(&variant.emit);
        }
        ast.variants.clear();
        // Applies to the robot, not to the variant.
        ast.expect.clear();
        ast
    }
}

const ITEMS: &[&str] = &[
    "gravity",
    "params",
    "link",
    "joint",
    "per joint",
    "motor",
    "input",
    "force on",
    "potential",
    "coordinates",
    "lagrangian",
    "emit",
    "limit ops",
    "variant",
    "expect",
];

/// Reads a declaration. `None` if not even its name could be found; items with mistakes are left out.
pub fn parse(input: TokenStream, diag: &mut Diagnostics) -> Option<Ast> {
    let mut c = Cursor::new(input, Span::call_site());
    let head = match header(&mut c) {
        Ok(head) => head,
        Err(e) => {
            diag.push(e);
            return None;
        }
    };
    let (mut ast, body) = head;
    let Some(mut body) = body else {
        diag.push(c.expected(format!("`{{` after `robot {}`", ast.name)));
        return Some(ast);
    };
    if !c.is_done() {
        diag.error(
            c.here(),
            "one `robot!` declares one robot\nhelp: put the next one into a `robot!` of its own",
        );
    }
    let mut seen = Vec::new();
    items(&mut body, diag, |c, docs, diag| {
        item(c, docs, &mut ast, &mut seen, diag)
    });
    Some(ast)
}

fn header(c: &mut Cursor) -> Parsed<(Ast, Option<Cursor>)> {
    let ast = head(c)?;
    let body = match c.peek_group(Delimiter::Brace) {
        true => Some(Cursor::inside(&c.group(Delimiter::Brace, "`{`")?)),
        false => None,
    };
    Ok((ast, body))
}

/// Comments, attributes, visibility, `robot` and its name.
fn head(c: &mut Cursor) -> Parsed<Ast> {
    let (docs, attrs) = attributes(c)?;
    let mut vis = TokenStream::new();
    if c.peek_word("pub") {
        let start = c.here();
        vis.extend(c.bump());
        if c.peek_group(Delimiter::Parenthesis) {
            vis.extend(c.bump());
        }
        if syn::parse2::<syn::Visibility>(vis.clone()).is_err() {
            return Err(c
                .since(start)
                .error("unknown visibility\nhelp: write `pub`, `pub(crate)` or nothing"));
        }
    }
    if c.eat_word("robot").is_none() {
        return Err(c.expected("`robot Name { … }` or `pub robot Name { … }`"));
    }
    let name = c.type_name("the name of the robot")?;
    Ok(Ast {
        docs,
        attrs,
        vis,
        name,
        gravity: None,
        params: Vec::new(),
        links: Vec::new(),
        joints: Vec::new(),
        lagrangian: None,
        potentials: Vec::new(),
        inputs: Vec::new(),
        motors: Vec::new(),
        per_joint: Vec::new(),
        forces: Vec::new(),
        emit: None,
        expect: Vec::new(),
        limit: None,
        variants: Vec::new(),
        locks: Vec::new(),
    })
}

fn item(
    c: &mut Cursor,
    docs: Vec<String>,
    ast: &mut Ast,
    seen: &mut Vec<(String, Span)>,
    diag: &mut Diagnostics,
) -> Parsed<()> {
    let keyword = c.ident(&format!("one of {}", one_of(ITEMS)))?;
    match keyword.to_string().as_str() {
        "gravity" => {
            let again = once(seen, &keyword);
            c.punct(":", "after `gravity`")?;
            let g = Vector::parse(c, "gravity")?;
            c.semicolon("`gravity`")?;
            ast.gravity.get_or_insert(g);
            again
        }
        "params" => {
            ast.params.extend(params::parse_block(c, diag)?);
            Ok(())
        }
        "link" => {
            ast.links.push(link::parse(c, docs, diag)?);
            Ok(())
        }
        "joint" => {
            ast.joints.push(joint::parse(c, docs, diag)?);
            Ok(())
        }
        "per" => {
            ast.per_joint.push(drive::parse_per_joint(c, diag)?);
            Ok(())
        }
        "force" => {
            ast.forces.push(drive::parse_force(c)?);
            Ok(())
        }
        "motor" => {
            ast.motors.push(drive::parse_motor(c, docs, diag)?);
            Ok(())
        }
        "input" => {
            ast.inputs.push(InputDecl::parse(c, docs)?);
            Ok(())
        }
        "potential" => {
            ast.potentials.push(system::parse_potential(c)?);
            Ok(())
        }
        "coordinates" => {
            ast.joints.extend(system::parse_coordinates(c)?);
            Ok(())
        }
        "lagrangian" => {
            let again = once(seen, &keyword);
            let e = system::parse_lagrangian(c)?;
            ast.lagrangian.get_or_insert(e);
            again
        }
        "emit" => {
            let again = once(seen, &keyword);
            let e = emit::parse(c)?;
            ast.emit.get_or_insert(e);
            again
        }
        "expect" => {
            ast.expect.push(expect::parse(c)?);
            Ok(())
        }
        "variant" => {
            ast.variants.push(variant::parse(c, docs, diag)?);
            Ok(())
        }
        "limit" => {
            let again = once(seen, &keyword);
            let operations = limit::parse(c)?;
            ast.limit.get_or_insert(operations);
            again
        }
        _ => Err(unknown_item(&keyword, ITEMS)),
    }
}
