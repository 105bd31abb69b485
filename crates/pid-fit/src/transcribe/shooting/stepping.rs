//! How the motion between samples is integrated.

/// Tolerances of an integration with controlled steps.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Adaptive {
    /// Tolerated local error relative to each state.
    pub rtol: f64,
    /// Tolerated local error of states near zero, in their unit.
    pub atol: f64,
}

/// How the motion between samples is integrated.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Stepping {
    /// So many equal steps of the setup's scheme per sampling interval.
    Fixed {
        /// At least 1.
        substeps: usize,
    },
    /// Dormand-Prince steps with controlled error; the setup's scheme does not count.
    Adaptive(Adaptive),
}
