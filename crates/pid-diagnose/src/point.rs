//! Where a fit stands.

/// A point of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// Deviations of the nominal parameters.
    pub theta: Vec<f64>,
    /// Parameters of the effects, SI.
    pub e: Vec<f64>,
}
