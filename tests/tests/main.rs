//! Tests across the crates, one program: a program for each file would link the solver as many times.
//!
//! A file alone: `cargo test -p pid-tests --test main FILE::`.

mod bad_input;
mod constrained_identification;
mod constraints;
mod dynamics;
mod end_to_end;
mod excitation;
mod golden;
mod identifiability;
mod lanes;
mod mismatch;
mod real_data;
mod regressor;
mod shooting;
mod transcription;
mod two_link_study;
