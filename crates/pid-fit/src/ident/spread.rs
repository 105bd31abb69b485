//! Standard deviations and noise levels of a solved trajectory program, whatever its transcription.

use super::motions::Motions;
use super::noise;
use super::uncertainty::{self, Edge, Solved, Spread};
use faer::Mat;
use pid_nlp::solver::Solution;
use pid_nlp::solver::kkt::{Condensing, Kkt, KktValues};

/// Standard deviations from the reduced Hessian at the solution, and the noise level of every
/// channel that has one.
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
    let at_bound = |j: usize| uncertainty::at_bound(parameters[j], setup.lower[j], setup.upper[j]);
    let held: Vec<bool> = (0..np).map(|j| fixed[j] || at_bound(j)).collect();
    // Of values at bounds those that a prior knows are seen too: others move with them.
    let prior = |j: usize| setup.priors.iter().find(|p| p.parameter == j);
    let unseen: Vec<bool> = (0..np)
        .map(|j| fixed[j] || held[j] && prior(j).is_none())
        .collect();
    let mut kkt = problem.system(&unseen);
    let mut jacobian = vec![0.0; problem.jacobian_pattern().nnz()];
    let mut hessian = vec![0.0; problem.hessian_pattern().nnz()];
    problem.jacobian(&solution.x, &mut jacobian);
    problem.hessian(&solution.x, 1.0, &solution.lambda, &mut hessian);
    let mut sigma = vec![0.0; problem.n()];
    problem.stiffen(solution, &mut sigma);
    let values = KktValues {
        hessian: &hessian,
        jacobian: &jacobian,
        sigma: &sigma,
    };
    let (residuals, channels) = problem.residuals(&solution.x);
    let share = 1.0 / problem.samples() as f64;
    let unknowns = held.iter().filter(|h| !**h).count() + problem.free_initial_states();
    let noise = noise::levels(&residuals, weights, setup.loss, share, unknowns);
    if kkt.factorise(values).is_err() {
        return (Spread::none(np), noise);
    }
    let scores = sandwich.then(|| problem.window_scores(&solution.x, &solution.lambda));
    let (reduced, seen) = kkt.reduced_hessian();
    let (inside, edges): (Vec<usize>, Vec<usize>) = (0..seen.len()).partition(|&i| !held[seen[i]]);
    let free: Vec<usize> = inside.iter().map(|&i| seen[i]).collect();
    let hessian = Mat::from_fn(free.len(), free.len(), |i, k| {
        reduced[(inside[i], inside[k])]
    });
    let edge = |&e: &usize| {
        Some(Edge {
            deviation: prior(seen[e])?.deviation / setup.scale[seen[e]],
            column: inside.iter().map(|&i| reduced[(i, e)]).collect(),
        })
    };
    let spread = uncertainty::from_hessian(&Solved {
        hessian: &hessian,
        edges: edges.iter().filter_map(edge).collect(),
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
