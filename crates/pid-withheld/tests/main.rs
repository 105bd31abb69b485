//! Tests of the generator, one program.

mod rigid;
mod servo;
mod untidy;
