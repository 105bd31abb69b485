//! Drive noise from the records, where it is not stated.
//!
//! The predictor's gain, and with it the covariance S of its innovations ε, depends on the standard
//! deviation σ_j of the torque noise of each joint. Its maximum-likelihood value under a hypothesis
//! and its parameters is
//!
//! ```text
//! minimise over σ_j    Σ_k ε_k(σ_j)ᵀ S(σ_j)⁻¹ ε_k(σ_j) + ln det S(σ_j)
//! ```
//!
//! (L. Ljung, System Identification, 1999, section 7.4). A hypothesis that lacks something takes it
//! for noise, so the value belongs to the hypothesis and is found anew with every better one. σ_j
//! is sought between 0.02 % and 2 % of the joint's typical torque; a larger remainder counts as
//! misfit.

use pid_data::Role;

use crate::case::Case;
use crate::fit::{Fit, all_gains, value};

/// Least and largest standard deviation, as shares of the typical torque.
const LOWEST: f64 = 2e-4;
const HIGHEST: f64 = 2e-2;
/// Points of the ladder between them.
const RUNGS: usize = 9;
/// Sweeps over the joints, since the noise of one drive moves the others too.
const SWEEPS: usize = 2;

/// Sets the drive noise of every joint whose noise is not stated to its most likely value under a
/// fit. Returns whether there was one.
pub(crate) fn settle(case: &mut Case, fit: &Fit) -> bool {
    let open: Vec<usize> = (0..case.n()).filter(|&j| !case.noise[j].stated).collect();
    if open.is_empty() {
        return false;
    }
    let ratio = (HIGHEST / LOWEST).ln() / (RUNGS - 1) as f64;
    let share = |rung: f64| LOWEST * (ratio * rung).exp();
    // The noise that joints pass on to each other is that of the sweep before, so all joints can be
    // treated side by side.
    for _ in 0..if case.n() > 1 { SWEEPS } else { 1 } {
        let mut surprise = vec![[f64::INFINITY; RUNGS]; case.n()];
        for rung in 0..RUNGS {
            for &j in &open {
                case.noise[j].torque = share(rung as f64) * case.scale[j].torque;
            }
            let gains = all_gains(case, &fit.hypothesis, &fit.point);
            let v = value(case, &fit.hypothesis, &fit.point, &gains, Role::Train);
            for &j in &open {
                surprise[j][rung] = v.chi[j][0] + v.chi[j][1] + v.log_det[j];
            }
        }
        for &j in &open {
            case.noise[j].torque = share(lowest(&surprise[j])) * case.scale[j].torque;
        }
        case.pass_on();
    }
    true
}

/// Place of the minimum of a function given at 0, 1, 2 …: that of the parabola through the lowest
/// value and its neighbours.
fn lowest(y: &[f64]) -> f64 {
    let best = (0..y.len())
        .min_by(|&a, &b| y[a].total_cmp(&y[b]))
        .unwrap_or(0);
    if best == 0 || best + 1 >= y.len() {
        return best as f64;
    }
    let (a, b, c) = (y[best - 1], y[best], y[best + 1]);
    let bend = a - 2.0 * b + c;
    let step = if bend > 0.0 {
        0.5 * (a - c) / bend
    } else {
        0.0
    };
    best as f64 + step.clamp(-0.5, 0.5)
}

#[cfg(test)]
mod tests {
    use super::lowest;

    #[test]
    fn a_parabola_gives_its_vertex_and_an_end_gives_itself() {
        let y: Vec<f64> = (0..6).map(|i| (f64::from(i) - 2.3).powi(2)).collect();
        assert!((lowest(&y) - 2.3).abs() < 1e-12);
        assert_eq!(lowest(&[3.0, 2.0, 1.0]), 2.0);
        assert_eq!(lowest(&[f64::INFINITY, f64::INFINITY]), 0.0);
    }
}
