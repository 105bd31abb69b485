//! Which physical effect a model lacks, where it sits, and how far the gap shrinks once it is modelled.
//!
//! A [`Case`](case::Case) is a data folder with a nominal description; [`search`](search::search)
//! fits the nominal structure within its tolerances, screens every effect of the library at every
//! joint, refits the best and gives a verdict.
//!
//! # An effect of your own
//!
//! An effect is a type with a description ([`Model`](effect::Model)) and an equation over any
//! scalar ([`Law`](effect::Law)); the hooks it does not need keep their defaults. It joins the
//! library in the settings:
//!
//! ```
//! use std::sync::Arc;
//! use pid_diagnose::constants::Constants;
//! use pid_diagnose::effect::{Class, Forces, Info, Kind, Law, Model, Site, Unit, parameter};
//! use pid_diagnose::scalar::Scalar;
//! use pid_diagnose::search::Settings;
//!
//! /// A spring that grows harder: additional force −K₃ q³.
//! struct HardeningSpring;
//!
//! static INFO: Info = Info {
//!     id: "hardening_spring",
//!     title: "A spring that grows harder",
//!     equation: "additional force −K₃ q³",
//!     source: "G. Duffing 1918",
//!     kind: Kind::Force,
//!     class: Class::Position,
//!     has_joint: true,
//!     parameters: &[parameter("cubic", "N*m/rad^3", Unit::One, -1e3, 1e3)],
//!     starts: &[&[0.1]],
//!     amplitudes: &[0],
//!     confusions: &[("spring", "a spring is straight")],
//!     regime: "far from the middle",
//!     equals: &[],
//!     mujoco: None,
//!     isaac: None,
//!     urdf: None,
//! };
//!
//! impl Model for HardeningSpring {
//!     fn info(&self) -> &'static Info {
//!         &INFO
//!     }
//! }
//!
//! impl<D: Scalar> Law<D> for HardeningSpring {
//!     fn force(&self, e: &[D], at: &Site<'_, D>, _: &[D], f: &mut Forces<'_, D>, _: &Constants<D>) {
//!         let q = at.q[at.joint];
//!         f.value[at.joint] -= e[0] * q * q * q;
//!     }
//! }
//!
//! let mut settings = Settings::default();
//! settings.effects.push(Arc::new(HardeningSpring));
//! assert_eq!(settings.effects.len(), 36);
//! ```

#[cfg(test)]
mod bench;
mod beyond;
pub mod case;
mod case_error;
mod ceilings;
pub mod channel;
pub mod criteria;
pub mod declared;
pub mod diagnosis;
pub mod excerpt;
pub mod extended;
mod first;
pub mod fit;
pub mod free;
pub mod gap;
pub mod hypothesis;
mod initial;
pub mod known;
mod levels;
pub mod locate;
pub mod loop_gain;
pub mod next;
mod noise;
mod numerics;
mod observer;
mod outlier;
mod page;
mod plot;
mod point;
pub mod predict;
mod prepare;
mod regular;
pub mod report;
pub mod screen;
pub mod search;
pub mod servo;
mod simulate;
mod substeps;
pub mod timing;
pub mod whole;
mod windows;
pub mod words;
pub mod write;

pub use pid_effects::{
    circumstances, constants, described, drives, effect, effects, nominal, scalar, terms,
    with_effects,
};
