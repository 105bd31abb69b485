//! The command line `pid`.
fn main() {}
