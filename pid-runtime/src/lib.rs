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

//! Without the feature `std`, on by default, a declared robot has its types and functions on arrays, and this crate
//! what they need: no traits, no heap.
#![cfg_attr(not(feature = "std"), no_std)]

#[cfg(feature = "std")]
mod at;
#[cfg(feature = "std")]
pub mod chain;
#[cfg(feature = "std")]
pub mod control;
#[cfg(feature = "std")]
pub mod dynamics;
#[cfg(feature = "std")]
pub mod extend;
#[cfg(feature = "std")]
pub mod generic;
mod inverse;
#[cfg(feature = "std")]
pub mod kinematics;
#[cfg(feature = "std")]
pub mod lanes;
#[cfg(feature = "std")]
pub mod memory;
#[cfg(feature = "std")]
pub mod term;

/// What functions of a robot give.
#[cfg(not(feature = "std"))]
pub mod dynamics {
    pub use crate::inverse::InverseDynamicsDerivatives;
}

#[doc(hidden)]
#[path = "private.rs"]
pub mod __private;

#[cfg(feature = "std")]
pub use num_dual;
pub use pid_macros::robot;
