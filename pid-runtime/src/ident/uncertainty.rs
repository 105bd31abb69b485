//! Standard deviations from the reduced Hessian of a least-squares objective.

use faer::{Mat, Side};

/// A parameter, or a direction in parameter space, whose standard deviation exceeds this share of the range is not known.
const SHARE_OF_RANGE: f64 = 0.25;
/// Share of the largest eigenvalue that rounding leaves of a zero.
const ROUNDING: f64 = 1e-15;

/// What the curvature of the objective says about the parameters.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Spread {
    pub(super) deviations: Vec<Option<f64>>,
    pub(super) undetermined: usize,
    pub(super) correlation_factor: f64,
}

impl Spread {
    pub(super) fn none(np: usize) -> Self {
        Self {
            deviations: vec![None; np],
            undetermined: np,
            correlation_factor: 1.0,
        }
    }
}

/// Whether a value lies at a bound, to a millionth of the range.
pub(super) fn at_bound(value: f64, lower: f64, upper: f64) -> bool {
    let width = upper - lower;
    let room = 1e-6
        * if width.is_finite() {
            width
        } else {
            value.abs()
        };
    value - lower <= room || upper - value <= room
}

/// Factor on variances of estimates for residuals correlated in time, from the lag-one autocorrelation ρ pooled over
/// channels: (1 + ρ)/(1 − ρ) (M. S. Bartlett, J. R. Stat. Soc. 98, 1935), at least 1. NaN separates windows.
pub(super) fn correlation_factor(residuals: &[f64], channels: usize) -> f64 {
    let (mut lagged, mut square) = (0.0, 0.0);
    for c in 0..channels {
        let mut previous = f64::NAN;
        for &e in residuals.iter().skip(c).step_by(channels.max(1)) {
            if e.is_nan() {
                previous = e;
                continue;
            }
            square += e * e;
            if !previous.is_nan() {
                lagged += previous * e;
            }
            previous = e;
        }
    }
    let rho = if square > 0.0 {
        (lagged / square).clamp(0.0, 0.9999)
    } else {
        0.0
    };
    (1.0 + rho) / (1.0 - rho)
}

/// Covariance `2 s² c (∇²F)⁻¹` with `s²` the residual variance of the weighted least-squares objective F, `c` the factor for
/// correlated residuals. `hessian` is in scaled parameters.
///
/// Directions are taken in parameters divided by their ranges (by their scales where a range is open). One whose deviation
/// exceeds [`SHARE_OF_RANGE`] there, or whose curvature is not positive beyond rounding, is not determined by the data: the
/// range says more than the record. It makes the parameters it touches `None`.
#[allow(
    clippy::too_many_arguments,
    reason = "one internal call, all of them numbers of one fit"
)]
pub(super) fn from_hessian(
    hessian: &Mat<f64>,
    free: &[usize],
    scale: &[f64],
    lower: &[f64],
    upper: &[f64],
    residuals: &[f64],
    channels: usize,
    unknowns: usize,
    objective: f64,
) -> Spread {
    let mut spread = Spread::none(scale.len());
    spread.undetermined = 0;
    spread.correlation_factor = correlation_factor(residuals, channels);
    let n = free.len();
    let count = residuals.iter().filter(|e| !e.is_nan()).count();
    if n == 0 || count <= unknowns {
        return spread;
    }
    let width: Vec<f64> = free
        .iter()
        .map(|&j| match upper[j] - lower[j] {
            w if w.is_finite() && w > 0.0 => w,
            _ => scale[j],
        })
        .collect();
    let by_range = Mat::from_fn(n, n, |i, k| {
        let unit = |i: usize| width[i] / scale[free[i]];
        hessian[(i, k)] * unit(i) * unit(k)
    });
    let Ok(eigen) = by_range.self_adjoint_eigen(Side::Lower) else {
        return Spread::none(scale.len());
    };
    let (u, d) = (eigen.U(), eigen.S());
    let largest = (0..n).fold(0.0_f64, |a, k| a.max(d[k]));
    let unit = 2.0 * objective / (count - unknowns) as f64 * spread.correlation_factor;
    let least = (unit / SHARE_OF_RANGE.powi(2)).max(ROUNDING * n as f64 * largest);
    spread.undetermined = (0..n).filter(|&k| d[k] <= least).count();
    for (i, &j) in free.iter().enumerate() {
        let (mut variance, mut open) = (0.0, false);
        for k in 0..n {
            let share = u[(i, k)] * u[(i, k)];
            if d[k] <= least {
                open |= share > 1e-6;
            } else {
                variance += share * unit / d[k];
            }
        }
        let deviation = variance.sqrt();
        if !open && deviation <= SHARE_OF_RANGE {
            spread.deviations[j] = Some(deviation * width[i]);
        }
    }
    spread
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_regression_gives_its_textbook_deviation() {
        // y = p x, unit noise: var(p) = s² / Σx²; F = Σ (y − p x)², ∇²F = 2 Σx².
        let x: Vec<f64> = (0..400).map(|k| f64::from(k) / 100.0).collect();
        let e: Vec<f64> = (0..400)
            .map(|k| if (k * 7919) % 13 < 6 { 1.0 } else { -1.0 })
            .collect();
        let f: f64 = e.iter().map(|e| e * e).sum();
        let xx: f64 = x.iter().map(|x| x * x).sum();
        let hessian = Mat::from_fn(1, 1, |_, _| 2.0 * xx);
        let spread = from_hessian(&hessian, &[0], &[1.0], &[-10.0], &[10.0], &e, 1, 1, f);
        let expected = (f / 399.0 / xx * spread.correlation_factor).sqrt();
        assert!((spread.deviations[0].expect("determined") - expected).abs() < 1e-12);
        assert_eq!(spread.undetermined, 0);
    }

    #[test]
    fn a_null_direction_leaves_its_parameters_open() {
        // Only the sum of the first two enters.
        let hessian = Mat::from_fn(3, 3, |i, j| match (i, j) {
            (2, 2) => 1e4,
            (2, _) | (_, 2) => 0.0,
            _ => 1e4,
        });
        let e = vec![0.1; 100];
        let spread = from_hessian(
            &hessian,
            &[0, 1, 2],
            &[1.0; 3],
            &[-10.0; 3],
            &[10.0; 3],
            &e,
            1,
            3,
            1.0,
        );
        assert_eq!(spread.undetermined, 1);
        assert!(spread.deviations[0].is_none() && spread.deviations[1].is_none());
        assert!(spread.deviations[2].is_some());
    }

    #[test]
    fn autocorrelation_of_a_first_order_process_is_found() {
        let mut x = 0.0;
        let mut state = 7_u64;
        let series: Vec<f64> = (0..200_000)
            .map(|_| {
                state = state
                    .wrapping_mul(6364136223846793005)
                    .wrapping_add(1442695040888963407);
                x = 0.8 * x + ((state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5);
                x
            })
            .collect();
        let factor = correlation_factor(&series, 1);
        assert!((factor - 9.0).abs() < 0.4, "{factor}");
    }
}
