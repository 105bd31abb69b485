//! Physics: checks that need the derived equations, or the laws as a whole.

use crate::diag::{Diagnostics, Loc};
use crate::syntax::{Ast, Expr, ExprKind};
use pid_derive::Facts;
use pid_derive::model::{Inertial, Robot};

use super::resolved::Resolved;

/// Reports wrong `_`, massless tips, functions without second derivatives, parameters and inputs
/// without effect.
pub fn check(ast: &Ast, resolved: &Resolved, diag: &mut Diagnostics) {
    let facts = pid_derive::facts(&resolved.robot);
    let errors = diag.count();
    blanks(resolved, &facts, diag);
    if let (Some(coord), Some(l)) = (facts.velocity_in_mass, &ast.lagrangian) {
        diag.error(
            l.loc,
            format!(
                "the Lagrangian is not quadratic in the velocities: the inertia of coordinate `{}` depends on them\nhelp: write what does not belong to kinetic or potential energy as `force on …`",
                coordinates(&resolved.robot)[coord]
            ),
        );
    } else if diag.count() == errors {
        // A wrong `_` counts as zero in M, so a singular M would report it twice.
        singular_mass(resolved, &facts, diag);
    }
    if resolved.robot.emit.second_derivatives {
        let laws = ast
            .per_joint
            .iter()
            .flat_map(|b| b.force.iter().chain(&b.armature));
        let motors = ast.motors.iter().map(|m| &m.body);
        let motors = motors.flat_map(|b| b.force.iter().chain(&b.armature));
        let energies = ast.potentials.iter().chain(&ast.lagrangian);
        let forces = ast.forces.iter().map(|f| &f.force);
        for e in laws.chain(motors).chain(energies).chain(forces) {
            refuse_kinks(e, diag);
        }
    }
    without_effect(resolved, &facts, diag);
}

/// Names of the moving joints, by coordinate.
fn coordinates(robot: &Robot) -> Vec<&str> {
    robot
        .joints
        .iter()
        .filter(|j| j.coord.is_some())
        .map(|j| j.name.as_str())
        .collect()
}

fn blanks(resolved: &Resolved, facts: &Facts, diag: &mut Diagnostics) {
    let robot = &resolved.robot;
    let names = coordinates(robot);
    // A `_` in a range of links is one place in the text: one report, at its first link.
    let mut reported: Vec<usize> = Vec::new();
    for &(blank, coord) in &facts.blank_violations {
        if reported.contains(&blank) {
            continue;
        }
        reported.push(blank);
        let b = &robot.blanks[blank];
        diag.error(
            resolved.places.blanks[blank],
            format!(
                "`_` stands for {0} of link `{1}`, but {0} enters the equation of joint `{2}`\nhelp: declare a parameter for it, or give its value",
                b.entry, robot.links[b.link].name, names[coord]
            ),
        );
    }
}

fn singular_mass(resolved: &Resolved, facts: &Facts, diag: &mut Diagnostics) {
    let Some(coord) = facts.singular_mass else {
        return;
    };
    let robot = &resolved.robot;
    let Some(j) = robot.joints.iter().position(|j| j.coord == Some(coord)) else {
        return;
    };
    let joint = &robot.joints[j];
    if robot.lagrangian.is_some() {
        diag.error(
            &resolved.places.joints[j],
            format!(
                "coordinate `{}` has no inertia: ∂²L/∂v² is not positive definite at the nominal values\nhelp: the Lagrangian needs its kinetic energy, such as `0.5*m*v.{0}^2`",
                joint.name
            ),
        );
        return;
    }
    let link = &robot.links[joint.child];
    let lacks = match (&link.inertial, joint.kind) {
        (Inertial::None, _) => "has no mass and no inertia",
        (_, pid_derive::model::JointKind::Prismatic(_)) => "has no mass",
        _ => "has no inertia about its axis",
    };
    diag.error(
        &resolved.places.links[joint.child],
        format!(
            "link `{0}` moves with `{1}`, but {lacks}: the mass matrix is singular at the nominal values\nhelp: give `{0}` or a link behind it mass and inertia, or `{1}` an `armature`",
            link.name, joint.name
        ),
    );
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

fn without_effect(resolved: &Resolved, facts: &Facts, diag: &mut Diagnostics) {
    let robot = &resolved.robot;
    for &k in &facts.unused_params {
        let p = &robot.params[k];
        // A free body always has its ten parameters, used or not.
        let free = robot.links.iter().any(|l| is_free(&l.inertial, k));
        if !free {
            diag.warn(
                resolved.places.param_decls[k],
                format!(
                    "parameter `{}` does not enter the equations of motion\nhelp: remove it; where an entry of a link has no effect, write `_` in its place",
                    p.name
                ),
            );
        }
    }
    for &k in &facts.unused_inputs {
        let u = &robot.inputs[k];
        let message = match u.coord.map(|c| coordinates(robot)[c]) {
            Some(joint) => format!(
                "joint `{joint}` has the input `{}`, but no force uses it\nhelp: use it in `force = …`, or remove it",
                u.name
            ),
            None => format!(
                "no force uses the input `{0}`\nhelp: use it in `force on joint = …`, or remove it",
                u.name
            ),
        };
        diag.warn(resolved.places.input_decls[k], message);
    }
}

/// Whether parameter `k` belongs to `inertial: free`.
pub(super) fn is_free(inertial: &Inertial, k: usize) -> bool {
    use pid_derive::model::Expr as E;
    let own = |e: &E| *e == E::Param(k);
    match inertial {
        Inertial::Linear {
            mass,
            first_moment,
            inertia: i,
        } => {
            own(mass)
                || first_moment.iter().any(own)
                || [&i.xx, &i.yy, &i.zz, &i.xy, &i.xz, &i.yz]
                    .into_iter()
                    .any(own)
        }
        _ => false,
    }
}
