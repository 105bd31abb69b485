//! Parameter identification and sim-to-real diagnosis for mechanical systems.

pub mod dynamics;
