//! Tests of the diagnosis, one program: a program for each file would link the solver as many times.
//!
//! A file alone: `cargo test -p pid-diagnose --test main FILE::`.

mod common;
mod declared;
mod drawn;
mod drive_laws;
mod effects;
mod extended;
mod next;
mod noise;
mod oracle;
mod practice;
mod readings;
mod ready;
mod servo;
mod simulated;
mod start;
mod structures;
