//! Counts the operations of each part of `emit` and limits them.
//!
//! rustc needs about 0.3 ms of processor time per operation of an emitted function: at
//! [`DEFAULT_LIMIT`] more than a minute. The limit is checked part by part, before the next and
//! larger one is derived.

use pid_derive::model::{Emit, Robot};
use pid_derive::{Derivatives, Equations};
use pid_symbolic::{Cost, Graph, Id};
use thiserror::Error;

/// Operations that a part may take where the declaration states no `limit ops`.
pub const DEFAULT_LIMIT: usize = 250_000;

/// A part of `emit` takes too many operations.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "emitting `{part}` for `{robot}` takes {} operations (limit {})\nhelp: {mend}, or raise the limit with `limit ops {};`",
    grouped(*.operations), grouped(*.limit), grouped(round_up(*.operations)), mend = .part.mend()
)]
pub struct TooLarge {
    /// Name of the robot.
    pub robot: String,
    /// The part.
    pub part: Part,
    /// Its operations.
    pub operations: usize,
    /// The limit.
    pub limit: usize,
}

/// A part with a size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Part {
    /// Residual, mass matrix, bias and forces.
    Dynamics,
    /// Residual and Jacobian.
    FirstDerivatives,
    /// Hessian.
    SecondDerivatives,
}

impl std::fmt::Display for Part {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Dynamics => "dynamics",
            Self::FirstDerivatives => "first_derivatives",
            Self::SecondDerivatives => "second_derivatives",
        })
    }
}

impl Part {
    fn mend(self) -> &'static str {
        match self {
            Self::Dynamics => "lock joints in a `variant`",
            _ => "drop it, lock joints in a `variant`",
        }
    }
}

/// The derivatives that the robot asks for, unless one of its parts is too large.
///
/// # Errors
/// For the first part above the limit.
pub fn derivatives(
    g: &mut Graph,
    robot: &Robot,
    equations: &Equations,
    limit: usize,
) -> Result<Derivatives, TooLarge> {
    let within = |part, operations| match operations <= limit {
        true => Ok(()),
        false => Err(TooLarge {
            robot: robot.name.clone(),
            part,
            operations,
            limit,
        }),
    };
    let e = equations;
    let lists = [&e.residual, &e.mass_matrix, &e.bias, &e.applied_force];
    let values: Vec<Id> = lists.into_iter().flatten().copied().collect();
    within(Part::Dynamics, Cost::of(g, &values).total())?;

    let first = Emit {
        second_derivatives: false,
        first_derivatives: robot.emit.first_derivatives || robot.emit.second_derivatives,
        ..robot.emit
    };
    let jacobian = pid_derive::derivatives(g, equations, first);
    let slopes = jacobian.jacobian.iter().map(|entry| entry.value);
    let outputs: Vec<Id> = e.residual.iter().copied().chain(slopes).collect();
    within(Part::FirstDerivatives, Cost::of(g, &outputs).total())?;
    if !robot.emit.second_derivatives {
        return Ok(jacobian);
    }
    let both = pid_derive::derivatives(g, equations, robot.emit);
    let curvatures: Vec<Id> = both.hessian.iter().map(|entry| entry.value).collect();
    within(Part::SecondDerivatives, Cost::of(g, &curvatures).total())?;
    Ok(both)
}

/// `1_234_567`.
fn grouped(n: usize) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (k, digit) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k).is_multiple_of(3) {
            out.push('_');
        }
        out.push(digit);
    }
    out
}

/// The next number of one significant digit, at least as large.
fn round_up(n: usize) -> usize {
    let mut unit = 1_usize;
    while n / unit >= 10 {
        unit = unit.saturating_mul(10);
    }
    n.div_ceil(unit).saturating_mul(unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_as_in_rust() {
        assert_eq!(grouped(7), "7");
        assert_eq!(grouped(412_000), "412_000");
        assert_eq!(grouped(1_000_001), "1_000_001");
        assert_eq!(round_up(412_000), 500_000);
        assert_eq!(round_up(0), 0);
        assert_eq!(round_up(900_001), 1_000_000);
        assert_eq!(round_up(500), 500);
    }
}
