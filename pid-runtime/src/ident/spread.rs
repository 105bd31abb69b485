//! Standard deviations and noise levels of a solved trajectory program, whatever its transcription.

use super::likelihood;
use super::uncertainty::{self, Solved, Spread};
use crate::nlp::Nlp;
use crate::solver::Solution;
use crate::solver::kkt::structured::StructuredKkt;
use crate::solver::kkt::{Kkt, KktValues};
use crate::transcribe::{FullDiscretization, Setup, Shooting, ShootingKkt};
use faer::Mat;

/// A linear system that condenses the program to its parameters.
pub(super) trait Condensing: Kkt {
    /// Hessian of the objective in the free parameters, scaled, with their positions.
    fn reduced_hessian(&self) -> (&Mat<f64>, Vec<usize>);
}

impl Condensing for StructuredKkt {
    fn reduced_hessian(&self) -> (&Mat<f64>, Vec<usize>) {
        self.reduced_hessian()
    }
}

impl Condensing for ShootingKkt {
    fn reduced_hessian(&self) -> (&Mat<f64>, Vec<usize>) {
        self.reduced_hessian()
    }
}

/// A program over the motions of all windows and the parameters.
pub(super) trait Motions: Nlp {
    /// Its linear system.
    type System: Condensing;
    fn setup(&self) -> &Setup;
    /// Parameters in a point, in their own units.
    fn parameters(&self, x: &[f64]) -> Vec<f64>;
    /// Weighted residuals, windows apart by NaN, and the number of channels.
    fn residuals(&mut self, x: &[f64]) -> (Vec<f64>, usize);
    fn window_scores(&mut self, x: &[f64], lambda: &[f64]) -> Vec<f64>;
    /// Samples in all windows.
    fn samples(&self) -> usize;
    /// Initial states that are unknown beside the parameters.
    fn free_initial_states(&self) -> usize;
    /// The linear system with some parameters held.
    fn system(&self, held: &[bool]) -> Self::System;
}

macro_rules! motions {
    ($problem:ident, $system:ty, $build:expr) => {
        impl Motions for $problem<'_> {
            type System = $system;
            fn setup(&self) -> &Setup {
                self.setup()
            }
            fn parameters(&self, x: &[f64]) -> Vec<f64> {
                self.parameters(x)
            }
            fn residuals(&mut self, x: &[f64]) -> (Vec<f64>, usize) {
                self.residuals(x)
            }
            fn window_scores(&mut self, x: &[f64], lambda: &[f64]) -> Vec<f64> {
                self.window_scores(x, lambda)
            }
            fn samples(&self) -> usize {
                self.samples()
            }
            fn free_initial_states(&self) -> usize {
                self.free_initial_states()
            }
            fn system(&self, held: &[bool]) -> Self::System {
                $build(self, held)
            }
        }
    };
}

motions!(
    FullDiscretization,
    StructuredKkt,
    |problem: &FullDiscretization<'_>, held: &[bool]| problem.system(held)
);
motions!(Shooting, ShootingKkt, ShootingKkt::new);

/// Standard deviations from the reduced Hessian at the solution, and the noise level of every channel where it can be told.
pub(super) fn deviations<P: Motions>(
    problem: &mut P,
    solution: &Solution,
    fixed: &[bool],
    weights: &[f64],
    sandwich: bool,
) -> (Spread, Vec<Option<f64>>) {
    let np = fixed.len();
    if !solution.objective.is_finite() {
        return (Spread::none(np), vec![None; weights.len()]);
    }
    let parameters = problem.parameters(&solution.x);
    let setup = problem.setup().clone();
    let held: Vec<bool> = (0..np)
        .map(|j| fixed[j] || uncertainty::at_bound(parameters[j], setup.lower[j], setup.upper[j]))
        .collect();
    let mut kkt = problem.system(&held);
    let mut jacobian = vec![0.0; problem.jacobian_pattern().nnz()];
    let mut hessian = vec![0.0; problem.hessian_pattern().nnz()];
    problem.jacobian(&solution.x, &mut jacobian);
    problem.hessian(&solution.x, 1.0, &solution.lambda, &mut hessian);
    let sigma = vec![0.0; problem.n()];
    let values = KktValues {
        hessian: &hessian,
        jacobian: &jacobian,
        sigma: &sigma,
    };
    let (residuals, channels) = problem.residuals(&solution.x);
    let share = 1.0 / problem.samples() as f64;
    let unknowns = held.iter().filter(|h| !**h).count() + problem.free_initial_states();
    let noise = likelihood::levels(&residuals, weights, setup.loss, share, unknowns);
    if kkt.factorise(values).is_err() {
        return (Spread::none(np), noise);
    }
    let scores = sandwich.then(|| problem.window_scores(&solution.x, &solution.lambda));
    let (reduced, free) = kkt.reduced_hessian();
    let spread = uncertainty::from_hessian(&Solved {
        hessian: reduced,
        free: &free,
        scale: &setup.scale,
        lower: &setup.lower,
        upper: &setup.upper,
        loss: setup.loss,
        priors: &setup.priors,
        share,
        residuals: &residuals,
        channels,
        unknowns,
        scores,
    });
    (spread, noise)
}
