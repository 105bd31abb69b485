//! Settings of the search.

use pid_nlp::solver;

use super::criterion::Criterion;

/// Settings of the search for a motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Length of a period, s.
    pub period: f64,
    /// Harmonics of the series.
    pub harmonics: usize,
    /// Samples per period at which information is gathered and limits hold.
    pub samples: usize,
    /// The criterion.
    pub criterion: Criterion,
    /// Standard deviation of the force at each joint, N·m or N; empty: 1 everywhere.
    pub deviations: Vec<f64>,
    /// Share of each limit that stays free, as a reserve for the motion between the samples.
    pub margin: f64,
    /// Whether velocity and acceleration vanish where a period begins.
    pub at_rest: bool,
    /// Random starts; the best result is returned.
    pub starts: usize,
    /// Seed of everything random.
    pub seed: u64,
    /// Settings of the solver.
    pub solver: solver::Settings,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            period: 10.0,
            harmonics: 5,
            samples: 100,
            criterion: Criterion::Determinant,
            deviations: Vec::new(),
            margin: 0.02,
            at_rest: true,
            starts: 3,
            seed: 0,
            solver: solver::Settings {
                tol: 1e-6,
                max_iterations: 300,
                ..solver::Settings::default()
            },
        }
    }
}
