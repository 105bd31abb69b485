//! The book in `docs`: its catalogue of effects is written from the library, its Rust code runs as
//! tests of this crate's documentation, and its links are checked.
//!
//! `cargo run --release -p pid-book` writes `docs/book/effects`; a test fails where that was forgotten.
//! `mdbook build docs` makes the pages.

use std::path::PathBuf;

mod catalogue;
mod curves;
mod draw;
mod reference;
mod stage;
mod views;

pub use catalogue::{File, contents, files};

/// What went wrong, with the mend.
#[derive(Debug)]
pub struct Failure(pub(crate) String);

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Failure {}

/// The folder `docs` of the project.
pub fn docs() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../docs")
}

/// The chapters whose code is run.
#[cfg(doctest)]
mod chapters {
    #[doc = include_str!("../../../docs/book/first-robot.md")]
    mod first_robot {}
    #[doc = include_str!("../../../docs/book/equations.md")]
    mod equations {}
    #[doc = include_str!("../../../docs/book/program.md")]
    mod program {}
    #[doc = include_str!("../../../docs/book/own-effect.md")]
    mod own_effect {}
}
