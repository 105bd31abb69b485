//! Where model and machine differ, and by how much.

pub mod metrics;
