//! Bounds on the variables and their barrier terms.

/// Bounds; variables whose bounds are equal are held.
#[derive(Debug, Clone)]
pub(super) struct Bounds {
    pub(super) lower: Vec<f64>,
    pub(super) upper: Vec<f64>,
    pub(super) fixed: Vec<bool>,
    /// Number of finite bounds on free variables.
    pub(super) count: usize,
}

impl Bounds {
    pub(super) fn new(lower: Vec<f64>, upper: Vec<f64>) -> Self {
        let fixed: Vec<bool> = lower.iter().zip(&upper).map(|(l, u)| l == u).collect();
        let mut bounds = Self {
            lower,
            upper,
            fixed,
            count: 0,
        };
        bounds.count = (0..bounds.fixed.len())
            .map(|j| usize::from(bounds.has_lower(j)) + usize::from(bounds.has_upper(j)))
            .sum();
        bounds
    }

    pub(super) fn has_lower(&self, j: usize) -> bool {
        self.lower[j].is_finite() && !self.fixed[j]
    }

    pub(super) fn has_upper(&self, j: usize) -> bool {
        self.upper[j].is_finite() && !self.fixed[j]
    }

    /// f − μ Σ ln(distances).
    pub(super) fn barrier(&self, f: f64, x: &[f64], mu: f64) -> f64 {
        let mut phi = f;
        for (j, &x) in x.iter().enumerate() {
            if self.has_lower(j) {
                phi -= mu * (x - self.lower[j]).ln();
            }
            if self.has_upper(j) {
                phi -= mu * (self.upper[j] - x).ln();
            }
        }
        phi
    }

    /// Largest step length in (0, 1] that keeps x + α d a share 1 − τ of each distance away from its bound.
    pub(super) fn fraction(&self, x: &[f64], d: &[f64], tau: f64) -> f64 {
        let mut alpha = 1.0_f64;
        for (j, &d) in d.iter().enumerate() {
            if d < 0.0 && self.has_lower(j) {
                alpha = alpha.min(-tau * (x[j] - self.lower[j]) / d);
            } else if d > 0.0 && self.has_upper(j) {
                alpha = alpha.min(tau * (self.upper[j] - x[j]) / d);
            }
        }
        alpha
    }

    /// Widens the bounds by `relaxation · max(1, |bound|)`; held variables stay held.
    pub(super) fn relax(&mut self, relaxation: f64) {
        for j in 0..self.fixed.len() {
            if self.has_lower(j) {
                self.lower[j] -= relaxation * self.lower[j].abs().max(1.0);
            }
            if self.has_upper(j) {
                self.upper[j] += relaxation * self.upper[j].abs().max(1.0);
            }
        }
    }
}

/// A point pushed off its bounds by `push` of their distance (Wächter & Biegler, section 3.6).
pub(super) fn interior(x: f64, lower: f64, upper: f64, push: f64) -> f64 {
    if lower == upper {
        return lower;
    }
    let width = upper - lower;
    let room = |bound: f64| (push * bound.abs().max(1.0)).min(push * width);
    match (lower.is_finite(), upper.is_finite()) {
        (true, true) => x.clamp(lower + room(lower), upper - room(upper)),
        (true, false) => x.max(lower + push * lower.abs().max(1.0)),
        (false, true) => x.min(upper - push * upper.abs().max(1.0)),
        (false, false) => x,
    }
}
