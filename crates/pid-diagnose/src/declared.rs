//! What the diagnosis of a declared robot found as a whole `robot!` declaration (`extended.rs`).

use std::fmt::Write as _;

use pid_codegen::show::{Unsaid, declaration};
use pid_interpret::Model;
use pid_interpret::nominal::{self as description, NominalError};
use pid_runtime::dynamics::Dynamics;

use crate::nominal::Nominal;
use crate::with_effects::{Placed, source, with_masses};

/// An extended model that no declaration states.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DeclaredError {
    /// The model was not declared, or the library does not have an effect as it is stated.
    #[error(transparent)]
    Nominal(#[from] NominalError),
    /// The robot has no equations of motion.
    #[error(transparent)]
    Model(#[from] pid_interpret::Error),
    /// The language cannot state it.
    #[error(transparent)]
    Unsaid(#[from] Unsaid),
    /// `robot!` refuses it.
    #[error("`robot!` refuses the extended model:\n{}", .messages.join("\n"))]
    Refused {
        /// The messages of `robot!`.
        messages: Vec<String>,
    },
}

/// A Rust file with the extended model of a declared robot: values as found, effects as force laws
/// and bodies. What no declaration states (states, delays, position loops) stands at its head.
///
/// Drives and, on a tree of links, bodies are those of the diagnosis: friction is
/// `viscous v + coulomb tanh(sharp v)`, and links joined rigidly are one.
///
/// # Errors
/// [`DeclaredError`].
pub fn declared(
    model: &dyn Dynamics,
    extended: &description::Nominal,
) -> Result<String, DeclaredError> {
    let placed = Placed::of(extended)?;
    let written = description::declaration(model).map_err(NominalError::from)?;
    let (mut robot, forces) = match extended.drives() {
        None => with_masses(&Nominal::new(extended.clone()), placed),
        Some(_) => (extended.robot_in_joints(&written), placed),
    };
    robot.docs = vec![format!(
        " `{}` with the values and effects of a diagnosis.",
        model.name()
    )];
    robot.name = format!("{}Extended", model.name());
    // In the coordinates of its drives, which the motors are named after.
    let driven = Model::new(extended.robot())?;
    let (mut items, mut head) = (String::new(), String::new());
    for own in &forces {
        match source(&driven, std::slice::from_ref(own)) {
            Ok(more) => items.push_str(&more),
            Err(_) => {
                let joint = &driven.joints()[own.term.joint].name;
                head.push_str(&unsaid(own, joint));
            }
        }
    }
    for (j, joint) in driven.joints().iter().enumerate() {
        if extended.servo(j).is_some() {
            let _ = writeln!(head, "// Not in it: the position loop of `{}`.", joint.name);
        }
    }
    let text = declaration(&robot, &items)?;
    let tokens = text.parse().map_err(|e| refused(&e))?;
    pid_codegen::robots(tokens).map_err(|messages| DeclaredError::Refused { messages })?;
    let inside: String = text.lines().map(|line| format!("    {line}\n")).collect();
    Ok(format!(
        "{head}use simtrue::robot;\n\nrobot! {{\n{inside}}}\n"
    ))
}

fn refused(error: &impl ToString) -> DeclaredError {
    DeclaredError::Refused {
        messages: vec![error.to_string()],
    }
}

/// A line on an effect that no declaration states.
fn unsaid(own: &Placed, joint: &str) -> String {
    let info = own.term.effect.info();
    let values: Vec<String> = (info.parameters.iter().zip(&own.units).zip(&own.ranges))
        .map(|((p, unit), range)| format!("{} = {:?} {unit}", p.name, range.0))
        .collect();
    let at = match info.has_joint {
        true => format!(" of `{joint}`"),
        false => String::new(),
    };
    format!(
        "// Not in it, as it is no force law: `{}`{at}, {}.\n",
        info.id,
        values.join(", ")
    )
}
