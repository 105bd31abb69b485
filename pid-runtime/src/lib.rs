//! Parameter identification and sim-to-real diagnosis for mechanical systems.

pub mod data;
pub mod dynamics;
pub mod nlp;
pub mod signal;
pub mod solver;
pub mod transcribe;
