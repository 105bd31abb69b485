//! Structural identifiability: the expected rank, and groups of parameters that no motion tells
//! apart.

use crate::diag::Diagnostics;
use crate::syntax::Ast;
use pid_derive::Identifiability;
use pid_derive::identifiability::{GroupKind, Structure};
use pid_derive::model::Robot;

use super::physics::is_free;
use super::resolved::Resolved;

/// Computes the rank, compares it with `expect rank`, and warns of groups of declared parameters
/// that enter only through combinations. Parameters of `inertial: free` are never all identifiable,
/// so groups with one of them appear in the docs only.
pub(super) fn check(ast: &Ast, mut resolved: Resolved, diag: &mut Diagnostics) -> Resolved {
    if !diag.is_ok() {
        return resolved;
    }
    let found = match pid_derive::identifiability(&resolved.robot) {
        Ok(found) => found,
        Err(error) => {
            diag.error(&ast.name, error);
            return resolved;
        }
    };
    let robot = &resolved.robot;
    expected(ast, robot, &found, diag);
    if ast.expect.is_empty() {
        for group in &found.free.generic.groups {
            let declared = group
                .params
                .iter()
                .chain(&group.touched)
                .all(|&k| !robot.links.iter().any(|l| is_free(&l.inertial, k)));
            if declared && group.kind != GroupKind::NoEffect {
                let text = group.text(|k| robot.params[k].name.clone());
                let fewer = match group.kind {
                    GroupKind::CommonFactor => "mark one of them `fixed`",
                    _ => "declare fewer, mark some `fixed`",
                };
                diag.warn(
                    resolved.places.param_decls[group.params[0]],
                    format!(
                        "{text}: no motion tells them apart\nhelp: {fewer}, or write `expect rank {};`",
                        found.free.generic.rank
                    ),
                );
            }
        }
    }
    resolved.identifiability = found;
    resolved
}

/// Compares the ranks with those that `expect` states.
pub(super) fn expected(ast: &Ast, robot: &Robot, found: &Identifiability, diag: &mut Diagnostics) {
    for expect in &ast.expect {
        let (structure, place) = match expect.nominal {
            true => (&found.free.nominal, " at the nominal values"),
            false => (&found.free.generic, ""),
        };
        if structure.rank != expect.rank {
            diag.error(
                expect.number,
                format!(
                    "expected rank {}, found {} of {} parameters{place}{}\nhelp: write `expect rank {}{};` if that is meant",
                    expect.rank,
                    structure.rank,
                    structure.params.len(),
                    listed(robot, structure),
                    structure.rank,
                    if expect.nominal { " at nominal" } else { "" },
                ),
            );
        }
    }
}

/// One line per group, for the message of a rank that differs.
fn listed(robot: &Robot, structure: &Structure) -> String {
    structure
        .groups
        .iter()
        .map(|group| format!("\n  {}", group.text(|k| robot.params[k].name.clone())))
        .collect()
}
