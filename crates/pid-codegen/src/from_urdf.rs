//! `pub robot X from urdf "path" { … }`: the robot of a URDF file instead of a declaration.
//!
//! ```text
//! /// docs
//! pub robot Arm from urdf "robots/arm.urdf" {
//!     inertial: free;        // or fixed; free: ten standard parameters per moving body
//!     friction: free;        // or fixed: the numbers of <dynamics>
//!     armature: free;        // rotor_<joint>; without it there is none
//!     gravity: [0, 0, -9.81] m/s^2;
//!     params { viscous_elbow: N*m*s/rad = 0.3 in 0.0..=2.0; }
//!     emit { dynamics, first_derivatives, regressor }
//!     expect rank 14;
//! }
//! ```
//!
//! The path is relative to the folder of the crate's `Cargo.toml`. A constant with the file's
//! contents in the expansion makes the compiler build the crate anew when the file changes.
//! Mistakes in the file are errors on the path, with line and mend.

use std::path::Path;

use pid_derive::Identifiability;
use pid_derive::model::{Expr, Robot};
#[cfg(feature = "urdf")]
use pid_urdf::{Description, Inertias, Options};
use proc_macro2::{Ident, Literal, Span, TokenStream};
use quote::quote;

use crate::check;
use crate::diag::Diagnostics;
use crate::emit::{self, Face, Names};
use crate::syntax::{self, FromUrdf};

/// Expands the declaration; `folder` is that of the crate.
pub(crate) fn expand(input: TokenStream, folder: &Path, face: Face) -> TokenStream {
    let mut diag = Diagnostics::new();
    let Some(declared) = syntax::parse_from_urdf(input, &mut diag) else {
        return diag.errors_to_tokens();
    };
    let text = text(&declared, folder, &mut diag);
    let tracked = text.is_some().then(|| {
        let path = Literal::string(&declared.path);
        quote! {
            const _: &[u8] = ::core::include_bytes!(::core::concat!(::core::env!("CARGO_MANIFEST_DIR"), "/", #path));
        }
    });
    let robot = text.and_then(|text| robot(&declared, &text, &mut diag));
    let found = match &robot {
        Some(robot) if diag.is_ok() => check::rank(&declared.ast, robot, &mut diag),
        _ => None,
    };
    let model = match (&robot, found) {
        (Some(robot), Some(found)) if diag.is_ok() => {
            let names = names(&declared, robot, face);
            model(&declared, robot, &names, &found, &mut diag)
        }
        _ => None,
    };
    let model = match model {
        Some(model) => {
            let warnings = diag.warnings_to_tokens(&declared.ast.attrs);
            quote!(#model #warnings)
        }
        None => {
            let robot = robot.unwrap_or_else(|| emit::fallback::nameless(&declared.ast));
            let stub = emit::fallback::stub_of(&robot, &names(&declared, &robot, face));
            let errors = diag.errors_to_tokens();
            quote!(#errors #stub)
        }
    };
    quote!(#model #tracked)
}

fn model(
    declared: &FromUrdf,
    robot: &Robot,
    names: &Names,
    found: &Identifiability,
    diag: &mut Diagnostics,
) -> Option<TokenStream> {
    let ast = &declared.ast;
    let limit = ast.limit.unwrap_or(emit::size::DEFAULT_LIMIT);
    match emit::try_model(robot, names, found, limit) {
        Ok(tokens) => Some(tokens),
        Err(error) => {
            diag.error(
                error.place(ast.emit.as_ref()).unwrap_or(ast.name.span()),
                error,
            );
            None
        }
    }
}

fn text(declared: &FromUrdf, folder: &Path, diag: &mut Diagnostics) -> Option<String> {
    let path = &declared.path;
    let read = std::fs::read_to_string(folder.join(path));
    read.map_err(|error| {
        diag.error(
            declared.place,
            format!("{path}: cannot be read: {error}\nhelp: the path is relative to the folder of Cargo.toml"),
        );
    })
    .ok()
}

/// The robot of the file as far as it can be read, with the changes of the declaration.
fn robot(declared: &FromUrdf, text: &str, diag: &mut Diagnostics) -> Option<Robot> {
    let (path, ast) = (&declared.path, &declared.ast);
    let mut refuse =
        |message: String| diag.error(declared.place, message.replace("\n  help:", "\nhelp:"));
    let (mut robot, warnings) = read(declared, text).map_err(&mut refuse).ok()?;
    robot.name = ast.name.to_string();
    robot.docs.clone_from(&ast.docs);
    robot.emit = check::emit(ast);
    if robot.nq() == 0 {
        refuse(format!(
            "{path}: no joint moves\nhelp: give a joint that is not fixed"
        ));
    } else if let Some(coord) = pid_derive::facts(&robot).singular_mass {
        let joint = robot.joints.iter().find(|joint| joint.coord == Some(coord));
        refuse(format!(
            "{path}: what joint `{}` moves has no mass and no inertia about its axis\nhelp: give a link that it carries an <inertial>",
            joint.map_or("", |joint| &joint.name)
        ));
    }
    for warning in warnings {
        diag.warn(declared.place, warning);
    }
    if let Some(gravity) = &ast.gravity
        && let Some(given) = check::constant_gravity(gravity, diag)
    {
        robot.gravity = given.map(Expr::Num);
    }
    check::overrides::apply(&ast.params, &mut robot, diag);
    Some(robot)
}

/// The robot of the file as it stands, and warnings.
#[cfg(feature = "urdf")]
fn read(declared: &FromUrdf, text: &str) -> Result<(Robot, Vec<String>), String> {
    let description =
        Description::parse(&declared.path, text).map_err(|error| error.to_string())?;
    let mut options = Options::default();
    options.inertias = match declared.inertial {
        Some(false) => Inertias::Numbers,
        _ => Inertias::Standard,
    };
    options.friction = declared.friction.unwrap_or(options.friction);
    options.armature = declared.armature.unwrap_or(options.armature);
    let robot = pid_urdf::robot(&description, &options).map_err(|error| error.to_string())?;
    Ok((robot, description.warnings))
}

#[cfg(not(feature = "urdf"))]
fn read(declared: &FromUrdf, _: &str) -> Result<(Robot, Vec<String>), String> {
    Err(format!(
        "{}: URDF files need the feature `urdf`\n  help: add it to `simtrue` (or `pid-runtime`) in Cargo.toml: features = [\"urdf\"]",
        declared.path
    ))
}

fn names(declared: &FromUrdf, robot: &Robot, face: Face) -> Names {
    let ident = |text: &str| Ident::new(text, Span::call_site());
    let mut moving: Vec<_> = robot.joints.iter().filter(|j| j.coord.is_some()).collect();
    moving.sort_by_key(|j| j.coord);
    Names {
        face,
        vis: declared.ast.visibility(),
        robot: declared.ast.name.clone(),
        params: robot.params.iter().map(|p| ident(&p.name)).collect(),
        joints: moving.into_iter().map(|j| ident(&j.name)).collect(),
        inputs: robot.inputs.iter().map(|u| ident(&u.name)).collect(),
    }
}
