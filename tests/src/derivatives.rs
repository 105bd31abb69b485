//! Derivatives of programs against differences, and the windows to try them on.

use pid_fit::transcribe::{Curvature, Loss, Prior, Scheme, Setup, Track};
use pid_nlp::Nlp;
use pid_runtime::dynamics::Dynamics;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Numbers in −1..1, always the same ones.
pub fn numbers(seed: u64, n: usize) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..n).map(|_| random.random_range(-1.0..1.0)).collect()
}

/// A setup with units and inertias unlike one.
pub fn setup(model: &dyn Dynamics, scheme: Scheme, held: bool, linear: bool) -> Setup {
    let infos = model.params();
    let scale = |k: usize| 0.5 + 0.1 * k as f64;
    Setup {
        scheme,
        curvature: Curvature::Exact,
        lower: infos.iter().map(|p| p.lower).collect(),
        upper: infos.iter().map(|p| p.upper).collect(),
        scale: (0..infos.len()).map(scale).collect(),
        inertia: (0..model.dims().nq).map(|j| 2.0 + j as f64).collect(),
        hold_initial: held,
        linear_inputs: linear,
        substeps: 1,
        output: None,
        loss: Loss::Square,
        priors: Vec::new(),
        bodies: Vec::new(),
        bodies_weight: 0.0,
    }
}

/// A loss with long tails, and priors on two parameters.
pub fn unusual() -> (Loss, Vec<Prior>) {
    let prior = |parameter, mean, deviation| Prior {
        parameter,
        mean,
        deviation,
    };
    (
        Loss::StudentT { freedom: 3.0 },
        vec![prior(0, 5.0, 0.7), prior(4, 0.02, 0.05)],
    )
}

/// A window of unequal steps around 0.02 s with arbitrary motion and two missing samples.
pub fn window(model: &dyn Dynamics, steps: usize, seed: u64) -> Track {
    let d = model.dims();
    let (nx, nodes) = (2 * d.nq, steps + 1);
    let uneven = numbers(seed, nodes);
    let mut t = vec![0.1];
    (1..nodes).for_each(|k| t.push(t[k - 1] + 0.02 + 0.01 * uneven[k]));
    let guess: Vec<f64> = numbers(seed + 1, nx * nodes)
        .iter()
        .map(|x| 1.5 * x)
        .collect();
    let mut measured: Vec<f64> = guess.iter().map(|x| x + 0.1).collect();
    measured[1] = f64::NAN;
    measured[nx * steps] = f64::NAN;
    Track {
        t,
        measured,
        guess,
        u: numbers(seed + 2, d.nu * nodes)
            .iter()
            .map(|x| 20.0 * x)
            .collect(),
        weights: (0..nx).map(|c| 0.5 + c as f64).collect(),
    }
}

/// Derivative of `f` along coordinate `j` by differences of order 4, with what rounding of `f`
/// leaves uncertain.
pub fn difference(f: &mut dyn FnMut(&[f64]) -> Vec<f64>, x: &[f64], j: usize) -> Vec<(f64, f64)> {
    let h = 1e-4 * x[j].abs().clamp(1e-2, 10.0);
    let mut at = |k: f64| {
        let mut y = x.to_vec();
        y[j] += k * h;
        f(&y)
    };
    let (a, b, c, d) = (at(-2.0), at(-1.0), at(1.0), at(2.0));
    (0..a.len())
        .map(|i| {
            let slope = (a[i] - 8.0 * b[i] + 8.0 * c[i] - d[i]) / (12.0 * h);
            (slope, 4.0 * f64::EPSILON * b[i].abs() / h)
        })
        .collect()
}

/// Compares a derivative, dense and row by row, with differences of a vector function; errors count
/// against the largest entry of the column.
///
/// # Panics
/// If they disagree.
pub fn assert_derivative(
    what: &str,
    dense: &[f64],
    x: &[f64],
    f: &mut dyn FnMut(&[f64]) -> Vec<f64>,
) {
    let n = x.len();
    for j in 0..n {
        let expected = difference(f, x, j);
        let scale = expected.iter().fold(1.0_f64, |m, (e, _)| m.max(e.abs()));
        for (i, (e, rounding)) in expected.iter().enumerate() {
            let found = dense[i * n + j];
            assert!(
                (found - e).abs() <= 1e-6 * scale + rounding,
                "{what} [{i}, {j}]: {found:e} and, by differences, {e:e}; scale {scale:e}"
            );
        }
    }
}

/// ∂c/∂x, dense, row by row.
pub fn dense_jacobian(problem: &mut dyn Nlp, x: &[f64]) -> Vec<f64> {
    let n = problem.n();
    let mut dense = vec![0.0; problem.m() * n];
    let mut values = vec![f64::NAN; problem.jacobian_pattern().nnz()];
    problem.jacobian(x, &mut values);
    let pattern = problem.jacobian_pattern();
    for ((&r, &c), v) in pattern.rows.iter().zip(&pattern.cols).zip(values) {
        dense[r as usize * n + c as usize] += v;
    }
    dense
}

/// ∇²(σ f + λᵀc), dense; checks that entries come from the lower triangle.
///
/// # Panics
/// If one does not.
pub fn dense_hessian(problem: &mut dyn Nlp, x: &[f64], sigma: f64, lambda: &[f64]) -> Vec<f64> {
    let n = problem.n();
    let mut dense = vec![0.0; n * n];
    let mut values = vec![f64::NAN; problem.hessian_pattern().nnz()];
    problem.hessian(x, sigma, lambda, &mut values);
    let pattern = problem.hessian_pattern();
    for ((&r, &c), v) in pattern.rows.iter().zip(&pattern.cols).zip(values) {
        let (r, c) = (r as usize, c as usize);
        assert!(r >= c, "lower triangle");
        dense[r * n + c] += v;
        if r != c {
            dense[c * n + r] += v;
        }
    }
    dense
}

/// ∇(σ f + λᵀc).
pub fn lagrangian_gradient(
    problem: &mut dyn Nlp,
    x: &[f64],
    sigma: f64,
    lambda: &[f64],
) -> Vec<f64> {
    let mut gradient = vec![0.0; problem.n()];
    problem.gradient(x, &mut gradient);
    gradient.iter_mut().for_each(|g| *g *= sigma);
    let mut values = vec![0.0; problem.jacobian_pattern().nnz()];
    problem.jacobian(x, &mut values);
    let pattern = problem.jacobian_pattern();
    pattern.transpose_multiply_add(&values, lambda, &mut gradient);
    gradient
}
