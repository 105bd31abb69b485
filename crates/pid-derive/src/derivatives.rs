//! Exact first and second derivatives of the residual.

use pid_symbolic::diff::{self, Entry};
use pid_symbolic::{Graph, pattern};

use super::equations::Equations;
use crate::model::Emit;

/// Derivatives of r by `z = (q, v, a, u, p)`: structural non-zeros, sorted by row, then column.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Derivatives {
    /// ∂r/∂z; rows are equations, columns positions in z.
    pub jacobian: Vec<Entry>,
    /// Lower triangle of ∂²(λᵀr)/∂z²; positions in z.
    pub hessian: Vec<Entry>,
}

/// The derivatives asked for. Second derivatives bring the first with them.
pub fn derivatives(g: &mut Graph, equations: &Equations, emit: Emit) -> Derivatives {
    let mut derivatives = Derivatives::default();
    let z = equations.symbols.z();
    if emit.first_derivatives || emit.second_derivatives {
        let rows = diff::jacobian(g, &equations.residual, &z);
        let entries = rows
            .into_iter()
            .enumerate()
            .flat_map(|(row, values)| {
                values
                    .into_iter()
                    .enumerate()
                    .map(move |(col, value)| Entry { row, col, value })
            })
            .collect();
        derivatives.jacobian = nonzeros(g, entries);
    }
    if emit.second_derivatives {
        let terms: Vec<_> = equations
            .symbols
            .lambda
            .iter()
            .zip(&equations.residual)
            .map(|(&lambda, &r)| g.mul(lambda, r))
            .collect();
        let weighted = g.sum(terms);
        let entries = diff::hessian(g, weighted, &z);
        derivatives.hessian = nonzeros(g, entries);
    }
    derivatives
}

fn nonzeros(g: &Graph, entries: Vec<Entry>) -> Vec<Entry> {
    let values: Vec<_> = entries.iter().map(|entry| entry.value).collect();
    let zeros = pattern::zeros(g, &values);
    entries
        .into_iter()
        .zip(zeros)
        .filter(|(_, zero)| !zero)
        .map(|(entry, _)| entry)
        .collect()
}
