//! The messages of `robot!`, one mistake per file in `tests/ui`.
//!
//! The files are checked in a build of their own. A crate with few dependencies makes it short.
