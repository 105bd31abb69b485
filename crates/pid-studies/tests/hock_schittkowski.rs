//! The interior-point method on the Hock-Schittkowski collection with exact Hessians.

use pid_nlp::Nlp;
use pid_nlp::solver::{Barrier, Oracle, Settings};
use pid_studies::hock_schittkowski::study::{self, Verdict};
use pid_studies::hock_schittkowski::{Case, all};

/// Problems whose optimum is no Karush-Kuhn-Tucker point: no solver of those conditions meets it to 1e-6.
const NO_MULTIPLIERS: [u32; 1] = [13];

/// Solves everything; returns the problems at another minimum than the published one.
fn solve_all(barrier: Barrier) -> Vec<u32> {
    let settings = Settings {
        barrier,
        ..Settings::default()
    };
    let mut elsewhere = Vec::new();
    let mut failed = Vec::new();
    for mut case in all() {
        let outcome = study::run(&mut case, &settings, &mut study::interior_point);
        match outcome.verdict {
            Verdict::Published | Verdict::Lower => {}
            Verdict::OtherMinimum => elsewhere.push(outcome.number),
            Verdict::Failed if NO_MULTIPLIERS.contains(&outcome.number) => {
                assert!(outcome.check.primal_inf < 1e-6, "{outcome:?}");
                assert!(outcome.error() < 1e-2, "HS{}", outcome.number);
            }
            Verdict::Failed => failed.push((
                outcome.number,
                outcome.solution.status,
                outcome.solution.objective,
                outcome.reference,
            )),
        }
    }
    assert!(failed.is_empty(), "{barrier:?}: {failed:?}");
    elsewhere
}

#[test]
fn more_than_a_hundred_problems() {
    let cases = all();
    assert!(cases.len() >= 113, "{}", cases.len());
    let mut numbers: Vec<u32> = cases.iter().map(|case| case.info.number).collect();
    numbers.dedup();
    assert_eq!(numbers.len(), cases.len(), "every problem once");
}

#[test]
fn monotone_barrier_solves_all() {
    let elsewhere = solve_all(Barrier::Monotone);
    assert!(elsewhere.len() <= 11, "{elsewhere:?}");
}

#[test]
fn adaptive_barrier_solves_all() {
    let elsewhere = solve_all(Barrier::Adaptive(Oracle::Quality));
    assert!(elsewhere.len() <= 12, "{elsewhere:?}");
}

/// Largest relative difference between derivatives and central differences of the next lower order
/// at the start.
fn worst_derivative(case: &mut Case) -> f64 {
    let problem: &mut dyn Nlp = case.problem.as_mut();
    let (n, m) = (problem.n(), problem.m());
    let (mut lower, mut upper) = (vec![0.0; n], vec![0.0; n]);
    problem.bounds(&mut lower, &mut upper);
    // A little off the start: some starts are singular points of their formulas.
    let x: Vec<f64> = (0..n)
        .map(|j| {
            let x = case.info.start[j].clamp(lower[j], upper[j]);
            x + 0.01 * (1.0 + x.abs()) * if x < upper[j] { 1.0 } else { -1.0 }
        })
        .collect();
    let lambda: Vec<f64> = (0..m).map(|i| 0.3 + 0.1 * i as f64).collect();
    let lagrangian_gradient = |problem: &mut dyn Nlp, x: &[f64]| {
        let mut g = vec![0.0; n];
        problem.gradient(x, &mut g);
        let mut values = vec![0.0; problem.jacobian_pattern().nnz()];
        problem.jacobian(x, &mut values);
        let pattern = problem.jacobian_pattern();
        pattern.transpose_multiply_add(&values, &lambda, &mut g);
        g
    };
    let lagrangian = |problem: &mut dyn Nlp, x: &[f64]| {
        let mut c = vec![0.0; m];
        problem.constraints(x, &mut c);
        problem.objective(x) + c.iter().zip(&lambda).map(|(c, l)| c * l).sum::<f64>()
    };
    let gradient = lagrangian_gradient(problem, &x);
    let mut values = vec![0.0; problem.hessian_pattern().nnz()];
    problem.hessian(&x, 1.0, &lambda, &mut values);
    let scale = gradient.iter().fold(1.0_f64, |a, g| a.max(g.abs()));
    let hessian_scale = values.iter().fold(1.0_f64, |a, h| a.max(h.abs()));
    let mut worst = 0.0_f64;
    for j in 0..n {
        let h = 1e-5 * (1.0 + x[j].abs());
        let at = |d: f64| {
            let mut y = x.clone();
            y[j] += d;
            y
        };
        let (above, below) = (at(h), at(-h));
        let difference = (lagrangian(problem, &above) - lagrangian(problem, &below)) / (2.0 * h);
        worst = worst.max((difference - gradient[j]).abs() / scale);
        let (above, below) = (
            lagrangian_gradient(problem, &above),
            lagrangian_gradient(problem, &below),
        );
        let mut unit = vec![0.0; n];
        unit[j] = 1.0;
        let mut column = vec![0.0; n];
        let pattern = problem.hessian_pattern();
        pattern.symmetric_multiply_add(&values, &unit, &mut column);
        for i in 0..n {
            let difference = (above[i] - below[i]) / (2.0 * h);
            worst = worst.max((difference - column[i]).abs() / hessian_scale);
        }
    }
    worst
}

#[test]
fn derivatives_agree_with_differences() {
    let bad: Vec<(u32, f64)> = all()
        .iter_mut()
        .map(|case| (case.info.number, worst_derivative(case)))
        .filter(|(_, worst)| *worst >= 1e-4 || worst.is_nan())
        .collect();
    assert!(bad.is_empty(), "{bad:?}");
}

/// What sequential quadratic programming does not bring to a minimum: 13 has no multipliers; from
/// the starts of 61 and of 97 and 98 it ends at a point where the constraints cannot be met, and at
/// a stationary point that is no minimum; in 17 and 105 the filter refuses every step.
const NOT_BY_SQP: [u32; 6] = [13, 17, 61, 97, 98, 105];

#[test]
fn sequential_quadratic_programming_solves_nearly_all() {
    let settings = Settings {
        max_iterations: 300,
        ..Settings::default()
    };
    let mut failed = Vec::new();
    for mut case in all() {
        let outcome = study::run(&mut case, &settings, &mut study::sqp(None));
        if outcome.verdict == Verdict::Failed {
            failed.push(outcome.number);
        }
    }
    failed.retain(|number| !NOT_BY_SQP.contains(number));
    assert!(failed.is_empty(), "{failed:?}");
}

#[test]
fn both_methods_solve_nearly_all_by_damped_bfgs() {
    let settings = Settings::default();
    let solvers: [(&str, Box<study::Solver<'_>>); 2] = [
        ("interior point", Box::new(study::quasi_newton(usize::MAX))),
        ("SQP", Box::new(study::sqp(Some(usize::MAX)))),
    ];
    for (name, mut solver) in solvers {
        let mut solved = 0;
        for mut case in all() {
            let outcome = study::run(&mut case, &settings, solver.as_mut());
            solved += usize::from(outcome.verdict != Verdict::Failed);
        }
        assert!(solved >= 109, "{name}: {solved}");
    }
}
