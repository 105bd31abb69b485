//! How joints and motors move with the coordinates: on their own, with others, or held.

use crate::diag::Diagnostics;
use crate::si::Unit;
use crate::syntax::{Expr, Motion};
use pid_derive::model::{self, Affine};

use super::meaning::Scope;
use super::moves::Moves;
use super::names::Symbols;
use super::numbers::{constant, plus, times};
use super::units::{Role, Units};

/// Finds the motions of all joints and motors and hands them to `units`. Those with errors stay unknown.
pub(super) fn resolve(symbols: &Symbols<'_>, units: &mut Units<'_>, diag: &mut Diagnostics) {
    for (j, symbol) in symbols.joints.iter().enumerate() {
        let length = match &symbol.decl.motion {
            Motion::Fixed => continue,
            Motion::Revolute(_) => false,
            Motion::Prismatic(_) => true,
            Motion::Coordinate(unit) => {
                let Some(unit) = super::units::unit(unit, &mut Diagnostics::new()) else {
                    continue;
                };
                unit.same_dims(&Unit::of(&[("m", 1)]))
            }
        };
        units.moves[j] = match (symbol.coord, symbol.lock) {
            (Some(coord), _) => Some(Moves::own(coord, length)),
            (None, Some(value)) => held(symbols, units, j, value, length, diag),
            (None, None) => None,
        };
    }
    for j in 0..symbols.joints.len() + symbols.motors.len() {
        if let Some(e) = symbols.follows(j) {
            units.moves[j] = follower(symbols, units, j, e, diag);
        }
    }
}

fn measure(length: bool) -> Unit {
    Unit::of(&[(if length { "m" } else { "rad" }, 1)])
}

fn held(
    symbols: &Symbols<'_>,
    units: &Units<'_>,
    j: usize,
    value: &Expr,
    length: bool,
    diag: &mut Diagnostics,
) -> Option<Moves> {
    let role = Role {
        what: format!("the position of `{}`", symbols.name(j)),
        unit: measure(length),
    };
    let scope = Scope::Constant("the position of a locked joint");
    let e = units.entry(value, scope, &role, None, diag)?;
    let x = super::units::finite(constant(&e)?, value, diag)?;
    let affine = Affine {
        terms: Vec::new(),
        offset: model::Expr::Num(x),
    };
    Some(Moves::along(affine, length))
}

fn follower(
    symbols: &Symbols<'_>,
    units: &Units<'_>,
    j: usize,
    e: &Expr,
    diag: &mut Diagnostics,
) -> Option<Moves> {
    let name = symbols.name(j);
    let t = units.expr(e, Scope::Coupling, diag)?;
    let (angle, length) = (measure(false), measure(true));
    let is_length = match symbols.joints.get(j).map(|s| &s.decl.motion) {
        Some(motion) => matches!(motion, Motion::Prismatic(_)),
        None => t.unit.same_dims(&length),
    };
    let asked = if is_length { &length } else { &angle };
    if !t.unit.same_dims(asked) {
        let what = match symbols.joints.get(j) {
            Some(_) => format!("what joint `{name}` follows must be in `{asked}`"),
            None => format!("the position of motor `{name}` must be in `rad` or `m`"),
        };
        diag.error(e.loc, format!("{what}, but `{e}` is in `{}`", t.unit));
        return None;
    }
    let mut names = Vec::new();
    super::names::names_in(e, &mut names);
    let Some((terms, offset)) = affine(&t.expr) else {
        diag.error(
            e.loc,
            format!("`{e}` is not a linear combination of joints\nhelp: write `ratio*joint + offset`, such as `-0.5*j2 - j3 + 10 deg`"),
        );
        return None;
    };
    if !names
        .iter()
        .any(|n| symbols.joints.iter().any(|s| s.decl.name == **n))
    {
        let what = match symbols.joints.get(j) {
            Some(_) => format!(
                "joint `{name}` follows no joint\nhelp: name one, or make `{name}` a `fixed` joint"
            ),
            None => format!(
                "motor `{name}` moves no joint\nhelp: name one, such as `motor {name}: j5 + j6 {{ … }}`"
            ),
        };
        diag.error(e.loc, what);
        return None;
    }
    let affine = Affine {
        terms,
        offset: offset.unwrap_or(model::Expr::Num(0.0)),
    };
    Some(Moves::along(affine, is_length))
}

/// Ratios by coordinate, and the offset if there is one.
type Combination = (Vec<(usize, model::Expr)>, Option<model::Expr>);

/// An expression as an affine combination of positions; `None` if it is none.
fn affine(e: &model::Expr) -> Option<Combination> {
    use model::Expr as E;
    Some(match e {
        E::Position(c) => (vec![(*c, E::Num(1.0))], None),
        E::Neg(x) => scaled(affine(x)?, |r| E::Neg(Box::new(r))),
        E::Add(x, y) => added(affine(x)?, affine(y)?),
        E::Sub(x, y) => added(affine(x)?, scaled(affine(y)?, |r| E::Neg(Box::new(r)))),
        E::Mul(x, y) => match (affine(x)?, affine(y)?) {
            ((terms, _), b) if terms.is_empty() => scaled(b, |r| times((**x).clone(), r)),
            (a, (terms, _)) if terms.is_empty() => scaled(a, |r| times(r, (**y).clone())),
            _ => return None,
        },
        E::Div(x, y) => {
            if !affine(y)?.0.is_empty() {
                return None;
            }
            scaled(affine(x)?, |r| E::Div(Box::new(r), y.clone()))
        }
        E::Powi(x, _) | E::Call(_, x) if !affine(x)?.0.is_empty() => return None,
        constant => (Vec::new(), Some(constant.clone())),
    })
}

fn scaled((terms, offset): Combination, f: impl Fn(model::Expr) -> model::Expr) -> Combination {
    (
        terms.into_iter().map(|(c, r)| (c, f(r))).collect(),
        offset.map(&f),
    )
}

fn added((mut terms, offset): Combination, (more, other): Combination) -> Combination {
    for (coord, ratio) in more {
        match terms.iter_mut().find(|t| t.0 == coord) {
            Some(t) => t.1 = plus(t.1.clone(), ratio),
            None => terms.push((coord, ratio)),
        }
    }
    let offset = match (offset, other) {
        (Some(a), Some(b)) => Some(plus(a, b)),
        (a, b) => a.or(b),
    };
    (terms, offset)
}
