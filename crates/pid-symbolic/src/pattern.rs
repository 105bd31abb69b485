//! Which expressions are identically zero.
//!
//! Folding finds the structural zeros. Cancellations that it cannot see (`sin²x + cos²x − 1`, terms
//! that meet in different groupings) are found by evaluation at random points (J. T. Schwartz,
//! 1980): an expression is taken as zero if it vanishes at all of them to rounding error.
//!
//! Removing a true non-zero would make a derivative wrong, so the test errs on one side only. In
//! floating point every function but sine and cosine may saturate, overflow or change branch
//! (`tanh`, `exp`, `sqrt`, `abs`, …). Each node of such a function gets an independent random
//! value, as if it were a further variable: `1 − tanh²(1000 v)` and `√(x²) − x` stay non-zero. An
//! expression that is found zero is zero for all values of these functions.

use crate::graph::Graph;
use crate::node::{Function, Id, Node};
use crate::random::Random;

/// Points of evaluation; each alone would err with probability near zero.
const POINTS: u64 = 4;
/// Rounding error allowed relative to the size of the terms.
const TOLERANCE: f64 = 1e-11;

/// For each of `outputs`, whether it is identically zero. The answer does not change from run to run.
pub fn zeros(g: &Graph, outputs: &[Id]) -> Vec<bool> {
    let order = g.reachable(outputs);
    let mut zero = vec![true; outputs.len()];
    let mut values = vec![(0.0, 0.0); g.len()];
    for point in 0..POINTS {
        evaluate(g, &order, point, &mut values);
        for (is_zero, id) in zero.iter_mut().zip(outputs) {
            let (value, size) = values[id.index()];
            // Written so that a value that is not finite counts as non-zero.
            *is_zero &= value == 0.0 || (size.is_finite() && value.abs() <= TOLERANCE * size);
        }
    }
    zero
}

/// Value of every node of `order`, and its size: the value if all terms had one sign, which bounds
/// the rounding error.
fn evaluate(g: &Graph, order: &[Id], point: u64, values: &mut [(f64, f64)]) {
    for &id in order {
        let at = |x: Id| values[x.index()];
        let stand_in = |lower, upper| {
            let seed = (point << 40) ^ (id.index() as u64).wrapping_mul(0x2545_f491_4f6c_dd1d);
            Random::new(seed).uniform(lower, upper)
        };
        values[id.index()] = match g.node(id) {
            Node::Const(c) => (c.value(), c.value().abs()),
            // Away from zero.
            Node::Var(i) => {
                let value = Random::new((point << 40) ^ 0x5bd1_e995 ^ (u64::from(i) << 8))
                    .uniform(0.3, 1.7);
                (value, value)
            }
            Node::Neg(x) => (-at(x).0, at(x).1),
            Node::Add(x, y) => (at(x).0 + at(y).0, at(x).1 + at(y).1),
            Node::Sub(x, y) => (at(x).0 - at(y).0, at(x).1 + at(y).1),
            Node::Mul(x, y) => (at(x).0 * at(y).0, at(x).1 * at(y).1),
            Node::Div(x, y) => {
                let ((a, size_a), (b, size_b)) = (at(x), at(y));
                (a / b, size_a / b.abs() * (size_b / b.abs()))
            }
            Node::Powi(x, n) => {
                let ((a, size_a), m) = (at(x), n.saturating_abs());
                let value = a.powi(n);
                (value, value.abs() * (size_a / a.abs()).powi(m))
            }
            Node::Call(f, x) => {
                let (a, size) = at(x);
                match f {
                    Function::Sin => (a.sin(), 1.0 + size),
                    Function::Cos => (a.cos(), 1.0 + size),
                    _ => {
                        let value = stand_in(0.2, 0.9);
                        (value, value)
                    }
                }
            }
        };
    }
}

#[cfg(test)]
mod tests {
    use super::zeros;
    use crate::graph::Graph;
    use crate::node::Function;

    #[test]
    fn finds_cancellations_that_folding_does_not_see() {
        let mut g = Graph::new();
        let (x, y, z, one) = (g.var(0), g.var(1), g.var(2), g.one());
        let (s, c) = (g.sin(x), g.cos(x));
        let (s2, c2) = (g.mul(s, s), g.mul(c, c));
        let unit = g.add(s2, c2);
        let trig = g.sub(unit, one);
        // (x + y) z − (x z + y z)
        let sum = g.add(x, y);
        let left = g.mul(sum, z);
        let (xz, yz) = (g.mul(x, z), g.mul(y, z));
        let right = g.add(xz, yz);
        let distributed = g.sub(left, right);
        assert_eq!(
            zeros(&g, &[trig, distributed, unit, left]),
            [true, true, false, false]
        );
    }

    #[test]
    fn keeps_what_vanishes_in_floating_point_only() {
        let mut g = Graph::new();
        let (v, one, big) = (g.var(0), g.one(), g.constant(1e4));
        let fast = g.mul(big, v);
        let t = g.call(Function::Tanh, fast);
        let t2 = g.mul(t, t);
        let slope = g.sub(one, t2);
        let minus = g.neg(fast);
        let tiny = g.call(Function::Exp, minus);
        // √(x²) − x: zero for positive x only.
        let square = g.mul(v, v);
        let root = g.call(Function::Sqrt, square);
        let branch = g.sub(root, v);
        assert_eq!(zeros(&g, &[slope, tiny, branch]), [false; 3]);
    }
}
