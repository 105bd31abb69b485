//! Prints values and derivatives of `.nl` files near their starts, and how the solver ends on them, for
//! `oracle/compare.py`: `evaluate FILE…`, one line of JSON a file.

// It prints.
#![allow(clippy::print_stdout)]

use pid_nl::Problem;
use pid_nlp::solver::{Settings, minimise};
use pid_nlp::{Nlp, SparsePattern, check_point};

/// Sums of matrix entries as `[[row, column, value], …]`, in the order of the pattern.
fn entries(pattern: &SparsePattern, values: &[f64]) -> String {
    let entry = |((r, c), v): ((&u32, &u32), &f64)| format!("[{r},{c},{v:e}]");
    let all: Vec<String> = (pattern.rows.iter().zip(&pattern.cols).zip(values))
        .map(entry)
        .collect();
    format!("[{}]", all.join(","))
}

fn list(values: &[f64]) -> String {
    let all: Vec<String> = values.iter().map(|v| format!("{v:e}")).collect();
    format!("[{}]", all.join(","))
}

/// A point near the start; the multipliers are 1, −1/2, 1/3, ….
fn evaluate(problem: &mut Problem) -> String {
    let (n, m) = (problem.n(), problem.m());
    let near = |(i, x): (usize, &f64)| x + 0.01 * (1.0 + x.abs()) * ((i % 7) as f64 - 3.0) / 3.0;
    let x: Vec<f64> = problem.start().iter().enumerate().map(near).collect();
    let lambda: Vec<f64> = (0..m)
        .map(|i| if i % 2 == 0 { 1.0 } else { -1.0 } / (i + 1) as f64)
        .collect();
    let f = problem.objective(&x);
    let (mut c, mut gradient) = (vec![0.0; m], vec![0.0; n]);
    problem.constraints(&x, &mut c);
    problem.gradient(&x, &mut gradient);
    let mut jacobian = vec![0.0; problem.jacobian_pattern().nnz()];
    problem.jacobian(&x, &mut jacobian);
    let mut hessian = vec![0.0; problem.hessian_pattern().nnz()];
    problem.hessian(&x, 1.0, &lambda, &mut hessian);
    format!(
        "\"x\":{},\"lambda\":{},\"f\":{f:e},\"c\":{},\"gradient\":{},\"jacobian\":{},\"hessian\":{}",
        list(&x),
        list(&lambda),
        list(&c),
        list(&gradient),
        entries(problem.jacobian_pattern(), &jacobian),
        entries(problem.hessian_pattern(), &hessian)
    )
}

fn solve(problem: &mut Problem) -> String {
    let start = problem.start().to_vec();
    let settings = Settings {
        max_iterations: 3000,
        ..Settings::default()
    };
    let found = minimise(problem, &start, &settings);
    let check = check_point(problem, &found.x, &found.lambda);
    format!(
        "\"status\":\"{}\",\"converged\":{},\"objective\":{:e},\"iterations\":{},\"functions\":{},\"violation\":{:e}",
        found.status.reason(),
        found.status.converged(),
        found.objective,
        found.log.len().saturating_sub(1),
        found.counts.functions,
        check.primal_inf.max(check.bound_violation)
    )
}

fn main() {
    for file in std::env::args().skip(1) {
        match Problem::read(&file) {
            Ok(mut problem) => {
                let (values, end) = (evaluate(&mut problem), solve(&mut problem));
                println!("{{\"file\":\"{file}\",{values},{end}}}");
            }
            Err(error) => eprintln!("{error}"),
        }
    }
}
