//! Where model and machine differ, and by how much.

pub mod force;
pub mod metrics;
