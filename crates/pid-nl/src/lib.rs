#![doc = include_str!("../README.md")]

mod answer;
mod error;
mod expression;
mod head;
mod lines;
mod model;
mod problem;

pub use answer::answer;
pub use error::NlError;
pub use problem::Problem;
