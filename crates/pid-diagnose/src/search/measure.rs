//! What hypotheses are compared by: their gain in likelihood, and the gap they leave.

use pid_data::Role;

use crate::case::Case;
use crate::fit::{Fit, value};
use crate::gap::{Floor, Gap, floor, gap};

/// Gap of a fit on the test records.
pub(super) fn measured(case: &Case, fit: &Fit) -> Gap {
    gap(
        case,
        &fit.hypothesis,
        &fit.point.theta,
        &fit.point.e,
        Role::Test,
    )
}

/// The gap that noise alone leaves on the test records.
pub(super) fn noise_alone(case: &Case, fit: &Fit) -> Floor {
    floor(
        case,
        &fit.hypothesis,
        &fit.point.theta,
        &fit.point.e,
        Role::Test,
    )
}

/// Share of the squared gap beyond the floor that a model with the gap `after` explains, 0 to 1.
pub(crate) fn share(before: f64, after: f64, floor: f64) -> f64 {
    let possible = before * before - floor * floor;
    if possible > 0.0 {
        ((before * before - after * after) / possible).clamp(0.0, 1.0)
    } else {
        0.0
    }
}

/// What a fit reaches: the one figure by which hypotheses are compared.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reached {
    /// Minus twice the log posterior on the train records.
    train: f64,
    /// Minus twice the log-likelihood on the test records.
    test: f64,
    /// Parameters of the effects.
    parameters: usize,
}

impl Reached {
    /// Runs a fit over the test records.
    pub(super) fn new(case: &Case, fit: &Fit) -> Self {
        let test = value(case, &fit.hypothesis, &fit.point, &fit.gains, Role::Test);
        Reached {
            train: fit.train.evidence(),
            test: test.surprise(),
            parameters: fit.point.e.len(),
        }
    }

    /// Twice the gain in log-likelihood of `self` over another fit of the same records on the test
    /// records alone.
    pub(super) fn held_out(&self, over: &Self) -> f64 {
        over.test - self.test
    }

    /// Twice the gain in log-likelihood of `self` over another fit of the same records, of which
    /// `number` are fitted, less ln N per further parameter (G. Schwarz, Ann. Stat. 6, 1978);
    /// `scale`: mean square that counts as noise. What is gained where nothing was fitted counts
    /// alike.
    pub(super) fn gain(&self, over: &Self, scale: f64, number: f64) -> f64 {
        let further = self.parameters as f64 - over.parameters as f64;
        (over.train - self.train + self.held_out(over)) / scale - further * number.ln()
    }
}

/// Mean square of the innovations of a fit that counts as noise: at least 1.
pub(super) fn noise_scale(fit: &Fit) -> f64 {
    (fit.train.objective() / fit.train.number()).max(1.0)
}

/// Mean squared innovation of a fit on the train records.
pub(super) fn misfit(fit: &Fit) -> f64 {
    fit.train.total() / fit.train.number()
}

#[cfg(test)]
mod tests {
    use super::share;

    #[test]
    fn the_explained_share_is_that_of_squares_beyond_the_floor() {
        // Half of the square between 0.5² and 0.1².
        let half = f64::sqrt(0.5 * (0.25 + 0.01));
        assert!((share(0.5, half, 0.1) - 0.5).abs() < 1e-12);
        assert_eq!(share(0.5, 0.05, 0.1), 1.0);
        assert_eq!(share(0.5, 0.6, 0.1), 0.0);
        // Nothing to explain.
        assert_eq!(share(0.1, 0.05, 0.1), 0.0);
    }
}
