//! Units, values and geometry: from declarations to the lists of the resolved robot. The tree of
//! links comes after.

use proc_macro2::Span;

use crate::diag::Diagnostics;
use crate::si::Unit;
use crate::syntax::{Ast, InputDecl, Vector};
use pid_derive::model::{About, Expr, Input, Joint, Motor, Robot};

use super::builder::Builder;
use super::meaning::Scope;
use super::names::{Origin, Symbols};
use super::numbers::constant;
use super::resolved::{Places, Resolved, emit};
use super::units::{self, Units};
use super::{motion, values};

/// The resolved robot without `order` and the links of the joints. `None` after an error.
pub(super) fn robot(ast: &Ast, symbols: &Symbols<'_>, diag: &mut Diagnostics) -> Option<Resolved> {
    let mut units = Units::new(
        symbols,
        declared_units(symbols, diag),
        input_units(symbols, diag),
    );
    motion::resolve(symbols, &mut units, diag);
    let params = values::params(symbols, &units, diag);
    let mut b = Builder::new(symbols, &units, diag);
    let gravity = match ast.is_bare() {
        true => Some([0, 1, 2].map(|_| Expr::Num(0.0))),
        false => ast.gravity.as_ref().and_then(|g| b.gravity(g)),
    };
    let potential = b.energies(&ast.potentials, Scope::Potential, "the potential");
    let lagrangian = b.energies(
        ast.lagrangian.as_slice(),
        Scope::Lagrangian,
        "the Lagrangian",
    );
    let links = b.links(params.as_deref());
    let joints: Vec<Option<Joint>> = (0..symbols.joints.len()).map(|j| b.joint(ast, j)).collect();
    let motors: Vec<Option<Motor>> = (0..symbols.motors.len()).map(|k| b.motor(ast, k)).collect();
    let (blanks, blank_places) = (b.blanks, b.blank_places);
    if !diag.is_ok() {
        return None;
    }
    let (links, nominal) = links?;
    let mut params = params?;
    for (k, x) in nominal {
        params[k].nominal = x;
    }
    let inputs = symbols.inputs.iter().zip(&units.inputs).map(|(u, unit)| {
        Some(Input {
            name: u.field.to_string(),
            docs: u.decl.docs.clone(),
            unit: unit.as_ref()?.to_string(),
            coord: u.joint.and_then(|j| coordinate(symbols, &units, j)),
        })
    });
    let robot = Robot {
        name: ast.name.to_string(),
        docs: ast.docs.clone(),
        gravity: gravity?,
        params,
        inputs: inputs.collect::<Option<_>>()?,
        links,
        joints: joints.into_iter().collect::<Option<_>>()?,
        order: Vec::new(),
        motors: motors.into_iter().collect::<Option<_>>()?,
        potential: potential?,
        lagrangian: lagrangian?,
        blanks,
        emit: emit(ast),
    };
    Some(Resolved {
        robot,
        places: places(symbols, blank_places),
        identifiability: Default::default(),
    })
}

/// Gravity without parameters.
pub(super) fn constant_gravity(
    given: &Vector,
    symbols: &Symbols<'_>,
    units: &Units<'_>,
    diag: &mut Diagnostics,
) -> Option<[f64; 3]> {
    let mut b = Builder::new(symbols, units, diag);
    let [x, y, z] = b.gravity(given)?;
    Some([constant(&x)?, constant(&y)?, constant(&z)?])
}

/// The coordinate of an input: that of its joint, or the last one that the joint or motor moves.
fn coordinate(symbols: &Symbols<'_>, units: &Units<'_>, joint: usize) -> Option<usize> {
    let own = symbols.joints.get(joint).and_then(|j| j.coord);
    own.or_else(|| {
        let affine = units.moves[joint].as_ref()?.affine.as_ref()?;
        affine.terms.iter().map(|t| t.0).max()
    })
}

fn places(symbols: &Symbols<'_>, blanks: Vec<Span>) -> Places {
    Places {
        params: symbols.params.iter().map(|p| p.field.clone()).collect(),
        param_decls: symbols.params.iter().map(|p| p.decl).collect(),
        inputs: symbols.inputs.iter().map(|u| u.field.clone()).collect(),
        input_decls: symbols.inputs.iter().map(|u| u.decl.name.span()).collect(),
        links: symbols.links.iter().map(|l| l.ident.clone()).collect(),
        joints: symbols.joints.iter().map(|j| j.decl.name.clone()).collect(),
        blanks,
    }
}

/// Units of the parameters; an unknown one is reported once, also for `per joint` declarations.
fn declared_units(symbols: &Symbols<'_>, diag: &mut Diagnostics) -> Vec<Option<Unit>> {
    let mut silent = Diagnostics::new();
    let params = symbols.params.iter().map(|p| match p.origin {
        Origin::Declared(d) => units::unit(&d.unit, diag),
        Origin::PerJoint { decl, nth: 0, .. } => units::unit(&decl.unit, diag),
        Origin::PerJoint { decl, .. } => units::unit(&decl.unit, &mut silent),
        Origin::Free { entry, about, .. } => Some(match (entry, about) {
            (0, _) => Unit::of(&[("kg", 1)]),
            (1..=3, About::Com) => Unit::of(&[("m", 1)]),
            (1..=3, About::Origin) => Unit::of(&[("kg", 1), ("m", 1)]),
            _ => Unit::of(&[("kg", 1), ("m", 2)]),
        }),
    });
    params.collect()
}

fn input_units(symbols: &Symbols<'_>, diag: &mut Diagnostics) -> Vec<Option<Unit>> {
    let mut known: Vec<(&InputDecl, Option<Unit>)> = Vec::new();
    let mut out = Vec::new();
    for u in &symbols.inputs {
        let unit = match known.iter().find(|k| std::ptr::eq(k.0, u.decl)) {
            Some(k) => k.1.clone(),
            None => {
                let unit = units::unit(&u.decl.unit, diag);
                known.push((u.decl, unit.clone()));
                unit
            }
        };
        out.push(unit);
    }
    out
}
