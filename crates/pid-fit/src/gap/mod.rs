//! Where model and machine differ, and by how much.

pub mod force;
pub mod metrics;

/// Correlation ratio η² of `number` samples in `classes` classes, adjusted for their number and at
/// least 0, from the sums of squares within the classes and in all. How far a force is a function
/// of the quantity the classes are of; 0 where that cannot be said.
pub fn correlation_ratio(within: f64, total: f64, number: f64, classes: f64) -> f64 {
    if total > 0.0 && number > classes {
        (1.0 - (number - 1.0) / (number - classes) * within / total).max(0.0)
    } else {
        0.0
    }
}
