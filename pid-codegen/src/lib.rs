//! From `robot!` tokens to straight-line Rust: parsing, checks, derivation, emission.
//!
//! ```text
//! tokens -> syntax::Ast -> check -> model::Robot -> derive -> emit -> tokens
//!           (places)               (indices only)
//! ```
//!
//! The pipeline is an ordinary library because a procedural macro cannot be called from tests; `pid-macros` is its shell.
//! Expansion is pure: the same tokens give the same output, no files, no environment.

pub mod check;
pub mod derive;
pub mod diag;
pub mod model;
pub mod si;
pub mod syntax;
