//! From robot! tokens to straight-line Rust: parsing, checks, derivation, emission.
