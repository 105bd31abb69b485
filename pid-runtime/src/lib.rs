//! Parameter identification and sim-to-real diagnosis for mechanical systems.

pub mod data;
pub mod dynamics;
mod eigen;
pub mod excite;
pub mod gap;
pub mod generic;
pub mod ident;
pub mod integrate;
pub mod kinematics;
pub mod lanes;
pub mod nlp;
pub mod report;
pub mod signal;
pub mod solver;
pub mod transcribe;

#[doc(hidden)]
#[path = "private.rs"]
pub mod __private;

pub use num_dual;
pub use pid_macros::robot;
