//! Derivatives of the inverse dynamics, as the typed face gives them.

/// First derivatives of the inverse dynamics `tau(q, v, a, p)`, dense; as returned by the typed
/// face of a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InverseDynamicsDerivatives<const NQ: usize, const NP: usize> {
    /// ∂tau/∂q; rows are equations.
    pub dtau_dq: [[f64; NQ]; NQ],
    /// ∂tau/∂v.
    pub dtau_dv: [[f64; NQ]; NQ],
    /// ∂tau/∂a, the mass matrix.
    pub dtau_da: [[f64; NQ]; NQ],
    /// ∂tau/∂p.
    pub dtau_dp: [[f64; NP]; NQ],
}

impl<const NQ: usize, const NP: usize> InverseDynamicsDerivatives<NQ, NP> {
    /// All entries zero.
    pub const ZERO: Self = Self {
        dtau_dq: [[0.0; NQ]; NQ],
        dtau_dv: [[0.0; NQ]; NQ],
        dtau_da: [[0.0; NQ]; NQ],
        dtau_dp: [[0.0; NP]; NQ],
    };
}
