//! Settings of the solvers.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How the barrier parameter goes to zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Barrier {
    /// Each barrier problem is solved to a share of its parameter before the next one (Fiacco-McCormick).
    Monotone,
    /// The parameter is chosen anew every iteration while the optimality error keeps falling,
    /// monotone otherwise (J. Nocedal, A. Wächter, R. A. Waltz, SIAM J. Optim. 19 (2009)).
    Adaptive(Oracle),
}

/// Where the barrier parameter of a free iteration comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Oracle {
    /// From how uneven the complementarity products are (R. J. Vanderbei, LOQO, 1999).
    Loqo,
    /// From the affine step: `σ = (μ_aff / μ)³` (S. Mehrotra 1992).
    Probing,
    /// Minimises a linear model of the optimality error along centring and affine step (Nocedal,
    /// Wächter, Waltz 2009).
    Quality,
}

/// A flag by which another thread or a signal handler stops a solve. Clones share the flag.
#[derive(Debug, Clone, Default)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Asks the solver to stop; it returns its best point after the evaluation it is in.
    pub fn stop(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether a stop was asked for.
    pub fn is_stopped(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Two interrupts are equal if they share their flag.
impl PartialEq for Interrupt {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

/// Settings of the solvers.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Scaled optimality error at which the solver stops.
    pub tol: f64,
    /// Error that is good enough if 15 iterations in a row do not halve it, or if no step gets on.
    pub acceptable_tol: f64,
    /// Absolute constraint violation, ∞-norm in the problem's units, that `Solved` also needs.
    pub constraint_tol: f64,
    /// Iterations after which the solver stops.
    pub max_iterations: usize,
    /// Time after which the solver stops.
    pub max_time: Option<Duration>,
    /// Flag that stops the solver from outside.
    pub interrupt: Option<Interrupt>,
    /// First barrier parameter, relative to the scaled objective.
    pub mu_start: f64,
    /// Strategy for the barrier parameter.
    pub barrier: Barrier,
    /// Largest component of the scaled gradient at the start; the objective is scaled to it when it
    /// is larger.
    pub max_gradient: f64,
    /// Whether constraint rows whose gradient exceeds `max_gradient` at the start are scaled down to it.
    pub scale_constraints: bool,
    /// Factor on the objective before anything else. For a sum of squares divided by N it is N.
    pub objective_scale: f64,
    /// How far a start is pushed off its bounds, relative to their distance.
    pub push: f64,
    /// How far bounds are widened, relative to max(1, |bound|). A feasible set without interior
    /// needs 1e-8 here. The returned point satisfies the bounds on the variables as given.
    pub bound_relaxation: f64,
    /// Second-order corrections tried per iteration.
    pub max_corrections: usize,
    /// After this many halvings of a step, directions that the problem hardly determines are
    /// shortened alone, if the linear system can do so (see [`crate::solver::kkt::Kkt::limit`]); 0
    /// for never. Has no effect beside a watchdog.
    pub patience: usize,
    /// After this many iterations with shortened steps, full steps are tried without asking the
    /// filter; 0 for never.
    pub watchdog: usize,
    /// So many iterations may reduce the optimality error instead of satisfying the filter before a
    /// restoration phase begins.
    pub soft_restoration: usize,
    /// Most iterations of a restoration phase. With 0 the run ends where one would begin.
    pub max_restoration: usize,
    /// ‖x‖∞ above which the problem counts as unbounded.
    pub divergence: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            tol: 1e-8,
            acceptable_tol: 1e-6,
            constraint_tol: 1e-6,
            max_iterations: 1000,
            max_time: None,
            interrupt: None,
            mu_start: 0.1,
            barrier: Barrier::Monotone,
            max_gradient: 100.0,
            scale_constraints: true,
            objective_scale: 1.0,
            push: 1e-2,
            bound_relaxation: 0.0,
            max_corrections: 4,
            patience: 2,
            watchdog: 10,
            soft_restoration: 10,
            max_restoration: 200,
            divergence: 1e20,
        }
    }
}
