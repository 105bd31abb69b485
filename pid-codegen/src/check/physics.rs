//! Physics: what only the derived equations, or the laws as a whole, can tell.

use crate::diag::{Diagnostics, Loc};
use crate::syntax::{Ast, Expr, ExprKind};

use super::Resolved;

/// Reports functions without second derivatives where these are asked for.
pub fn check(ast: &Ast, resolved: &Resolved, diag: &mut Diagnostics) {
    if !resolved.robot.emit.second_derivatives {
        return;
    }
    let laws = ast
        .per_joint
        .iter()
        .flat_map(|b| b.force.iter().chain(&b.armature));
    for e in laws.chain(ast.forces.iter().map(|f| &f.force)) {
        refuse_kinks(e, diag);
    }
}

fn refuse_kinks(e: &Expr, diag: &mut Diagnostics) {
    match &e.kind {
        ExprKind::Call(f, args) => {
            if f == "abs" || f == "sign" {
                let smooth = match f == "sign" {
                    true => "`tanh(k*v)`",
                    false => "`v*tanh(k*v)`",
                };
                diag.error(
                    Loc::from(f),
                    format!("`{f}` has no second derivative, and `second_derivatives` are emitted\nhelp: use {smooth}, or write `emit {{ dynamics, first_derivatives }}`"),
                );
            }
            for a in args {
                refuse_kinks(a, diag);
            }
        }
        ExprKind::Neg(x) | ExprKind::Pow(x, _) => refuse_kinks(x, diag),
        ExprKind::Binary(_, _, a, b) => {
            refuse_kinks(a, diag);
            refuse_kinks(b, diag);
        }
        ExprKind::Number(..) | ExprKind::Name(_) | ExprKind::Member(..) => {}
    }
}
