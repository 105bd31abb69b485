//! Which physical effect a model lacks, where it sits, and how far the gap shrinks once it is modelled.

pub mod case;
pub mod channel;
pub mod diagnose;
pub mod effect;
pub mod effects;
pub mod fit;
pub mod gap;
mod kernels;
pub mod nominal;
pub mod observer;
mod page;
pub mod plant;
pub mod predict;
pub mod rigid;
pub mod scalar;
pub mod screen;
pub mod simulate;
pub mod study;
pub mod windows;
