//! The `robot!` macro.
