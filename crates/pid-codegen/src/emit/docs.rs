//! Documentation of the generated items: the user's words, then the facts of the macro.

use pid_symbolic::Cost;
use proc_macro2::TokenStream;
use quote::quote;

use super::bodies::{Bodies, Body, Linear, cost, formulas};
use super::functions::Function;
use pid_derive::identifiability::Structure;
use pid_derive::model::{Input, Joint, JointKind, Param, Robot};
use pid_derive::{Equations, Identifiability};

/// `#[doc]` attributes of lines.
pub fn attributes(lines: &[String]) -> TokenStream {
    // As rustdoc has it from `///`: one space before the text.
    let lines = lines.iter().map(|line| {
        if line.is_empty() || line.starts_with(' ') {
            line.clone()
        } else {
            format!(" {line}")
        }
    });
    quote!(#(#[doc = #lines])*)
}

/// A line with the operations of a function, to end its documentation.
pub fn operations(function: &Function) -> TokenStream {
    operations_of(&function.cost)
}

/// As [`operations`], of a count.
pub fn operations_of(cost: &Cost) -> TokenStream {
    let text = format!(" Operations: {cost}.");
    quote!(#[doc = ""] #[doc = #text])
}

/// First line of the user's documentation, without the leading space; empty if there is none.
pub fn first_line(docs: &[String]) -> &str {
    docs.first().map_or("", |line| line.trim())
}

fn range(lower: f64, upper: f64) -> String {
    match (lower.is_finite(), upper.is_finite()) {
        (true, true) => format!("{lower} … {upper}"),
        (true, false) => format!("≥ {lower}"),
        (false, true) => format!("≤ {upper}"),
        (false, false) => "unbounded".to_owned(),
    }
}

/// Documentation of a parameter's field.
pub fn param(param: &Param) -> Vec<String> {
    let mut lines = param.docs.clone();
    if !lines.is_empty() {
        lines.push(String::new());
    }
    let held = if param.fixed {
        "; held by identifications"
    } else {
        ""
    };
    lines.push(format!(
        "Unit `{}`, nominal {}, range {}{held}.",
        param.unit,
        param.nominal,
        range(param.lower, param.upper)
    ));
    lines
}

/// Documentation of an input's field.
pub fn input(input: &Input) -> Vec<String> {
    let mut lines = input.docs.clone();
    if !lines.is_empty() {
        lines.push(String::new());
    }
    lines.push(format!("Unit `{}`.", input.unit));
    lines
}

/// Documentation of a joint's variant.
pub fn joint(joint: &Joint) -> Vec<String> {
    let mut lines = joint.docs.clone();
    if !lines.is_empty() {
        lines.push(String::new());
    }
    let coord = joint.coord.unwrap_or_default();
    lines.push(format!("Coordinate {coord}: {}.", kind(joint)));
    lines
}

fn kind(joint: &Joint) -> String {
    let about = |axis: [f64; 3]| match axis {
        [1.0, 0.0, 0.0] => "x".to_owned(),
        [0.0, 1.0, 0.0] => "y".to_owned(),
        [0.0, 0.0, 1.0] => "z".to_owned(),
        [x, y, z] => format!("({x}, {y}, {z})"),
    };
    match joint.kind {
        JointKind::Revolute(axis) => format!("revolute about {}", about(axis)),
        JointKind::Prismatic(axis) => format!("prismatic along {}", about(axis)),
        JointKind::Fixed => "fixed".to_owned(),
        JointKind::Angle => "an angle".to_owned(),
        JointKind::Length => "a length".to_owned(),
    }
}

/// Documentation of the robot's type: the user's text, tables of joints and parameters, sizes,
/// operation counts.
pub fn robot(
    robot: &Robot,
    equations: &Equations,
    bodies: &Bodies,
    jacobian: Option<&Body>,
    hessian: Option<&Body>,
    found: &Identifiability,
    linear: Option<&Linear>,
) -> Vec<String> {
    let mut lines = robot.docs.clone();
    if lines.is_empty() {
        lines.push(format!("The robot `{}`.", robot.name));
    }
    lines.push(String::new());
    lines.push("`r(q, v, a, u, p) = M(q, p) a + b(q, v, p) − f_L(q, v, p, u)`".into());
    joints(robot, &mut lines);
    inputs(robot, &mut lines);
    parameters(robot, &mut lines);
    operation_counts(bodies, jacobian, hessian, linear, &mut lines);
    lines.push(String::new());
    lines.push(match equations.newton_euler {
        Some(newton_euler) => format!(
            "Equations by {} (r: {} operations by Euler-Lagrange, {} by Newton-Euler; both agree).",
            equations.derivation,
            equations.lagrange.total(),
            newton_euler.total()
        ),
        None => "Equations by Euler-Lagrange from the Lagrangian as declared.".to_owned(),
    });
    lines.extend(identifiability(robot, found));
    if let Some((linear, base)) = linear.and_then(|l| Some((&l.regressor, l.base.as_ref()?))) {
        lines.push(String::new());
        lines.push(format!(
            "The torques depend on {} of the parameters linearly, and on them only through {} base parameters:",
            linear.params.len(),
            base.terms.len()
        ));
        lines.push(String::new());
        for formula in formulas(robot, linear, base) {
            lines.push(format!("- `{formula}`"));
        }
    }
    lines
}

/// The table of joints, in the order of their coordinates.
fn joints(robot: &Robot, lines: &mut Vec<String>) {
    let mut line = |text: String| lines.push(text);
    line(String::new());
    line("| coordinate | joint | kind |".into());
    line("|---|---|---|".into());
    let mut moving: Vec<&Joint> = robot
        .joints
        .iter()
        .filter(|joint| joint.coord.is_some())
        .collect();
    moving.sort_by_key(|joint| joint.coord);
    for (coord, joint) in moving.into_iter().enumerate() {
        line(format!("| {coord} | `{}` | {} |", joint.name, kind(joint)));
    }
}

/// The table of inputs, if there are some.
fn inputs(robot: &Robot, lines: &mut Vec<String>) {
    if robot.inputs.is_empty() {
        return;
    }
    let mut line = |text: String| lines.push(text);
    line(String::new());
    line("| input | unit | meaning |".into());
    line("|---|---|---|".into());
    for input in &robot.inputs {
        line(format!(
            "| `{}` | `{}` | {} |",
            input.name,
            input.unit,
            first_line(&input.docs)
        ));
    }
}

/// The table of parameters, if there are some.
fn parameters(robot: &Robot, lines: &mut Vec<String>) {
    if robot.params.is_empty() {
        return;
    }
    let mut line = |text: String| lines.push(text);
    line(String::new());
    line("| parameter | unit | nominal | range | meaning |".into());
    line("|---|---|---|---|---|".into());
    for param in &robot.params {
        let fixed = if param.fixed { " (fixed)" } else { "" };
        line(format!(
            "| `{}` | `{}` | {}{fixed} | {} | {} |",
            param.name,
            param.unit,
            param.nominal,
            range(param.lower, param.upper),
            first_line(&param.docs)
        ));
    }
}

/// The table of generated functions: how many values each has and how many operations it costs.
fn operation_counts(
    bodies: &Bodies,
    jacobian: Option<&Body>,
    hessian: Option<&Body>,
    linear: Option<&Linear>,
    lines: &mut Vec<String>,
) {
    let mut line = |text: String| lines.push(text);
    line(String::new());
    line("| function | values | operations |".into());
    line("|---|---|---|".into());
    for (name, function) in bodies.table() {
        line(format!(
            "| {name} | {} | {} |",
            function.outputs, function.cost
        ));
    }
    if let Some(linear) = linear {
        for (name, function) in linear.bodies.table() {
            line(format!(
                "| {name} | {} | {} |",
                function.outputs, function.cost
            ));
        }
        if let Some(base) = &linear.base {
            line(format!(
                "| base parameters | {} | {} |",
                base.constant,
                cost(base)
            ));
        }
    }
    for (name, body) in [("r and ∂r/∂z", jacobian), ("∂²(λᵀr)/∂z²", hessian)] {
        if let Some(body) = body {
            line(format!(
                "| {name} | {} non-zeros | {} |",
                body.entries.len(),
                body.function.cost
            ));
        }
    }
}

/// Ranks, and the groups of parameters that no motion tells apart.
fn identifiability(robot: &Robot, found: &Identifiability) -> Vec<String> {
    let mut lines = Vec::new();
    if robot.params.is_empty() {
        return lines;
    }
    let ranks = |generic: &Structure, nominal: &Structure| {
        let at_nominal = if nominal.rank == generic.rank {
            String::new()
        } else {
            format!(" ({} at the nominal values)", nominal.rank)
        };
        format!(
            "the motion determines {} combinations of {} parameters{at_nominal}",
            generic.rank,
            generic.params.len()
        )
    };
    let (all, free) = (&found.all, &found.free);
    let mut text = format!(
        "Structural identifiability: {}",
        ranks(&all.generic, &all.nominal)
    );
    if free.generic.params.len() < all.generic.params.len() {
        text += &format!(
            "; with the fixed ones known, {}",
            ranks(&free.generic, &free.nominal)
        );
    }
    lines.push(String::new());
    lines.push(text + ".");
    let mut list = |title: &str, structure: &Structure| {
        if structure.groups.is_empty() {
            return;
        }
        lines.push(String::new());
        if !title.is_empty() {
            lines.push(title.to_owned());
            lines.push(String::new());
        }
        for group in &structure.groups {
            let text = group.text(|k| robot.params[k].name.clone());
            lines.push(format!("- {text}"));
        }
    };
    list("", &free.generic);
    if free.nominal.rank < free.generic.rank {
        list("At the nominal values:", &free.nominal);
    }
    lines
}
