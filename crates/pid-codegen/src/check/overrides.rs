//! Values that a declaration gives to the parameters of a robot from a file (`params`).

use crate::diag::{Diagnostics, nearest};
use crate::si::Unit;
use crate::syntax::{Nominal, ParamDecl, Ranges, UnitExpr};
use pid_derive::model::{Param, Robot};

use super::meaning::Scope;
use super::names::{Symbols, twice};
use super::numbers::constant;
use super::units::{self, Role, Units, finite};
use super::uses;

/// Gives parameters the nominal values, ranges and `fixed` of `decls`; what a declaration leaves
/// out stays. Reports names that the robot does not have, other units, and values outside of
/// ranges.
pub(crate) fn apply(decls: &[ParamDecl], robot: &mut Robot, diag: &mut Diagnostics) {
    let symbols = Symbols::default();
    uses::constants(decls.iter(), &symbols, diag);
    let units = Units::new(&symbols, Vec::new(), Vec::new());
    for (k, decl) in decls.iter().enumerate() {
        let earlier = decls[..k].iter().map(|d| &d.name);
        if let Some(first) = earlier.into_iter().find(|first| **first == decl.name) {
            twice(diag, &decl.name, first);
            continue;
        }
        let found = robot.params.iter().position(|p| decl.name == p.name);
        let Some(found) = found else {
            unknown(decl, robot, diag);
            continue;
        };
        one(decl, &units, &mut robot.params[found], diag);
    }
}

fn unknown(decl: &ParamDecl, robot: &Robot, diag: &mut Diagnostics) {
    let names = robot.params.iter().map(|p| p.name.as_str());
    let help = match nearest(&decl.name.to_string(), names) {
        Some(name) => format!("a parameter with a similar name exists: `{name}`"),
        None if robot.params.is_empty() => {
            "it has none: write `inertial: free;` or `friction: free;`".to_string()
        }
        None => format!(
            "its parameters are named as `{}`; masses, friction and rotors are parameters where `inertial`, `friction`, `armature` are `free`",
            robot.params[0].name
        ),
    };
    diag.error(
        &decl.name,
        format!(
            "robot `{}` has no parameter named `{}`\nhelp: {help}",
            robot.name, decl.name
        ),
    );
}

fn one(decl: &ParamDecl, units: &Units<'_>, param: &mut Param, diag: &mut Diagnostics) {
    let Some(unit) = units::unit(&decl.unit, diag) else {
        return;
    };
    if !own_unit(param).is_some_and(|own| own.same_dims(&unit)) {
        diag.error(
            decl.unit.loc,
            format!(
                "`{}` must be in `{}`, found `{}`",
                decl.name, param.unit, decl.unit
            ),
        );
        return;
    }
    let role = Role {
        what: format!("the value of `{}`", decl.name),
        unit: unit.clone(),
    };
    let list = match (&decl.nominal, &decl.range) {
        (Some(Nominal::List(_, at)), _) | (_, Some(Ranges::List(_, at))) => Some(*at),
        _ => None,
    };
    if let Some(at) = list {
        diag.error(
            at,
            format!(
                "`{}` is one parameter, but has a list\nhelp: lists belong to parameters declared `per joint`",
                decl.name
            ),
        );
        return;
    }
    if let Some(Nominal::One(e)) = &decl.nominal {
        let scope = Scope::Constant("a nominal value");
        let value = units.entry(e, scope, &role, Some(&unit), diag);
        let Some(value) = value.and_then(|x| finite(constant(&x)?, e, diag)) else {
            return;
        };
        param.nominal = value;
    }
    if let Some(Ranges::One(r)) = &decl.range {
        let Some((lo, hi)) = units.range(r, &role, Some(&unit), diag) else {
            return;
        };
        if lo > hi {
            let (lo, hi) = (lo / unit.scale, hi / unit.scale);
            diag.error(
                r.loc,
                format!(
                    "empty range {lo}..={hi} for `{}`\nhelp: did you mean `{hi}..={lo}`?",
                    decl.name
                ),
            );
            return;
        }
        (param.lower, param.upper) = (lo, hi);
    }
    if !(param.lower..=param.upper).contains(&param.nominal) {
        let show = |x: f64| x / unit.scale;
        let (at, which) = match (&decl.nominal, &decl.range) {
            (Some(Nominal::One(e)), _) => (e.loc, "nominal value"),
            (_, Some(Ranges::One(r))) => (r.loc, "the file's value"),
            _ => ((&decl.name).into(), "nominal value"),
        };
        diag.error(
            at,
            format!(
                "{which} {} of `{}` is outside {}..={}",
                show(param.nominal),
                decl.name,
                show(param.lower),
                show(param.upper)
            ),
        );
        return;
    }
    param.fixed |= decl.fixed.is_some();
}

/// The unit of a parameter as it is printed.
fn own_unit(param: &Param) -> Option<Unit> {
    let written = UnitExpr::of_text(&param.unit)?;
    units::unit(&written, &mut Diagnostics::new())
}
