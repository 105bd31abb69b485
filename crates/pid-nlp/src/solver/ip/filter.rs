//! The filter: pairs of constraint violation and barrier objective that later points must improve on.
//!
//! A. Wächter, L. T. Biegler, On the implementation of an interior-point filter line-search
//! algorithm for large-scale nonlinear programming, Math. Program. 106 (2006), section 2.3.

/// Margins by which a point must improve on an entry.
pub(in crate::solver) const GAMMA_THETA: f64 = 1e-5;
pub(in crate::solver) const GAMMA_PHI: f64 = 1e-8;

/// Pairs (θ, φ); a point is acceptable if it is better in one of the two than every entry.
#[derive(Debug, Default)]
pub(in crate::solver) struct Filter {
    entries: Vec<(f64, f64)>,
    theta_max: f64,
}

impl Filter {
    pub(in crate::solver) fn new(theta_max: f64) -> Self {
        Self {
            entries: Vec::new(),
            theta_max,
        }
    }

    pub(in crate::solver) fn clear(&mut self) {
        self.entries.clear();
    }

    pub(in crate::solver) fn accepts(&self, theta: f64, phi: f64) -> bool {
        theta < self.theta_max && self.entries.iter().all(|&(t, p)| theta < t || phi < p)
    }

    /// Adds the point with its margins; entries it dominates go.
    pub(in crate::solver) fn add(&mut self, theta: f64, phi: f64) {
        let entry = ((1.0 - GAMMA_THETA) * theta, phi - GAMMA_PHI * theta);
        self.entries.retain(|&(t, p)| t < entry.0 || p < entry.1);
        self.entries.push(entry);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn accepts_what_improves_one_of_both() {
        let mut filter = Filter::new(100.0);
        filter.add(1.0, 10.0);
        assert!(filter.accepts(0.5, 20.0) && filter.accepts(2.0, 9.0));
        assert!(
            !filter.accepts(1.0, 10.0),
            "the point itself needs a margin"
        );
        assert!(!filter.accepts(2.0, 11.0) && !filter.accepts(101.0, 0.0));
        filter.add(0.5, 5.0);
        assert!(!filter.accepts(0.6, 6.0), "dominated by the later entry");
    }
}
