//! What a solver returns: a status, the point, and the work it took.

use serde::{Deserialize, Serialize};

/// Why the solver stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Status {
    /// The first-order conditions hold to the tolerance.
    Solved,
    /// They hold to the acceptable tolerance and no progress was made beyond it.
    Acceptable,
    /// The iteration limit was reached.
    IterationLimit,
    /// The time limit was reached.
    TimeLimit,
    /// The caller asked it to stop.
    Interrupted,
    /// The constraint violation is at a local minimum above zero: the constraints cannot be met near here.
    LocallyInfeasible,
    /// The iterates leave every bounded set, or the objective falls without end along feasible points.
    Unbounded,
    /// The feasibility problem of a restoration phase could not be solved.
    RestorationFailed,
    /// A derivative is not finite at a point whose values are.
    InvalidNumber,
    /// Neither a step nor a restoration from this point makes progress.
    NoProgress,
    /// The problem cannot be evaluated at the starting point.
    CannotEvaluate,
    /// The linear system has no usable factorization.
    SingularSystem,
}

impl Status {
    /// Whether the point satisfies the first-order conditions.
    pub fn converged(self) -> bool {
        matches!(self, Self::Solved | Self::Acceptable)
    }

    /// Whether a limit or the caller ended the solve.
    pub fn is_limit(self) -> bool {
        matches!(
            self,
            Self::IterationLimit | Self::TimeLimit | Self::Interrupted
        )
    }

    /// The reason in words.
    pub fn reason(self) -> &'static str {
        match self {
            Self::Solved => "optimal to the tolerance",
            Self::Acceptable => "optimal to the acceptable tolerance; no further progress",
            Self::IterationLimit => "stopped at the iteration limit",
            Self::TimeLimit => "stopped at the time limit",
            Self::Interrupted => "interrupted; the best point so far is kept",
            Self::LocallyInfeasible => "the constraints cannot be met near this point",
            Self::Unbounded => "unbounded: variables or objective grow without end",
            Self::RestorationFailed => "the constraints could not be restored from this point",
            Self::InvalidNumber => "a derivative is not finite at this point",
            Self::NoProgress => "no step makes progress from this point",
            Self::CannotEvaluate => "the model cannot be evaluated at the starting point",
            Self::SingularSystem => "the linear system could not be factorised",
        }
    }
}

/// One line of the iteration log; the columns are Ipopt's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Iteration {
    /// Number, from 0.
    pub iteration: usize,
    /// Unscaled objective.
    pub objective: f64,
    /// ‖c‖∞.
    pub primal_inf: f64,
    /// ‖∇L‖∞ of the scaled problem.
    pub dual_inf: f64,
    /// Barrier parameter.
    pub mu: f64,
    /// Largest component of the last step.
    pub step: f64,
    /// Regularisation of the Hessian: identity part or largest eigenvalue shift.
    pub regularisation: f64,
    /// Dual and primal step lengths.
    pub alpha_dual: f64,
    /// Primal step length.
    pub alpha: f64,
    /// Trial points of the line search.
    pub trials: usize,
    /// `f` sufficient decrease, `h` filter, `s` second-order correction, `w` watchdog, `S` soft
    /// restoration, `R` restoration, `e` judged by the optimality error since it changes the
    /// objective by less than its rounding, `t` step too small to be judged.
    pub kind: char,
}

impl Iteration {
    /// A line without numbers but for the barrier parameter.
    pub(crate) fn blank(mu: f64) -> Self {
        Self {
            iteration: 0,
            objective: 0.0,
            primal_inf: 0.0,
            dual_inf: 0.0,
            mu,
            step: 0.0,
            regularisation: 0.0,
            alpha_dual: 0.0,
            alpha: 0.0,
            trials: 0,
            kind: ' ',
        }
    }

    /// Heading of [`Iteration::line`].
    pub const HEADING: &'static str =
        "iter       objective    inf_pr   inf_du lg(mu)   ||d||  lg(rg) alpha_du  alpha_pr   ls";

    /// The log line.
    pub fn line(&self) -> String {
        let regularisation = if self.regularisation > 0.0 {
            format!("{:7.1}", self.regularisation.log10())
        } else {
            "     - ".to_owned()
        };
        format!(
            "{:4} {:15.7e} {:9.2e} {:8.2e} {:6.1} {:8.2e} {} {:8.2e} {:8.2e}{} {:3}",
            self.iteration,
            self.objective,
            self.primal_inf,
            self.dual_inf,
            self.mu.log10(),
            self.step,
            regularisation,
            self.alpha_dual,
            self.alpha,
            self.kind,
            self.trials
        )
    }
}

/// Counts of work done.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    /// Evaluations of the objective and constraints.
    pub functions: usize,
    /// Evaluations of gradient and Jacobian.
    pub gradients: usize,
    /// Evaluations of the Hessian.
    pub hessians: usize,
    /// Numeric factorizations.
    pub factorizations: usize,
    /// Restoration phases.
    pub restorations: usize,
}

impl Counts {
    pub(crate) fn add(&mut self, other: &Self) {
        self.functions += other.functions;
        self.gradients += other.gradients;
        self.hessians += other.hessians;
        self.factorizations += other.factorizations;
        self.restorations += other.restorations;
    }
}

/// The outcome of a solve.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// Why the solver stopped.
    pub status: Status,
    /// Variables: the best point found.
    pub x: Vec<f64>,
    /// Multipliers of the constraints, for the unscaled objective.
    pub lambda: Vec<f64>,
    /// Multipliers of lower and upper bounds, for the unscaled objective.
    pub z_lower: Vec<f64>,
    /// Multipliers of upper bounds.
    pub z_upper: Vec<f64>,
    /// Objective at `x`.
    pub objective: f64,
    /// Scaled optimality error at `x` as the solver saw it.
    pub error: f64,
    /// The log.
    pub log: Vec<Iteration>,
    /// Work done.
    pub counts: Counts,
    /// Seconds in evaluations, in the linear system, and in all.
    pub seconds: Seconds,
}

/// Time by kind of work.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Seconds {
    /// Model evaluations.
    pub evaluation: f64,
    /// Factorizations and solves.
    pub linear: f64,
    /// Everything.
    pub total: f64,
}
