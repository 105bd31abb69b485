//! The robots of `pid-models` as they are declared.

use std::path::Path;

use pid_codegen::check::{Resolved, resolve};
use pid_codegen::diag::Diagnostics;
use pid_codegen::syntax;
use pid_derive::model::Robot;
use proc_macro2::TokenStream;

/// The declaration of a robot in a source file of `pid-models`.
pub(crate) fn declared(file: &str) -> Robot {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../models/src")
        .join(file);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let file = syn::parse_file(&text).expect("the file compiles");
    let tokens: TokenStream = file
        .items
        .iter()
        .find_map(|item| match item {
            syn::Item::Macro(item) if item.mac.path.is_ident("robot") => {
                Some(item.mac.tokens.clone())
            }
            _ => None,
        })
        .expect("a declaration with robot!");
    let mut diag = Diagnostics::new();
    let ast = syntax::parse(tokens, &mut diag).expect("the declaration parses");
    let Resolved { robot, .. } = resolve(&ast, &mut diag).expect("the declaration is sound");
    robot
}
