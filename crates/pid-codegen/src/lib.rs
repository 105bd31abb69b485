//! From `robot!` tokens to straight-line Rust: parsing, checks, emission; the derivation between
//! them is `pid-derive`.
//!
//! ```text
//! tokens -> syntax::Ast -> check -> pid_derive::model::Robot -> pid_derive -> emit -> tokens
//!           (places)               (indices only)
//! ```
//!
//! The pipeline is an ordinary library because a procedural macro cannot be called from tests;
//! `pid-macros` is its shell. Expansion is pure: the same tokens give the same output, no files, no
//! environment. The one exception is a robot `from urdf`, whose file is an input like the tokens.

pub mod check;
pub mod diag;
pub mod emit;
mod from_urdf;
#[cfg(feature = "show")]
pub mod show;
pub mod si;
pub mod syntax;

use std::path::Path;

use proc_macro2::TokenStream;

use check::Resolved;
use diag::Diagnostics;
pub use emit::Face;
use syntax::Ast;

/// The robots that the contents of a `robot! { … }` declare, checked.
///
/// # Errors
/// The messages of a declaration with mistakes, each with line and column where places are known.
pub fn robots(input: TokenStream) -> Result<Vec<pid_derive::model::Robot>, Vec<String>> {
    let mut diag = Diagnostics::new();
    let resolved = syntax::parse(input, &mut diag)
        .filter(|_| diag.is_ok())
        .and_then(|ast| models(&ast, &mut diag));
    match resolved {
        Some(models) => Ok(models.into_iter().map(|m| m.0.robot).collect()),
        None => Err(diag.located()),
    }
}

/// Expands the contents of `robot! { … }`.
///
/// A declaration with mistakes gives `compile_error!`s at the tokens to change and the types of the
/// robot with the names that were accepted, so that its uses do not fail as well.
///
/// A robot `from urdf` is read from a file below the folder of the crate that is being compiled.
pub fn expand(input: TokenStream) -> TokenStream {
    expand_for(input, Face::Full)
}

/// As [`expand`], for one face.
pub fn expand_for(input: TokenStream, face: Face) -> TokenStream {
    let folder = std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default();
    expanded(input, folder.as_ref(), face)
}

/// As [`expand`], with the folder that paths of files are relative to.
pub fn expand_in(input: TokenStream, folder: &Path) -> TokenStream {
    expanded(input, folder, Face::Full)
}

fn expanded(input: TokenStream, folder: &Path, face: Face) -> TokenStream {
    if syntax::is_from_urdf(&input) {
        return from_urdf::expand(input, folder, face);
    }
    let mut diag = Diagnostics::new();
    let Some(ast) = syntax::parse(input, &mut diag) else {
        return diag.errors_to_tokens();
    };
    let models = match diag.is_ok() {
        true => models(&ast, &mut diag),
        false => None,
    };
    let Some(models) = models else {
        return emit::fallback::fallback(&ast, &diag, face);
    };
    let mut tokens = TokenStream::new();
    let limit = ast.limit.unwrap_or(emit::size::DEFAULT_LIMIT);
    for (k, (resolved, names)) in models.into_iter().enumerate() {
        let names = emit::Names { face, ..names };
        match emit::try_model(&resolved.robot, &names, &resolved.identifiability, limit) {
            Ok(model) => tokens.extend(model),
            Err(e) => {
                // A variant without an `emit` of its own has that of the robot.
                let own = k.checked_sub(1).and_then(|k| ast.variants[k].emit.as_ref());
                let place = e.place(own.or(ast.emit.as_ref()));
                diag.error(place.unwrap_or(names.robot.span()), e);
            }
        }
    }
    if !diag.is_ok() {
        return emit::fallback::fallback(&ast, &diag, face);
    }
    tokens.extend(diag.warnings_to_tokens(&ast.attrs));
    tokens
}

/// The robot, then its variants, with their identifiers. `None` after an error.
fn models(ast: &Ast, diag: &mut Diagnostics) -> Option<Vec<(Resolved, emit::Names)>> {
    let robot = check::resolve(ast, diag)?;
    let own = names(ast, &robot);
    let mut out = vec![(robot, own)];
    for k in 0..ast.variants.len() {
        let held = ast.variant(k);
        // Warnings of the description have been given with the robot.
        let mut own = Diagnostics::of_variant(&held.name);
        let resolved = check::resolve(&held, &mut own);
        diag.extend_errors(own);
        if let Some(resolved) = resolved {
            let names = names(&held, &resolved).without_places();
            out.push((resolved, names));
        }
    }
    diag.is_ok().then_some(out)
}

fn names(ast: &Ast, Resolved { robot, places, .. }: &Resolved) -> emit::Names {
    let moving = |j: &usize| robot.joints[*j].coord.is_some();
    emit::Names {
        face: Face::Full,
        vis: ast.visibility(),
        robot: ast.name.clone(),
        joints: (0..robot.joints.len())
            .filter(moving)
            .map(|j| places.joints[j].clone())
            .collect(),
        params: places.params.clone(),
        inputs: places.inputs.clone(),
    }
}
