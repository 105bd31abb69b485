//! Detects iterates that alternate between two points.
//!
//! About a kink, such as friction that changes its sign at one sample of a long record, whole
//! Newton steps may lead from one side to the other and back without end: the filter's margins are
//! small, and the objective falls by them. Half of such a step ends it.

/// Two violations are the same if they differ by less than 2 %, and different if they differ by
/// more than 10 %.
const SAME: f64 = 0.02;
const OTHER: f64 = 0.1;
/// The step is halved after this many turns in a row.
const TURNS: usize = 4;

/// Violations of the last two points, and how often in a row a point came back to the violation
/// before the last one.
#[derive(Debug)]
pub(super) struct Turns {
    before: f64,
    last: f64,
    count: usize,
}

impl Turns {
    pub(super) fn new() -> Self {
        Self {
            before: f64::NAN,
            last: f64::NAN,
            count: 0,
        }
    }

    /// Records the violation of the next point.
    pub(super) fn record(&mut self, theta: f64) {
        let same = (theta - self.before).abs() <= SAME * self.before;
        let back = same && (theta - self.last).abs() > OTHER * self.last.max(theta);
        self.count = if back { self.count + 1 } else { 0 };
        (self.before, self.last) = (self.last, theta);
    }

    /// The next step begins with this share of its longest length.
    pub(super) fn share(&self) -> f64 {
        if self.count >= TURNS { 0.5 } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_halved_after_turns_in_a_row_and_only_then() {
        let mut turns = Turns::new();
        let mut shares = Vec::new();
        for theta in [1.0, 0.5, 1.01, 0.5, 1.0, 0.505, 0.2, 0.5, 0.2] {
            turns.record(theta);
            shares.push(turns.share());
        }
        assert_eq!(shares, [1.0, 1.0, 1.0, 1.0, 1.0, 0.5, 1.0, 1.0, 1.0]);
    }

    #[test]
    fn a_violation_that_rests_or_falls_is_no_turn() {
        for ratio in [1.0, 0.99, 0.5] {
            let mut turns = Turns::new();
            for k in 0..20 {
                turns.record(f64::powi(ratio, k));
                assert_eq!(turns.share(), 1.0);
            }
        }
    }
}
