//! What the code of [`robot!`] needs: the face of a model, and models made of others.
//!
//! | module | duty |
//! |---|---|
//! | [`dynamics`] | the slice face of a model, with exact derivatives |
//! | [`lanes`] | four nodes at once |
//! | [`generic`] | models over dual numbers |
//! | [`kinematics`] | points of a robot |
//! | [`extend`], [`term`], [`memory`] | a model with force laws added |
//! | [`control`] | a model under a joint controller |
//! | [`chain`] | a model some of whose variables are functions of others |

mod at;
pub mod chain;
pub mod control;
pub mod dynamics;
pub mod extend;
pub mod generic;
pub mod kinematics;
pub mod lanes;
pub mod memory;
pub mod term;

#[doc(hidden)]
#[path = "private.rs"]
pub mod __private;

pub use num_dual;
pub use pid_macros::robot;
