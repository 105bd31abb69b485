//! The answer to AMPL or Pyomo: a `.sol` file.

use std::fmt::Write;

use pid_nlp::Nlp;
use pid_nlp::solver::{Solution, Status};

use crate::Problem;

/// The text of a `.sol` file: message, options of the problem's head, multipliers, variables, code of the outcome.
///
/// Multipliers are ∂f/∂(bound of the row) for the objective as the file states it. Codes: 0 solved, 100 acceptable,
/// 200 infeasible, 300 unbounded, 400 stopped by a limit, 500 failed.
pub fn answer(problem: &Problem, solution: &Solution) -> String {
    let sign = if problem.maximises() { 1.0 } else { -1.0 };
    let objective = -sign * solution.objective;
    let mut out = format!(
        "simtrue: {}; objective {objective:e}\n\nOptions\n",
        solution.status.reason()
    );
    let _ = writeln!(out, "{}", problem.options().len());
    for option in problem.options() {
        let _ = writeln!(out, "{option}");
    }
    let (n, m) = (problem.n(), problem.m());
    let _ = write!(out, "{m}\n{m}\n{n}\n{n}\n");
    for lambda in &solution.lambda {
        let _ = writeln!(out, "{:e}", sign * lambda);
    }
    for x in &solution.x {
        let _ = writeln!(out, "{x:e}");
    }
    let _ = writeln!(out, "objno 0 {}", code(solution.status));
    out
}

fn code(status: Status) -> u32 {
    match status {
        Status::Solved => 0,
        Status::Acceptable => 100,
        Status::LocallyInfeasible | Status::RestorationFailed => 200,
        Status::Unbounded => 300,
        status if status.is_limit() => 400,
        _ => 500,
    }
}
