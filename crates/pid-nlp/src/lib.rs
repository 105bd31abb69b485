#![doc = include_str!("../README.md")]

pub mod eigen;
#[cfg(feature = "formula")]
pub mod formula;
mod nlp;
pub mod solver;

pub use nlp::{Nlp, PointCheck, SparsePattern, check_point};
