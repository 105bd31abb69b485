//! Hash-consed expression graphs: exact derivatives, scheduling, evaluation.
//!
//! A [`Graph`] is an arena of operations on real numbers in which equal expressions have one
//! [`Id`]. Everything a compiler for equations of motion needs is read off it:
//!
//! - [`diff`]: exact gradients (reverse sweep), directional derivatives (forward sweep), Hessians
//!   (forward over reverse);
//! - [`pattern`]: which of the resulting expressions are identically zero;
//! - [`schedule`]: an order of evaluation, the lifetimes of intermediate values, blocks of bounded size;
//! - [`eval`]: an interpreter over `f64`, batches of `f64` and any dual number of `num-dual`;
//! - [`program`]: the same over `f64` alone, made for speed;
//! - [`cost`] and [`print`](mod@print): operation counts and readable text.
//!
//! The crate knows algebra; it knows nothing of robots, tokens or matrices.
//!
//! # Example
//! The gradient of `f(x, y) = x² sin y`:
//! ```
//! use pid_symbolic::{diff, Graph, Tape};
//!
//! let mut g = Graph::new();
//! let (x, y) = (g.var(0), g.var(1));
//! let (x2, sin_y) = (g.mul(x, x), g.sin(y));
//! let f = g.mul(x2, sin_y);
//! let gradient = diff::gradient(&mut g, f, &[x, y]);
//! let mut values = [0.0; 2];
//! Tape::new(&g, &gradient).eval(&[3.0, 0.5], &mut values);
//! assert!((values[0] - 6.0 * 0.5_f64.sin()).abs() < 1e-15);
//! assert!((values[1] - 9.0 * 0.5_f64.cos()).abs() < 1e-15);
//! ```

pub mod cost;
pub mod diff;
pub mod eval;
pub mod graph;
pub mod hoist;
pub mod node;
pub mod pattern;
pub mod print;
pub mod program;
pub mod random;
pub mod schedule;

pub use cost::Cost;
pub use eval::Tape;
pub use graph::Graph;
pub use hoist::{Hoisted, hoist};
pub use node::{Function, Id, Node};
pub use program::Program;
pub use schedule::Plan;
