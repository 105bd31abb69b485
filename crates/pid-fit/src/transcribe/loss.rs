//! Cost of a deviation: −2 log of the density of measurement errors, and of prior knowledge of
//! parameters.
//!
//! ```text
//! J = 1/N Σ_i Σ_c ρ(√w_c (y_c(t_i) − d_ci)) + 1/N Σ_j ((p_j − m_j)/s_j)²
//! ```
//!
//! With `w_c` one over the variance of channel c, N J is −2 log of the posterior density up to a constant.

use serde::{Deserialize, Serialize};

/// The loss ρ of a deviation `z` in units of its noise; smooth, ρ(z) = z² near zero up to a factor.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Loss {
    /// z²: normal errors.
    #[default]
    Square,
    /// 2k² (√(1 + (z/k)²) − 1), the smooth form of P. J. Huber's loss (Ann. Math. Statist. 35,
    /// 1964): quadratic within the threshold k > 0, linear beyond it.
    Huber {
        /// Threshold k in standard deviations.
        threshold: f64,
    },
    /// (ν + 1) ln(1 + z²/ν): Student's t distribution with ν > 0 degrees of freedom (K. Lange et
    /// al., J. Am. Stat. Assoc. 84, 1989). Far deviations hardly count; the loss is not convex
    /// beyond √ν.
    StudentT {
        /// Degrees of freedom ν.
        freedom: f64,
    },
}

impl Loss {
    /// Whether the loss is z².
    pub fn is_square(self) -> bool {
        matches!(self, Loss::Square)
    }

    /// ρ(z).
    pub fn value(self, z: f64) -> f64 {
        match self {
            Loss::Square => z * z,
            Loss::Huber { threshold: k } => {
                let r = z / k;
                // √(1 + r²) − 1 without cancellation.
                2.0 * z * z / ((1.0 + r * r).sqrt() + 1.0)
            }
            Loss::StudentT { freedom: n } => (n + 1.0) * (z * z / n).ln_1p(),
        }
    }

    /// ρ'(z).
    pub fn slope(self, z: f64) -> f64 {
        z * self.weight(z)
    }

    /// ρ'(z)/z: the curvature of the parabola that touches ρ at z and lies above it elsewhere, as
    /// iteratively reweighted least squares uses it; positive.
    pub fn weight(self, z: f64) -> f64 {
        match self {
            Loss::Square => 2.0,
            Loss::Huber { threshold: k } => 2.0 / (1.0 + (z / k) * (z / k)).sqrt(),
            Loss::StudentT { freedom: n } => 2.0 * (n + 1.0) / (n + z * z),
        }
    }

    /// ρ''(z).
    pub fn curvature(self, z: f64) -> f64 {
        match self {
            Loss::Square => 2.0,
            Loss::Huber { threshold: k } => 2.0 * (1.0 + (z / k) * (z / k)).powf(-1.5),
            Loss::StudentT { freedom: n } => {
                let s = n + z * z;
                2.0 * (n + 1.0) * (n - z * z) / (s * s)
            }
        }
    }
}

/// Prior knowledge of a parameter: a normal distribution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// Position of the parameter in the model.
    pub parameter: usize,
    /// Its mean, in the parameter's unit.
    pub mean: f64,
    /// Its standard deviation, positive.
    pub deviation: f64,
}

/// Adds `factor Σ ((p − m)/s)²` of the priors: its value; gradient and Hessian diagonal are handed
/// to `add` as (parameter, ∂, ∂²) in the parameter's own unit.
pub(super) fn prior_terms(
    priors: &[Prior],
    p: &[f64],
    factor: f64,
    mut add: impl FnMut(usize, f64, f64),
) -> f64 {
    let mut value = 0.0;
    for prior in priors {
        let z = (p[prior.parameter] - prior.mean) / prior.deviation;
        value += factor * z * z;
        let slope = 2.0 * factor / prior.deviation;
        add(prior.parameter, slope * z, slope / prior.deviation);
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_and_curvatures_are_those_of_differences() {
        for loss in [
            Loss::Square,
            Loss::Huber { threshold: 1.5 },
            Loss::StudentT { freedom: 4.0 },
        ] {
            for z in [-30.0, -1.9, -0.3, 0.2, 1.1, 2.5, 12.0] {
                let h = 1e-4 * f64::abs(z);
                let slope = (loss.value(z + h) - loss.value(z - h)) / (2.0 * h);
                let curvature = (loss.slope(z + h) - loss.slope(z - h)) / (2.0 * h);
                assert!(
                    (slope - loss.slope(z)).abs() < 1e-6 * slope.abs(),
                    "{loss:?} {z}"
                );
                let error = (curvature - loss.curvature(z)).abs();
                assert!(error < 1e-6 * loss.weight(z), "{loss:?} {z}: {error}");
            }
        }
    }

    #[test]
    fn the_reweighting_parabola_lies_above_the_loss() {
        for loss in [
            Loss::Huber { threshold: 1.0 },
            Loss::StudentT { freedom: 3.0 },
        ] {
            for z0 in [0.1, 1.0, 4.0] {
                for k in -60..60 {
                    let z = 0.2 * f64::from(k);
                    let above = loss.value(z0) + 0.5 * loss.weight(z0) * (z * z - z0 * z0);
                    assert!(loss.value(z) <= above + 1e-12, "{loss:?} at {z}, {z0}");
                }
            }
        }
    }

    #[test]
    fn losses_are_densities_of_their_names() {
        // ln of Student's density, up to its constant, is −ρ/2: ratio of densities at 0 and z for ν
        // = 3, from its formula.
        let density = |z: f64| (1.0 + z * z / 3.0_f64).powi(-2);
        for z in [0.5_f64, 2.0, 9.0] {
            let by_loss = (-0.5 * Loss::StudentT { freedom: 3.0 }.value(z)).exp();
            assert!((by_loss - density(z)).abs() < 1e-14);
            // Far out, Huber's loss rises by 2k per unit.
            let huber = Loss::Huber { threshold: 1.3 };
            let rise = huber.value(1e6 + z) - huber.value(1e6);
            assert!((rise - 2.6 * z).abs() < 1e-4, "{rise}");
        }
    }
}
