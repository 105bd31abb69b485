//! Tests of regression and of wrapped models, one program: a program for each file would link the
//! solver as many times.
//!
//! A file alone: `cargo test -p pid-fit --test main FILE::`.

mod closed_loop;
mod common;
mod instruments;
mod likelihood;
mod payload;
mod presliding;
mod records;
