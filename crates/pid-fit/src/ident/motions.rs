//! What an identification asks of a program over the motions of all windows, whatever its transcription and with constraints of the
//! user or without.

use crate::transcribe::{
    Constrained, ConstrainedKkt, Curvature, FullDiscretization, Setup, Shooting, ShootingKkt,
    Structured,
};
use pid_nlp::Nlp;
use pid_nlp::solver::Solution;
use pid_nlp::solver::kkt::sparse::SparseKkt;
use pid_nlp::solver::kkt::structured::StructuredKkt;
use pid_nlp::solver::kkt::{Condensing, Kkt};

/// Relative residual of a Newton step: on the two-link study no iteration more than with 1e-11, and two fifths of the solves less.
const REFINED: f64 = 1e-9;

/// Curvature of what constraints hold, where an objective in shares of the channels' spread has about one: their directions get a
/// thousandth of the deviation, and those that the data hardly determine are not lost in rounding.
const STIFF: f64 = 1e6;

/// A program over the motions of all windows and the parameters.
pub(super) trait Motions: Nlp {
    /// The linear system that condenses it to its parameters.
    type System: Condensing;
    fn setup(&self) -> &Setup;
    /// Parameters in a point, in their own units.
    fn parameters(&self, x: &[f64]) -> Vec<f64>;
    /// States (q, v) at the samples, windows one after another; empty where a motion does not exist.
    fn states(&mut self, x: &[f64]) -> Vec<f64>;
    /// Weighted residuals, windows apart by NaN, and the number of channels.
    fn residuals(&mut self, x: &[f64]) -> (Vec<f64>, usize);
    fn window_scores(&mut self, x: &[f64], lambda: &[f64]) -> Vec<f64>;
    /// What the barrier of links kept bodies adds to the objective.
    fn barrier(&mut self, x: &[f64]) -> f64;
    /// Samples in all windows.
    fn samples(&self) -> usize;
    /// Initial states that are unknown beside the parameters.
    fn free_initial_states(&self) -> usize;
    /// Changes the second derivatives that are given to the solver.
    fn curve(&mut self, curvature: Curvature);
    /// The linear system with some parameters held, as deviations want it.
    fn system(&self, held: &[bool]) -> Self::System;
    /// The linear system that solves the program.
    fn linear(&self) -> Box<dyn Kkt>;
    /// A start of the program without constraints of the user as one of this.
    fn extend(&mut self, x: Vec<f64>) -> Vec<f64> {
        x
    }
    /// Puts a large diagonal where a solution is held by inequalities of the user.
    fn stiffen(&self, solution: &Solution, sigma: &mut [f64]) {
        let _ = (solution, sigma);
    }
    /// What is to be said of the constraints of the user.
    fn remarks(&self, solution: &Solution) -> Vec<String> {
        let _ = solution;
        Vec::new()
    }
}

/// A program around one of a transcription, or that one.
pub(super) trait Around<P>: Motions {
    fn program(&self) -> &P;
    fn program_mut(&mut self) -> &mut P;
}

macro_rules! motions {
    ($problem:ident, $system:ty, $build:expr, $linear:expr, $states:expr) => {
        impl Motions for $problem<'_> {
            type System = $system;
            fn setup(&self) -> &Setup {
                self.setup()
            }
            fn parameters(&self, x: &[f64]) -> Vec<f64> {
                self.parameters(x)
            }
            fn states(&mut self, x: &[f64]) -> Vec<f64> {
                $states(self, x)
            }
            fn residuals(&mut self, x: &[f64]) -> (Vec<f64>, usize) {
                self.residuals(x)
            }
            fn window_scores(&mut self, x: &[f64], lambda: &[f64]) -> Vec<f64> {
                self.window_scores(x, lambda)
            }
            fn barrier(&mut self, x: &[f64]) -> f64 {
                $problem::barrier(self, x)
            }
            fn samples(&self) -> usize {
                self.samples()
            }
            fn free_initial_states(&self) -> usize {
                self.free_initial_states()
            }
            fn curve(&mut self, curvature: Curvature) {
                self.set_curvature(curvature);
            }
            fn system(&self, held: &[bool]) -> Self::System {
                $build(self, held)
            }
            fn linear(&self) -> Box<dyn Kkt> {
                $linear(self)
            }
        }

        impl<'m> Around<$problem<'m>> for $problem<'m> {
            fn program(&self) -> &$problem<'m> {
                self
            }
            fn program_mut(&mut self) -> &mut $problem<'m> {
                self
            }
        }

        impl<'m> Around<$problem<'m>> for Constrained<$problem<'m>> {
            fn program(&self) -> &$problem<'m> {
                self.inner()
            }
            fn program_mut(&mut self) -> &mut $problem<'m> {
                self.inner_mut()
            }
        }
    };
}

motions!(
    FullDiscretization,
    StructuredKkt,
    |problem: &FullDiscretization<'_>, held: &[bool]| problem.system(held),
    |problem: &FullDiscretization<'_>| -> Box<dyn Kkt> {
        if problem.layout().steps() == 0 {
            return Box::new(SparseKkt::new(problem));
        }
        let fixed = problem.fixed_parameters();
        Box::new(problem.system(&fixed).refined_to(REFINED))
    },
    |problem: &FullDiscretization<'_>, x: &[f64]| problem.states(x)
);
motions!(
    Shooting,
    ShootingKkt,
    ShootingKkt::new,
    |problem: &Shooting<'_>| -> Box<dyn Kkt> { Box::new(ShootingKkt::from(problem)) },
    |problem: &mut Shooting<'_>, x: &[f64]| problem.states(x).unwrap_or_default()
);

impl<P: Motions + Structured> Motions for Constrained<P> {
    type System = ConstrainedKkt;
    fn setup(&self) -> &Setup {
        self.inner().setup()
    }
    fn parameters(&self, x: &[f64]) -> Vec<f64> {
        self.inner().parameters(&x[..self.inner().n()])
    }
    fn states(&mut self, x: &[f64]) -> Vec<f64> {
        let n = self.inner().n();
        self.inner_mut().states(&x[..n])
    }
    fn residuals(&mut self, x: &[f64]) -> (Vec<f64>, usize) {
        let n = self.inner().n();
        self.inner_mut().residuals(&x[..n])
    }
    fn window_scores(&mut self, x: &[f64], lambda: &[f64]) -> Vec<f64> {
        let (n, m) = (self.inner().n(), self.inner().m());
        self.inner_mut().window_scores(&x[..n], &lambda[..m])
    }
    fn barrier(&mut self, x: &[f64]) -> f64 {
        let n = self.inner().n();
        self.inner_mut().barrier(&x[..n])
    }
    fn samples(&self) -> usize {
        self.inner().samples()
    }
    fn free_initial_states(&self) -> usize {
        self.inner().free_initial_states()
    }
    fn curve(&mut self, curvature: Curvature) {
        self.inner_mut().curve(curvature);
    }
    fn system(&self, held: &[bool]) -> Self::System {
        ConstrainedKkt::new(self, held).with_stiffness(STIFF)
    }
    fn linear(&self) -> Box<dyn Kkt> {
        let setup = self.setup();
        let bounds = setup.lower.iter().zip(&setup.upper);
        let held: Vec<bool> = bounds.map(|(l, u)| l == u).collect();
        Box::new(ConstrainedKkt::new(self, &held))
    }
    fn extend(&mut self, x: Vec<f64>) -> Vec<f64> {
        Constrained::extend(self, &x)
    }
    fn stiffen(&self, solution: &Solution, sigma: &mut [f64]) {
        let held = self.held(&solution.x, &solution.z_lower, self.samples());
        let own = &mut sigma[self.inner().n()..];
        for (sigma, _) in own.iter_mut().zip(held).filter(|(_, held)| *held) {
            *sigma = STIFF;
        }
    }
    fn remarks(&self, solution: &Solution) -> Vec<String> {
        Constrained::remarks(self, &solution.x, &solution.z_lower, self.samples())
    }
}
