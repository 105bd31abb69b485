//! The tree: every link hangs on exactly one joint, every chain of joints starts at the base.

use pid_derive::model::Robot;

use crate::diag::{Diagnostics, nearest};
use crate::syntax::{Ast, JointDecl};

use super::resolved::Resolved;

/// Connects joints and links and orders the joints from the base outwards. `None` after an error.
pub fn check(ast: &Ast, mut resolved: Resolved, diag: &mut Diagnostics) -> Option<Resolved> {
    if ast.is_bare() {
        return Some(resolved);
    }
    let robot = &mut resolved.robot;
    let names: Vec<String> = robot.links.iter().map(|l| l.name.clone()).collect();
    let decls: Vec<&JointDecl> = ast.joints.iter().collect();
    let before = diag.count();

    let carrier = carriers(robot, &names, &decls, diag);
    if diag.count() > before {
        return None;
    }
    find_loops(&resolved, &carrier, &decls, diag);
    let robot = &mut resolved.robot;
    for (k, joint) in carrier.iter().enumerate() {
        if joint.is_none() {
            diag.error(
                &resolved.places.links[k],
                format!(
                    "link `{0}` is not connected to `base`\nhelp: add a joint whose child is `{0}`",
                    names[k]
                ),
            );
        }
    }
    if robot.nq() == 0 {
        diag.error(
            &ast.name,
            format!(
                "robot `{}` has no moving joint\nhelp: declare one, such as `joint j1: revolute about z {{ base -> link1; }}`",
                ast.name
            ),
        );
    }
    if diag.count() > before {
        return None;
    }
    order(robot, &carrier)?;
    Some(resolved)
}

/// Gives every joint its links, and returns the joint that carries each link.
fn carriers(
    robot: &mut Robot,
    names: &[String],
    decls: &[&JointDecl],
    diag: &mut Diagnostics,
) -> Vec<Option<usize>> {
    let find = |name: &proc_macro2::Ident| names.iter().position(|l| name == l);
    let mut carrier: Vec<Option<usize>> = vec![None; names.len()];
    for (j, d) in decls.iter().enumerate() {
        let mut known = |ident: &proc_macro2::Ident| {
            let found = find(ident);
            if found.is_none() {
                unknown_link(d, ident, names, diag);
            }
            found
        };
        let parent = match d.parent == "base" {
            true => None,
            false => known(&d.parent),
        };
        if d.child == "base" {
            diag.error(
                &d.child,
                format!(
                    "joint `{}` ends at `base`, which does not move\nhelp: write `base -> {}`",
                    d.name, d.parent
                ),
            );
            continue;
        }
        let Some(child) = known(&d.child) else {
            continue;
        };
        robot.joints[j].parent = parent;
        robot.joints[j].child = child;
        match carrier[child] {
            None => carrier[child] = Some(j),
            Some(first) => {
                let of = &decls[first];
                diag.error2(
                    &d.name,
                    format!(
                        "link `{}` already has parent `{}` (joint `{}`); closed loops are not supported",
                        d.child, of.parent, of.name
                    ),
                    &of.name,
                    format!("joint `{}` is declared here", of.name),
                );
            }
        }
    }
    carrier
}

/// Orders the joints from the base outwards. `None` where a loop, reported already, has no order.
fn order(robot: &mut Robot, carrier: &[Option<usize>]) -> Option<()> {
    while robot.order.len() < robot.joints.len() {
        let done = robot.order.len();
        for j in 0..robot.joints.len() {
            let ready = match robot.joints[j].parent.map(|l| carrier[l]) {
                None => true,
                Some(above) => above.is_some_and(|a| robot.order.contains(&a)),
            };
            if ready && !robot.order.contains(&j) {
                robot.order.push(j);
            }
        }
        if robot.order.len() == done {
            return None;
        }
    }
    Some(())
}

fn unknown_link(
    d: &JointDecl,
    ident: &proc_macro2::Ident,
    links: &[String],
    diag: &mut Diagnostics,
) {
    let candidates = links.iter().map(String::as_str).chain(["base"]);
    let help = match nearest(&ident.to_string(), candidates) {
        Some(n) => format!("did you mean `{n}`?"),
        None => format!("declare it: `link {ident} {{ mass: …; com: […]; inertia at com: …; }}`"),
    };
    diag.error(
        ident,
        format!(
            "joint `{}` refers to link `{ident}`, which is not declared\nhelp: {help}",
            d.name
        ),
    );
}

/// Reports each loop once, at its first joint in declaration order.
fn find_loops(
    resolved: &Resolved,
    carrier: &[Option<usize>],
    decls: &[&JointDecl],
    diag: &mut Diagnostics,
) {
    let joints = &resolved.robot.joints;
    let above = |j: usize| joints[j].parent.and_then(|l| carrier[l]);
    let mut reported = vec![false; joints.len()];
    for start in 0..joints.len() {
        let mut path = vec![start];
        let mut at = start;
        while let Some(next) = above(at) {
            if next == start || path.contains(&next) {
                break;
            }
            path.push(next);
            at = next;
        }
        let closes = above(at) == Some(start);
        if !closes || path.iter().any(|&j| reported[j]) {
            continue;
        }
        for &j in &path {
            reported[j] = true;
        }
        // From the base outwards reads better than from the tip inwards.
        let mut names: Vec<String> = path
            .iter()
            .rev()
            .map(|&j| decls[j].name.to_string())
            .collect();
        names.rotate_right(1);
        names.push(names[0].clone());
        let first = &decls[start].name;
        diag.error(
            first,
            format!(
                "joints `{}` form a loop that does not start at `base`\nhelp: one of them must have `base` or a link outside of the loop as parent",
                names.join(" -> ")
            ),
        );
    }
}
