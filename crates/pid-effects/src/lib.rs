//! The library of physical effects that robot models lack.
//!
//! An effect is one file below [`effects`]: its law over any scalar, its parameters with units and
//! ranges, its state, what it is easily taken for, which effects no motion tells from it, and what
//! models it in MuJoCo, Isaac and URDF. What has no name there is a sum of [`terms`]. The same law
//! serves the diagnosis (crate `pid-diagnose`), identification by exact Hessians ([`with_effects`]) and
//! simulation.
//!
//! ```
//! use pid_effects::effect::Friction;
//! use pid_effects::effects::by_id;
//!
//! // Friction at a quarter of the Stribeck velocity, twice the Coulomb level at rest.
//! let stribeck = by_id("stribeck").expect("an effect of the library");
//! let site = pid_effects::effect::Site {
//!     joint: 0,
//!     q: &[0.0],
//!     v: &[0.05],
//!     load: &[0.0],
//!     t: 0.0,
//!     dt: 1e-3,
//!     rest: None,
//! };
//! let mut friction = Friction {
//!     forward: 0.3,
//!     backward: 0.3,
//!     viscous: 0.1,
//! };
//! stribeck.plain().friction(&[1.0, 0.2], &site, &[], &mut friction);
//! assert!((friction.forward - 0.3 * (1.0 + f64::exp(-0.0625))).abs() < 1e-12);
//! ```
//!
//! A description with effects becomes a model by [`with_effects::Assembled`]. How to write an
//! effect of one's own is on the front page of `pid-diagnose`.

pub mod circumstances;
mod class;
mod commands;
pub mod constants;
pub mod described;
pub mod drives;
pub mod effect;
pub mod effects;
mod equal_when;
pub mod nominal;
mod parameter;
mod read_off;
pub mod scalar;
mod smooth;
pub mod symbol;
pub mod terms;
pub mod with_effects;
