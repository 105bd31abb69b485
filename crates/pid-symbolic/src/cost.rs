//! Operation counts by kind.

use std::fmt;

use crate::graph::Graph;
use crate::node::{Function, Id, Node};
use crate::schedule;

/// Operations needed to evaluate a list of outputs; common subexpressions count once.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Cost {
    /// Additions, subtractions and negations.
    pub additions: usize,
    /// Multiplications; a power counts as its multiplications.
    pub multiplications: usize,
    /// Divisions.
    pub divisions: usize,
    /// Square roots.
    pub roots: usize,
    /// Sines, cosines and all other functions.
    pub functions: usize,
}

impl Cost {
    /// The cost of `outputs`.
    pub fn of(g: &Graph, outputs: &[Id]) -> Self {
        let mut cost = Self::default();
        for id in schedule::order(g, outputs) {
            match g.node(id) {
                Node::Const(_) | Node::Var(_) => {}
                Node::Neg(_) | Node::Add(..) | Node::Sub(..) => cost.additions += 1,
                Node::Mul(..) => cost.multiplications += 1,
                Node::Div(..) => cost.divisions += 1,
                Node::Powi(_, n) => {
                    cost.multiplications += power_multiplications(n);
                    cost.divisions += usize::from(n < 0);
                }
                Node::Call(Function::Sqrt, _) => cost.roots += 1,
                Node::Call(..) => cost.functions += 1,
            }
        }
        cost
    }

    /// All operations, each counted as one.
    pub fn total(&self) -> usize {
        self.additions + self.multiplications + self.divisions + self.roots + self.functions
    }
}

impl fmt::Display for Cost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} (+ {}, * {}",
            self.total(),
            self.additions,
            self.multiplications
        )?;
        for (name, count) in [
            ("/", self.divisions),
            ("sqrt", self.roots),
            ("functions", self.functions),
        ] {
            if count > 0 {
                write!(f, ", {name} {count}")?;
            }
        }
        write!(f, ")")
    }
}

/// Multiplications of xⁿ by squaring.
fn power_multiplications(n: i32) -> usize {
    let n = n.unsigned_abs();
    (n.ilog2() + n.count_ones() - 1) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shared_subexpressions_count_once() {
        let mut g = Graph::new();
        let (x, y) = (g.var(0), g.var(1));
        let product = g.mul(x, y);
        let sine = g.sin(product);
        let sum = g.add(sine, product);
        let power = g.powi(sum, -5);
        let cost = Cost::of(&g, &[sum, power, product]);
        // x⁵ = (x²)² x.
        assert_eq!(
            cost,
            Cost {
                additions: 1,
                multiplications: 4,
                divisions: 1,
                roots: 0,
                functions: 1
            }
        );
        assert_eq!(cost.to_string(), "7 (+ 1, * 4, / 1, functions 1)");
    }
}
