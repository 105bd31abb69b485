//! The point at which a model is evaluated.

/// A point at which a model is evaluated; lengths as in [`Dims`](crate::dynamics::Dims). Functions
/// that do not depend on a part ignore it.
#[derive(Debug, Clone, Copy)]
pub struct At<'a> {
    /// Coordinates, rad or m.
    pub q: &'a [f64],
    /// Velocities, rad/s or m/s.
    pub v: &'a [f64],
    /// Accelerations, rad/s² or m/s².
    pub a: &'a [f64],
    /// Inputs, in the unit of [`InputInfo`](crate::dynamics::InputInfo).
    pub u: &'a [f64],
    /// Parameters, in the unit of [`ParamInfo`](crate::dynamics::ParamInfo).
    pub p: &'a [f64],
}
