//! From `robot!` tokens to straight-line Rust: parsing, checks, emission; the derivation between them is `pid-derive`.
//!
//! ```text
//! tokens -> syntax::Ast -> check -> pid_derive::model::Robot -> pid_derive -> emit -> tokens
//!           (places)               (indices only)
//! ```
//!
//! The pipeline is an ordinary library because a procedural macro cannot be called from tests; `pid-macros` is its shell.
//! Expansion is pure: the same tokens give the same output, no files, no environment. The one exception is a robot `from urdf`,
//! whose file is an input like the tokens.

pub mod check;
pub mod diag;
pub mod emit;
mod from_urdf;
pub mod si;
pub mod syntax;

use std::path::Path;

use proc_macro2::TokenStream;

use check::Resolved;
use diag::Diagnostics;

/// The robots that the contents of a `robot! { … }` declare, checked.
///
/// # Errors
/// The messages of a declaration with mistakes, each with line and column where places are known.
pub fn robots(input: TokenStream) -> Result<Vec<pid_derive::model::Robot>, Vec<String>> {
    let mut diag = Diagnostics::new();
    let resolved = syntax::parse(input, &mut diag)
        .filter(|_| diag.is_ok())
        .and_then(|ast| check::resolve(&ast, &mut diag));
    match resolved {
        Some(resolved) => Ok(vec![resolved.robot]),
        None => Err(diag.located()),
    }
}

/// Expands the contents of `robot! { … }`.
///
/// A declaration with mistakes gives `compile_error!`s at the tokens to change and the types of the robot with the names
/// that were accepted, so that its uses do not fail as well.
///
/// A robot `from urdf` is read from a file below the folder of the crate that is being compiled.
pub fn expand(input: TokenStream) -> TokenStream {
    let folder = std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default();
    expand_in(input, folder.as_ref())
}

/// As [`expand`], with the folder that paths of files are relative to.
pub fn expand_in(input: TokenStream, folder: &Path) -> TokenStream {
    if from_urdf::is_meant(&input) {
        return from_urdf::expand(input, folder);
    }
    let mut diag = Diagnostics::new();
    let Some(ast) = syntax::parse(input, &mut diag) else {
        return diag.errors_to_tokens();
    };
    let resolved = match diag.is_ok() {
        true => check::resolve(&ast, &mut diag),
        false => None,
    };
    let Some(Resolved {
        robot,
        places,
        identifiability,
    }) = resolved
    else {
        return emit::fallback::fallback(&ast, &diag);
    };
    let moving = |j: &usize| robot.joints[*j].coord.is_some();
    let names = emit::Names {
        vis: ast.visibility(),
        robot: ast.name.clone(),
        joints: (0..robot.joints.len())
            .filter(moving)
            .map(|j| places.joints[j].clone())
            .collect(),
        params: places.params,
        inputs: places.inputs,
    };
    match emit::try_model(&robot, &names, &identifiability) {
        Ok(mut tokens) => {
            tokens.extend(diag.warnings_to_tokens(&ast.attrs));
            tokens
        }
        Err(e) => {
            diag.error(&ast.name, e);
            emit::fallback::fallback(&ast, &diag)
        }
    }
}
