//! What a program of motions is built from: windows of samples and settings.

use super::bodies::Body;
use super::fit::Output;
use super::loss::{Loss, Prior};
use super::scheme::Scheme;

/// A window of samples to follow.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Times, s, strictly increasing; at least two.
    pub t: Vec<f64>,
    /// Measured states (q, v) sample by sample, length `2 nq` each, or measured outputs; NaN where
    /// nothing was measured.
    pub measured: Vec<f64>,
    /// States to start from, same layout, finite. Held initial states take their value from here.
    pub guess: Vec<f64>,
    /// Inputs sample by sample, `nu` each.
    pub u: Vec<f64>,
    /// Weight per channel in this window (length `2 nq`, or that of the output); 1 each is the
    /// paper's objective. Or one per channel and sample, laid out like `measured`.
    pub weights: Vec<f64>,
}

impl Track {
    /// Weight of a channel at a sample.
    pub(super) fn weight(&self, sample: usize, channel: usize, channels: usize) -> f64 {
        if self.weights.len() == channels {
            self.weights[channel]
        } else {
            self.weights[sample * channels + channel]
        }
    }
}

/// Settings of the discretization.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// One-step scheme.
    pub scheme: Scheme,
    /// Second derivatives given to the solver.
    pub curvature: Curvature,
    /// Parameter bounds, `np` each; equal ones fix a parameter.
    pub lower: Vec<f64>,
    /// Upper bounds.
    pub upper: Vec<f64>,
    /// Unit of each parameter's variable in the program (positive).
    pub scale: Vec<f64>,
    /// Typical diagonal of M, kg·m² or kg, that makes the dynamic rows changes of velocity.
    pub inertia: Vec<f64>,
    /// Whether the initial state of each window is held at its first value.
    pub hold_initial: bool,
    /// Whether inputs move linearly between samples (otherwise they are held).
    pub linear_inputs: bool,
    /// Steps per sampling interval, at least 1: the integration grid is the data grid refined by it.
    pub substeps: usize,
    /// Measured output; `None` for the state itself.
    pub output: Option<Output>,
    /// Loss of deviations.
    pub loss: Loss,
    /// Prior knowledge of parameters; meant for weights of one over the variance of the noise.
    pub priors: Vec<Prior>,
    /// Links that stay bodies of positive density. A start must have such links.
    pub bodies: Vec<Body>,
    /// Smallest weight of their barrier in the objective times the number of samples.
    pub bodies_weight: f64,
}

/// Second derivatives given to the solver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Curvature {
    /// The exact Hessian of the Lagrangian.
    Exact,
    /// The Hessian of the objective alone (for least squares: Gauss-Newton).
    GaussNewton,
}
