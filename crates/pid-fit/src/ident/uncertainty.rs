//! Standard deviations from the reduced Hessian of a least-squares objective.

use crate::transcribe::{Loss, Prior};
use faer::Mat;
use pid_nlp::eigen::Eigen;

/// A direction whose standard deviation exceeds this share of the parameter's range is not
/// determined.
const SHARE_OF_RANGE: f64 = 0.25;
/// An eigenvalue below this share of the largest one is a rounded zero.
const ROUNDING: f64 = 1e-15;

/// Fewest windows per free parameter for the sandwich form.
const WINDOWS_EACH: usize = 2;

/// Joint covariance of the free parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Covariance {
    /// Positions of the free parameters: not held, not at a bound.
    pub free: Vec<usize>,
    /// Their covariance in their units, row by row; directions that the data do not determine add
    /// nothing to it.
    pub values: Vec<f64>,
}

impl Covariance {
    /// Standard deviation of the combination Σ c_j p_j, `c` over all parameters.
    pub fn deviation(&self, c: &[f64]) -> f64 {
        let n = self.free.len();
        let mut sum = 0.0;
        for (i, &a) in self.free.iter().enumerate() {
            for (k, &b) in self.free.iter().enumerate() {
                sum += c[a] * c[b] * self.values[i * n + k];
            }
        }
        sum.max(0.0).sqrt()
    }

    /// Correlation of two parameters by their positions in `free`; NaN without variance.
    pub fn correlation(&self, i: usize, k: usize) -> f64 {
        let n = self.free.len();
        let v = |a: usize, b: usize| self.values[a * n + b];
        v(i, k) / (v(i, i) * v(k, k)).sqrt()
    }
}

/// A direction in parameter space along which the objective does not change beyond noise:
/// parameters and their changes, as shares of their ranges, the largest 1.
pub type OpenDirection = Vec<(usize, f64)>;

/// Uncertainty from the curvature of the objective.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Spread {
    pub(super) deviations: Vec<Option<f64>>,
    pub(super) undetermined: usize,
    pub(super) correlation_factor: f64,
    /// `½ Σρ'²/Σρ''`, corrected for the number of unknowns.
    pub(super) dispersion: f64,
    pub(super) covariance: Option<Covariance>,
    pub(super) open: Vec<OpenDirection>,
    /// Whether the deviations are of the sandwich form.
    pub(super) sandwich: bool,
}

impl Spread {
    pub(super) fn none(np: usize) -> Self {
        Self {
            deviations: vec![None; np],
            undetermined: np,
            correlation_factor: 1.0,
            dispersion: 1.0,
            covariance: None,
            open: Vec::new(),
            sandwich: false,
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

/// Factor on variances of estimates for residuals correlated in time, from the lag-one
/// autocorrelation ρ pooled over channels: (1 + ρ)/(1 − ρ) (M. S. Bartlett, J. R. Stat. Soc. 98,
/// 1935), at least 1. NaN separates windows.
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

/// A parameter at a bound that a prior knows. The bound is the end of what the prior thinks possible: the value is as
/// uncertain there as within, and the free parameters move with it.
pub(super) struct Edge {
    /// Second derivatives of the objective by it and each free parameter, all scaled.
    pub(super) column: Vec<f64>,
    /// Standard deviation of its prior, scaled.
    pub(super) deviation: f64,
}

/// A solved problem with all that its uncertainty depends on.
pub(super) struct Solved<'a> {
    /// Reduced Hessian of the objective in scaled parameters, over `free`.
    pub(super) hessian: &'a Mat<f64>,
    /// Parameters that are neither held nor at a bound.
    pub(super) free: &'a [usize],
    /// Parameters at bounds that a prior knows.
    pub(super) edges: Vec<Edge>,
    pub(super) scale: &'a [f64],
    pub(super) lower: &'a [f64],
    pub(super) upper: &'a [f64],
    pub(super) loss: Loss,
    pub(super) priors: &'a [Prior],
    /// 1/N of the objective.
    pub(super) share: f64,
    /// `√(w/N) (y − d)`, NaN where nothing was measured and between windows.
    pub(super) residuals: &'a [f64],
    pub(super) channels: usize,
    /// Parameters and initial states.
    pub(super) unknowns: usize,
    /// Gradient of each window's part of the objective by the scaled parameters (np each), if the
    /// sandwich is wanted.
    pub(super) scores: Option<Vec<f64>>,
}

impl Solved<'_> {
    /// Ranges of the free parameters; their scales where a range is open.
    fn widths(&self) -> Vec<f64> {
        let width = |&j: &usize| match self.upper[j] - self.lower[j] {
            w if w.is_finite() && w > 0.0 => w,
            _ => self.scale[j],
        };
        self.free.iter().map(width).collect()
    }

    /// Whether each free parameter has a prior.
    fn have_priors(&self) -> Vec<bool> {
        let free = self.free.iter();
        free.map(|j| self.priors.iter().any(|p| p.parameter == *j))
            .collect()
    }

    /// What the priors add to the curvature of each free parameter divided by its range.
    fn prior_curvature(&self, width: &[f64]) -> Vec<f64> {
        let mut prior = vec![0.0; self.free.len()];
        for p in self.priors {
            if let Some(i) = self.free.iter().position(|&j| j == p.parameter) {
                prior[i] += 2.0 * self.share * (width[i] / p.deviation).powi(2);
            }
        }
        prior
    }
}

/// Covariance `H⁺ V H⁺` with H = ∇²F of the objective and V the variance of its gradient.
///
/// * From the Hessian: `V = u (H − H_p) + 2/N H_p`, `u = c/N Σρ'²/Σρ''` with c the factor for
///   correlated residuals, H_p the priors' part. For squares without priors this is `2 s² c H⁻¹`
///   with the residual variance s².
/// * Sandwich (P. J. Huber, 1967; clustered by window): `V = W/(W − 1) Σ_w g_w g_wᵀ + 2/N H_p` with
///   the windows' gradients g_w less their mean: right for noise of any correlation within a window
///   and any variance of it.
/// * Beside either the free parameters move with those at bounds that a prior knows, by `−H⁺ H_e` each: their prior
///   variances come to them (a first-order sensitivity: A. V. Fiacco, Introduction to Sensitivity and Stability
///   Analysis in Nonlinear Programming, 1983).
///
/// Directions are taken in parameters divided by their ranges (by their scales where a range is
/// open). The data do not determine a direction whose deviation exceeds [`SHARE_OF_RANGE`] there,
/// or whose curvature is not positive beyond rounding: the range says more than the record. The
/// parameters in it get `None`. Directions in parameters with priors are known at least as well as
/// these.
pub(super) fn from_hessian(solved: &Solved<'_>) -> Spread {
    let Solved {
        hessian,
        free,
        scale,
        residuals,
        unknowns,
        ..
    } = *solved;
    let mut spread = Spread::none(scale.len());
    spread.undetermined = 0;
    spread.correlation_factor = correlation_factor(residuals, solved.channels);
    let n = free.len();
    let count = residuals.iter().filter(|e| !e.is_nan()).count();
    if n == 0 || count <= unknowns {
        return spread;
    }
    let width = solved.widths();
    let by_range = Mat::from_fn(n, n, |i, k| {
        let unit = |i: usize| width[i] / scale[free[i]];
        hessian[(i, k)] * unit(i) * unit(k)
    });
    let Some(eigen) = Eigen::of(by_range.as_ref()) else {
        return Spread::none(scale.len());
    };
    let (u, d) = (&eigen.vectors, &eigen.values);
    let largest = (0..n).fold(0.0_f64, |a, k| a.max(d[k]));
    spread.dispersion = dispersion(solved) * count as f64 / (count - unknowns) as f64;
    let unit = 2.0 * solved.share * spread.dispersion * spread.correlation_factor;
    let rounding = ROUNDING * n as f64 * largest;
    let least = (unit / SHARE_OF_RANGE.powi(2)).max(rounding);
    let expected = solved.have_priors();
    let prior = solved.prior_curvature(&width);
    // Priors on all the parameters of a direction determine it, even if they are wide beside the
    // ranges. They do so too where half of its curvature is theirs: a parameter without a prior that
    // moves a little with others then has a deviation.
    let by_prior = |k: usize| {
        let own = (0..n).map(|i| prior[i] * u[(i, k)] * u[(i, k)]);
        own.sum::<f64>() > 0.5 * d[k]
            || (0..n).all(|i| expected[i] || u[(i, k)] * u[(i, k)] <= 1e-6)
    };
    let known = |k: usize| d[k] > least || d[k] > rounding && by_prior(k);
    let inverse = Mat::from_fn(n, n, |i, j| {
        (0..n)
            .filter(|&k| known(k))
            .map(|k| u[(i, k)] * u[(j, k)] / d[k])
            .sum::<f64>()
    });
    let clustered = clusters(solved, &width);
    spread.sandwich = clustered.is_some();
    let data = clustered.unwrap_or_else(|| {
        Mat::from_fn(n, n, |i, k| {
            unit * (by_range[(i, k)] - if i == k { prior[i] } else { 0.0 })
        })
    });
    let certain = |i: usize| 2.0 * solved.share * prior[i];
    let middle = Mat::from_fn(n, n, |i, k| {
        data[(i, k)] + if i == k { certain(i) } else { 0.0 }
    });
    let mut covariance = &inverse * &middle * &inverse;
    for edge in &solved.edges {
        let column = Mat::from_fn(n, 1, |i, _| edge.column[i] * width[i] / scale[free[i]]);
        let moved = &inverse * &column;
        for (i, k) in (0..n).flat_map(|i| (0..n).map(move |k| (i, k))) {
            covariance[(i, k)] += moved[(i, 0)] * moved[(k, 0)] * edge.deviation.powi(2);
        }
    }
    for k in (0..n).filter(|&k| !known(k)) {
        spread.undetermined += 1;
        spread.open.push(open_direction(free, |i| u[(i, k)]));
    }
    for (i, &j) in free.iter().enumerate() {
        let open = (0..n).any(|k| !known(k) && u[(i, k)] * u[(i, k)] > 1e-6);
        let deviation = covariance[(i, i)].max(0.0).sqrt();
        if !open && (deviation <= SHARE_OF_RANGE || expected[i]) {
            spread.deviations[j] = Some(deviation * width[i]);
        }
    }
    spread.covariance = Some(Covariance {
        free: free.to_vec(),
        values: (0..n * n)
            .map(|e| covariance[(e / n, e % n)] * width[e / n] * width[e % n])
            .collect(),
    });
    spread
}

/// A direction by its parts in the free parameters; parts below a twentieth of the largest are left out.
fn open_direction(free: &[usize], part: impl Fn(usize) -> f64) -> OpenDirection {
    let larger = |m: f64, i: usize| match part(i).abs() > m.abs() {
        true => part(i),
        false => m,
    };
    let most = (0..free.len()).fold(0.0, larger);
    let share = |i: usize| part(i) / most;
    (0..free.len())
        .filter(|&i| share(i).abs() > 0.05)
        .map(|i| (free[i], share(i)))
        .collect()
}

/// `½ Σρ'²/Σρ''`: with 2/N the factor between Hessian and variance of the gradient for white
/// residuals; for squares their variance.
fn dispersion(solved: &Solved<'_>) -> f64 {
    let (mut slope, mut curvature) = (0.0, 0.0);
    for r in solved.residuals.iter().filter(|r| !r.is_nan()) {
        let z = r / solved.share.sqrt();
        slope += solved.loss.slope(z).powi(2);
        curvature += solved.loss.curvature(z);
    }
    0.5 * slope / curvature.max(f64::MIN_POSITIVE)
}

/// Variance of the gradient from the windows' own gradients; `None` if not asked for or with too few windows.
fn clusters(solved: &Solved<'_>, width: &[f64]) -> Option<Mat<f64>> {
    let scores = solved.scores.as_ref()?;
    let (np, n) = (solved.scale.len(), solved.free.len());
    let windows = scores.len() / np.max(1);
    if windows < WINDOWS_EACH * n.max(2) {
        return None;
    }
    let entry = |w: usize, i: usize| {
        scores[w * np + solved.free[i]] * width[i] / solved.scale[solved.free[i]]
    };
    let mean: Vec<f64> = (0..n)
        .map(|i| (0..windows).map(|w| entry(w, i)).sum::<f64>() / windows as f64)
        .collect();
    let factor = windows as f64 / (windows - 1) as f64;
    Some(Mat::from_fn(n, n, |i, k| {
        let product = |w: usize| (entry(w, i) - mean[i]) * (entry(w, k) - mean[k]);
        factor * (0..windows).map(product).sum::<f64>()
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn solved<'a>(
        hessian: &'a Mat<f64>,
        free: &'a [usize],
        scale: &'a [f64],
        lower: &'a [f64],
        upper: &'a [f64],
        residuals: &'a [f64],
        unknowns: usize,
    ) -> Solved<'a> {
        Solved {
            hessian,
            free,
            edges: Vec::new(),
            scale,
            lower,
            upper,
            loss: Loss::Square,
            priors: &[],
            share: 1.0,
            residuals,
            channels: 1,
            unknowns,
            scores: None,
        }
    }

    /// White residuals of unit size, so that the factor for correlation is one.
    fn alternating() -> Vec<f64> {
        (0..2000)
            .map(|k| if k % 2 == 0 { 1.0 } else { -1.0 })
            .collect()
    }

    /// y = p x + e at x = 1 … n with known variance and a prior on p.
    #[test]
    fn a_prior_adds_its_precision() {
        let e = alternating();
        let n = e.len() as f64;
        let xx = 40.0;
        let share = 1.0 / n;
        let scaled: Vec<f64> = e.iter().map(|e| e * share.sqrt()).collect();
        let prior = [Prior {
            parameter: 0,
            mean: 0.0,
            deviation: 0.2,
        }];
        let hessian = Mat::from_fn(1, 1, |_, _| 2.0 * share * (xx + 1.0 / 0.04));
        let mut solved = solved(&hessian, &[0], &[1.0], &[-10.0], &[10.0], &scaled, 1);
        (solved.share, solved.priors) = (share, &prior);
        let found = from_hessian(&solved).deviations[0].expect("determined");
        let variance = n / (n - 1.0);
        // H⁻¹ V H⁻¹ with the data's variance estimated and the prior's known.
        let precision = xx + 1.0 / 0.04;
        let expected = ((variance * xx + 1.0 / 0.04) / (precision * precision)).sqrt();
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }

    /// Of y = a x + b z a fit with b at a bound has the a that goes with it: it moves by −Σxz/Σxx of b.
    #[test]
    fn what_a_prior_knows_at_a_bound_moves_the_others() {
        let e = alternating();
        let n = e.len() as f64;
        let (xx, xz, share) = (40.0, 30.0, 1.0 / n);
        let scaled: Vec<f64> = e.iter().map(|e| e * share.sqrt()).collect();
        let hessian = Mat::from_fn(1, 1, |_, _| 2.0 * share * xx);
        let mut solved = solved(&hessian, &[0], &[1.0], &[-10.0], &[10.0], &scaled, 1);
        solved.share = share;
        let alone = from_hessian(&solved).deviations[0].expect("determined");
        solved.edges = vec![Edge {
            column: vec![2.0 * share * xz],
            deviation: 0.2,
        }];
        let found = from_hessian(&solved).deviations[0].expect("determined");
        let expected = (alone * alone + (xz / xx * 0.2_f64).powi(2)).sqrt();
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }

    #[test]
    fn a_prior_as_wide_as_the_range_is_knowledge() {
        // The data say nothing of the second parameter; its posterior is its prior, uniform ±1 as a
        // normal distribution.
        let e = alternating();
        let share = 1.0 / e.len() as f64;
        let scaled: Vec<f64> = e.iter().map(|e| e * share.sqrt()).collect();
        let prior = [Prior {
            parameter: 1,
            mean: 0.0,
            deviation: 1.0 / 3.0_f64.sqrt(),
        }];
        let hessian = Mat::from_fn(2, 2, |i, k| match (i, k) {
            (0, 0) => 2.0 * share * 400.0,
            (1, 1) => 2.0 * share * 3.0,
            _ => 0.0,
        });
        let (low, high) = ([-1.0; 2], [1.0; 2]);
        let mut solved = solved(&hessian, &[0, 1], &[1.0; 2], &low, &high, &scaled, 2);
        solved.share = share;
        assert_eq!(from_hessian(&solved).deviations[1], None);
        solved.priors = &prior;
        let found = from_hessian(&solved);
        assert_eq!(found.undetermined, 0);
        let deviation = found.deviations[1].expect("known");
        assert!(
            (deviation - prior[0].deviation).abs() < 1e-12,
            "{deviation}"
        );
        assert!((found.deviations[0].expect("determined") - 0.05).abs() < 1e-4);
    }

    /// Errors that are constant within each of 50 windows: the variance of a mean is that of the
    /// windows' means.
    #[test]
    fn the_sandwich_sees_correlation_within_windows() {
        let (windows, each) = (50_usize, 20_usize);
        let level = |w: usize| ((w * 7919 + 13) % 101) as f64 / 50.0 - 1.0;
        let mean = (0..windows).map(level).sum::<f64>() / windows as f64;
        let share = 1.0 / (windows * each) as f64;
        let e: Vec<f64> = (0..windows)
            .flat_map(|w| std::iter::repeat_n((level(w) - mean) * share.sqrt(), each))
            .collect();
        let hessian = Mat::from_fn(1, 1, |_, _| 2.0);
        let scores: Vec<f64> = (0..windows)
            .map(|w| -2.0 * share * each as f64 * (level(w) - mean))
            .collect();
        let mut solved = solved(&hessian, &[0], &[1.0], &[-10.0], &[10.0], &e, 1);
        (solved.share, solved.scores) = (share, Some(scores));
        let found = from_hessian(&solved).deviations[0].expect("determined");
        let w = windows as f64;
        let variance = (0..windows).map(|k| (level(k) - mean).powi(2)).sum::<f64>() / (w - 1.0);
        assert!((found - (variance / w).sqrt()).abs() < 1e-12);
    }

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
        let spread = from_hessian(&solved(&hessian, &[0], &[1.0], &[-10.0], &[10.0], &e, 1));
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
        let (low, high) = ([-10.0; 3], [10.0; 3]);
        let spread = from_hessian(&solved(&hessian, &[0, 1, 2], &[1.0; 3], &low, &high, &e, 3));
        assert_eq!(spread.undetermined, 1);
        assert!(spread.deviations[0].is_none() && spread.deviations[1].is_none());
        assert!(spread.deviations[2].is_some());
        // It is named: one goes up as the other goes down.
        let open = &spread.open[0];
        assert_eq!((open.len(), open[0].0, open[1].0), (2, 0, 1));
        assert!((open[0].1 + open[1].1).abs() < 1e-9, "{open:?}");
    }

    #[test]
    fn autocorrelation_of_a_first_order_process_is_found() {
        let mut x = 0.0;
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let series: Vec<f64> = (0..200_000)
            .map(|_| {
                x = 0.8 * x + random.random_range(-0.5..0.5);
                x
            })
            .collect();
        let factor = correlation_factor(&series, 1);
        assert!((factor - 9.0).abs() < 0.4, "{factor}");
    }
}
