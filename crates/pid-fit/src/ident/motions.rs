//! The interface between an identification and its program, the same for every transcription, with
//! or without constraints of the user.

use crate::transcribe::{
    Constrained, ConstrainedKkt, Curvature, FullDiscretization, Setup, Shooting, ShootingKkt,
    Structured,
};
use pid_nlp::Nlp;
use pid_nlp::solver::Solution;
use pid_nlp::solver::kkt::sparse::SparseKkt;
use pid_nlp::solver::kkt::structured::StructuredKkt;
use pid_nlp::solver::kkt::{Condensing, Kkt};

/// Relative residual at which a Newton step counts as solved. Against 1e-11 it saves two fifths of
/// the solves and costs no iteration on the two-link study.
const REFINED: f64 = 1e-9;

/// Penalty that pins the directions of active user constraints when standard deviations are
/// computed. The objective's curvature is about 1, so these directions keep a thousandth of their
/// deviation. The solver's 1e8 would drown directions that the data hardly determine in rounding.
const STIFF: f64 = 1e6;

/// A program over the motions of all windows and the parameters.
pub(super) trait Motions: Nlp {
    /// The linear system that condenses it to its parameters.
    type System: Condensing;
    fn setup(&self) -> &Setup;
    /// Parameters in a point, in their own units.
    fn parameters(&self, x: &[f64]) -> Vec<f64>;
    /// States (q, v) at the samples, windows one after another; empty if a motion does not exist.
    fn states(&mut self, x: &[f64]) -> Vec<f64>;
    /// Weighted residuals, windows apart by NaN, and the number of channels.
    fn residuals(&mut self, x: &[f64]) -> (Vec<f64>, usize);
    fn window_scores(&mut self, x: &[f64], lambda: &[f64]) -> Vec<f64>;
    /// Value of the bodies' barrier in the objective.
    fn barrier(&mut self, x: &[f64]) -> f64;
    /// Samples in all windows.
    fn samples(&self) -> usize;
    /// Initial states that are unknown beside the parameters.
    fn free_initial_states(&self) -> usize;
    /// Chooses the second derivatives for the solver.
    fn curve(&mut self, curvature: Curvature);
    /// The linear system with some parameters held, for standard deviations.
    fn system(&self, held: &[bool]) -> Self::System;
    /// The linear system that solves the program.
    fn linear(&self) -> Box<dyn Kkt>;
    /// Extends a start of the program without user constraints to a start of this program.
    fn extend(&mut self, x: Vec<f64>) -> Vec<f64> {
        x
    }
    /// Puts a large diagonal where inequalities of the user hold a solution.
    fn stiffen(&self, solution: &Solution, sigma: &mut [f64]) {
        let _ = (solution, sigma);
    }
    /// Remarks on the constraints of the user.
    fn remarks(&self, solution: &Solution) -> Vec<String> {
        let _ = solution;
        Vec::new()
    }
}

/// A program around one of a transcription, or the transcription itself.
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
