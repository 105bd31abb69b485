//! How much of a run is done, as far as its news tell.

use std::sync::Mutex;

use pid_fit::identify::News;
use pid_nlp::solver::Iteration;

/// Part of an identification without draws that is the fit; free runs and forces take the rest.
const FIT: f64 = 0.7;

/// The course of iterations from several starts, and of the draws after them.
pub(crate) struct Course {
    tolerance: f64,
    draws: usize,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    start: usize,
    /// Error at the first iteration of the start, and the least since.
    errors: Option<(f64, f64)>,
    drawn: usize,
    /// The largest share so far.
    share: f64,
}

impl Course {
    /// Of iterations that end at a tolerance, and so many draws.
    pub(crate) fn new(tolerance: f64, draws: usize) -> Self {
        Course {
            tolerance,
            draws,
            state: Mutex::default(),
        }
    }

    /// Share of an identification that is done, from 0 to 1; it never falls.
    pub(crate) fn identified(&self, news: &News<'_>) -> f64 {
        let units = 1.0 + self.draws as f64;
        match news {
            News::Fit(i) => {
                let fit = self.converged((i.start, i.starts), i.iteration);
                self.least(FIT * fit / units)
            }
            News::Bootstrap => {
                // The first news comes before the first draw.
                let drawn = self.state.lock().map_or(0, |mut state| {
                    state.drawn += 1;
                    state.drawn - 1
                });
                self.least((FIT + drawn as f64) / units)
            }
            _ => self.least(0.0),
        }
    }

    /// Share of the starts that are done: orders of magnitude of the error between the first iteration
    /// and the tolerance.
    pub(crate) fn converged(&self, (start, starts): (usize, usize), i: &Iteration) -> f64 {
        let Ok(mut state) = self.state.lock() else {
            return 0.0;
        };
        let error = i.primal_inf.max(i.dual_inf).max(i.mu).max(self.tolerance);
        if state.start != start {
            state.start = start;
            state.errors = None;
        }
        let (first, least) = state.errors.unwrap_or((error, error));
        let errors = (first.max(error), least.min(error));
        state.errors = Some(errors);
        let orders = |error: f64| (error / self.tolerance).ln();
        let whole = orders(errors.0);
        let share = if whole > 0.0 {
            1.0 - orders(errors.1) / whole
        } else {
            0.0
        };
        (start as f64 + share) / starts.max(1) as f64
    }

    fn least(&self, share: f64) -> f64 {
        self.state.lock().map_or(share, |mut state| {
            state.share = state.share.max(share);
            state.share
        })
    }
}

/// The course of a diagnosis by the names of its steps. How many rounds a search has is not known before
/// its end, so each round counts as a part of what is left.
#[derive(Default)]
pub(crate) struct Search(Mutex<f64>);

/// Steps by a part of their names, and the share of a search that is done at the first of them.
const STEPS: [(&str, f64); 6] = [
    ("nominal parameters", 0.02),
    ("candidates for effect", 0.1),
    ("friction outside", 0.15),
    ("shares of the gap", 0.2),
    ("where the gap lives", 0.8),
    ("what any cause can remove", 0.85),
];
/// Part of what is left that a further step of a kind takes.
const ROUND: f64 = 0.15;

impl Search {
    /// Share of a diagnosis that is done where a step begins, from 0 to 1; it never falls.
    pub(crate) fn begins(&self, step: &str) -> f64 {
        let first = STEPS.iter().find(|(part, _)| step.contains(part));
        let first = first.map_or(0.0, |(_, share)| *share);
        self.0.lock().map_or(first, |mut share| {
            *share = if *share < first {
                first
            } else {
                *share + ROUND * (1.0 - *share)
            };
            *share
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_search_comes_nearer_to_its_end_with_every_step() {
        let search = Search::default();
        let steps = [
            "nominal parameters",
            "47 candidates for effect 1",
            "shares of the gap: the first effect",
            "shares of the gap: beside backlash:2",
            "where the gap lives, and the next experiment",
            "what any cause can remove at most",
        ];
        let shares = steps.map(|step| search.begins(step));
        for (share, expected) in shares.iter().zip([0.02, 0.1, 0.2, 0.32, 0.8, 0.85]) {
            assert!((share - expected).abs() < 1e-12, "{shares:?}");
        }
    }

    fn iteration(error: f64) -> Iteration {
        Iteration {
            iteration: 0,
            objective: 1.0,
            primal_inf: error,
            dual_inf: 0.0,
            mu: 0.0,
            step: 0.0,
            regularisation: 0.0,
            alpha_dual: 1.0,
            alpha: 1.0,
            trials: 1,
            kind: 'f',
        }
    }

    #[test]
    fn the_share_counts_orders_of_magnitude_start_by_start() {
        let course = Course::new(1e-8, 0);
        let share = |start, error| course.converged((start, 2), &iteration(error));
        assert_eq!(share(0, 1.0), 0.0);
        assert!((share(0, 1e-4) - 0.25).abs() < 1e-12);
        // A step back does not undo what was reached.
        assert!((share(0, 1e-2) - 0.25).abs() < 1e-12);
        assert!((share(0, 1e-9) - 0.5).abs() < 1e-12);
        assert!((share(1, 1.0) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn draws_count_as_much_as_the_fit() {
        let course = Course::new(1e-8, 3);
        let shares: Vec<f64> = (0..4)
            .map(|_| course.identified(&News::Bootstrap))
            .collect();
        assert_eq!(shares, [0.7 / 4.0, 1.7 / 4.0, 2.7 / 4.0, 3.7 / 4.0]);
    }
}
