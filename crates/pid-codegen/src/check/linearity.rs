//! Checks that a regressor exists if one is asked for.

use crate::diag::{Diagnostics, Loc};
use crate::syntax::Ast;
use pid_derive::model::{Expr, Inertial, Link};
use pid_symbolic::Graph;

use super::resolved::Resolved;

/// Reports parameters in which the torques are not linear, with the link that has them.
pub(super) fn check(ast: &Ast, resolved: &Resolved, diag: &mut Diagnostics) {
    let asked = ast.emit.as_ref().and_then(|e| {
        let regressor = e.regressor.map(|at| ("regressor", at));
        regressor.or(e.base.map(|at| ("base_parameters", at)))
    });
    let Some((item, at)) = asked.filter(|_| diag.is_ok()) else {
        return;
    };
    let robot = &resolved.robot;
    let mut g = Graph::new();
    // Equations that cannot be derived are reported elsewhere, at the place where they are written.
    let Ok(equations) = pid_derive::equations(&mut g, robot) else {
        return;
    };
    let Err(found) = pid_derive::regressor(&mut g, &equations) else {
        return;
    };
    let (first, second) = (
        &robot.params[found.first].name,
        &robot.params[found.second].name,
    );
    let what = match first == second {
        true => format!("they are not in `{first}`"),
        false => format!("a product of `{first}` and `{second}` enters them"),
    };
    let message =
        format!("`{item}` needs torques linear in the parameters of the links, but {what}");
    let link = robot
        .links
        .iter()
        .position(|link| mentions(link, found.first) || mentions(link, found.second));
    let (other, note): (Loc, String) = match link {
        Some(k) => (
            (&resolved.places.links[k]).into(),
            format!(
                "link `{}` has mass, centre of mass and inertia as parameters of their own\nhelp: write `inertial: free;`, or drop `{item}`",
                robot.links[k].name
            ),
        ),
        None => (
            resolved.places.param_decls[found.second].into(),
            format!("`{second}` is declared here\nhelp: replace it by a number, or drop `{item}`"),
        ),
    };
    diag.error2(at, message, other, note);
}

/// Whether a parameter is in the mass distribution of a link.
fn mentions(link: &Link, param: usize) -> bool {
    let (mass, middle, inertia) = match &link.inertial {
        Inertial::Body {
            mass, com, inertia, ..
        } => (mass, com, inertia),
        Inertial::Linear {
            mass,
            first_moment,
            inertia,
        } => (mass, first_moment, inertia),
        Inertial::None => return false,
    };
    let i = inertia;
    [mass, &i.xx, &i.yy, &i.zz, &i.xy, &i.xz, &i.yz]
        .into_iter()
        .chain(middle)
        .any(|e| reads(e, param))
}

fn reads(e: &Expr, param: usize) -> bool {
    match e {
        Expr::Param(k) => *k == param,
        Expr::Neg(x) | Expr::Powi(x, _) | Expr::Call(_, x) => reads(x, param),
        Expr::Add(x, y) | Expr::Sub(x, y) | Expr::Mul(x, y) | Expr::Div(x, y) => {
            reads(x, param) || reads(y, param)
        }
        Expr::Num(_) | Expr::Input(_) | Expr::Position(_) | Expr::Velocity(_) | Expr::Blank(_) => {
            false
        }
    }
}
