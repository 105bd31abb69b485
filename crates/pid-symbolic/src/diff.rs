//! Exact derivatives, written into the graph as further expressions.
//!
//! With `y = φ(x₁, x₂)` a node and `∂φ/∂xₖ` its partials:
//! - forward: `ẏ = Σₖ ∂φ/∂xₖ · ẋₖ`, operands first;
//! - reverse: `x̄ₖ += ȳ · ∂φ/∂xₖ`, results first (A. Griewank and A. Walther, *Evaluating
//!   Derivatives*, 2nd ed., 2008, ch. 3).
//!
//! `abs` has the derivative `sign`, and `sign` the derivative 0. Both are right everywhere but at
//! zero.

use crate::graph::Graph;
use crate::node::{Function, Id, Node};

/// Operands of a node with the partial derivatives with respect to them.
fn partials(g: &mut Graph, id: Id) -> [Option<(Id, Id)>; 2] {
    let one = g.one();
    match g.node(id) {
        Node::Const(_) | Node::Var(_) => [None, None],
        Node::Neg(x) => [Some((x, g.constant(-1.0))), None],
        Node::Add(x, y) => [Some((x, one)), Some((y, one))],
        Node::Sub(x, y) => [Some((x, one)), Some((y, g.constant(-1.0)))],
        Node::Mul(x, y) => [Some((x, y)), Some((y, x))],
        Node::Div(x, y) => {
            let reciprocal = g.div(one, y);
            let slope = g.mul(id, reciprocal);
            [Some((x, reciprocal)), Some((y, g.neg(slope)))]
        }
        Node::Powi(x, n) => {
            let (factor, power) = (g.constant(f64::from(n)), g.powi(x, n - 1));
            [Some((x, g.mul(factor, power))), None]
        }
        Node::Call(f, x) => {
            let slope = match f {
                Function::Sin => g.cos(x),
                Function::Cos => {
                    let sine = g.sin(x);
                    g.neg(sine)
                }
                Function::Tan => {
                    let square = g.mul(id, id);
                    g.add(one, square)
                }
                Function::Tanh => {
                    let square = g.mul(id, id);
                    g.sub(one, square)
                }
                Function::Atan => {
                    let square = g.mul(x, x);
                    let sum = g.add(one, square);
                    g.div(one, sum)
                }
                Function::Exp => id,
                Function::Ln => g.div(one, x),
                Function::Sqrt => {
                    let half = g.constant(0.5);
                    g.div(half, id)
                }
                Function::Abs => g.call(Function::Sign, x),
                Function::Sign => g.zero(),
            };
            [Some((x, slope)), None]
        }
    }
}

/// Which of a list of variables each expression depends on, as bit sets.
struct Dependence {
    words: usize,
    bits: Vec<u64>,
}

impl Dependence {
    fn new(g: &Graph, vars: &[Id]) -> Self {
        let words = vars.len().div_ceil(64).max(1);
        let mut bits = vec![0; g.len() * words];
        for (k, var) in vars.iter().enumerate() {
            bits[var.index() * words + k / 64] |= 1 << (k % 64);
        }
        for index in 0..g.len() {
            for operand in g.node(Id(index as u32)).operands() {
                for w in 0..words {
                    let of_operand = bits[operand.index() * words + w];
                    bits[index * words + w] |= of_operand;
                }
            }
        }
        Self { words, bits }
    }

    fn on(&self, id: Id, k: usize) -> bool {
        self.bits[id.index() * self.words + k / 64] >> (k % 64) & 1 == 1
    }

    fn on_any(&self, id: Id) -> bool {
        let start = id.index() * self.words;
        self.bits[start..start + self.words]
            .iter()
            .any(|&word| word != 0)
    }
}

/// ∂`output`/∂`vars`, by one reverse sweep. `vars` are variables.
pub fn gradient(g: &mut Graph, output: Id, vars: &[Id]) -> Vec<Id> {
    let depends = Dependence::new(g, vars);
    let nodes = g.reachable_where(&[output], |id| depends.on_any(id));
    sweep(g, &nodes, &depends, output, vars)
}

/// Rows ∂`outputs[i]`/∂`vars`, by one reverse sweep each.
pub fn jacobian(g: &mut Graph, outputs: &[Id], vars: &[Id]) -> Vec<Vec<Id>> {
    let depends = Dependence::new(g, vars);
    outputs
        .iter()
        .map(|&output| {
            let nodes = g.reachable_where(&[output], |id| depends.on_any(id));
            sweep(g, &nodes, &depends, output, vars)
        })
        .collect()
}

fn sweep(g: &mut Graph, nodes: &[Id], depends: &Dependence, output: Id, vars: &[Id]) -> Vec<Id> {
    let zero = g.zero();
    let mut adjoint = vec![zero; output.index() + 1];
    if !nodes.is_empty() {
        adjoint[output.index()] = g.one();
    }
    for &id in nodes.iter().rev() {
        let of_result = adjoint[id.index()];
        if g.is_zero(of_result) {
            continue;
        }
        for (operand, slope) in partials(g, id).into_iter().flatten() {
            if depends.on_any(operand) {
                let share = g.mul(of_result, slope);
                adjoint[operand.index()] = g.add(adjoint[operand.index()], share);
            }
        }
    }
    vars.iter()
        .map(|var| adjoint.get(var.index()).copied().unwrap_or(zero))
        .collect()
}

/// Derivatives of `outputs` along a direction: `Σₖ ∂output/∂varₖ · directionₖ` for
/// `seeds = [(varₖ, directionₖ)]`, by one forward sweep.
pub fn directional(g: &mut Graph, outputs: &[Id], seeds: &[(Id, Id)]) -> Vec<Id> {
    let vars: Vec<Id> = seeds.iter().map(|seed| seed.0).collect();
    let depends = Dependence::new(g, &vars);
    let nodes = g.reachable_where(outputs, |id| depends.on_any(id));
    let mut tangent = vec![None; g.len()];
    forward(g, &nodes, seeds, &mut tangent);
    let zero = g.zero();
    outputs
        .iter()
        .map(|id| tangent[id.index()].unwrap_or(zero))
        .collect()
}

fn forward(g: &mut Graph, nodes: &[Id], seeds: &[(Id, Id)], tangent: &mut [Option<Id>]) {
    for &(var, direction) in seeds {
        tangent[var.index()] = Some(direction);
    }
    for &id in nodes {
        if g.node(id).is_leaf() {
            continue;
        }
        let mut total = g.zero();
        for (operand, slope) in partials(g, id).into_iter().flatten() {
            if let Some(of_operand) = tangent[operand.index()] {
                let share = g.mul(slope, of_operand);
                total = g.add(total, share);
            }
        }
        tangent[id.index()] = Some(total);
    }
}

/// An entry of a symmetric matrix, `row ≥ col`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// Row, position in the list of variables.
    pub row: usize,
    /// Column, position in the list of variables.
    pub col: usize,
    /// The expression.
    pub value: Id,
}

/// Structural non-zeros of the lower triangle of ∂²`output`/∂`vars`², sorted by row, then column.
///
/// Forward over reverse: one reverse sweep for the gradient, then one forward sweep through it per
/// variable, restricted to what depends on that variable and to rows on or below the diagonal.
pub fn hessian(g: &mut Graph, output: Id, vars: &[Id]) -> Vec<Entry> {
    let gradient = gradient(g, output, vars);
    let depends = Dependence::new(g, vars);
    let one = g.one();
    let mut entries = Vec::new();
    for (col, &var) in vars.iter().enumerate() {
        let rows: Vec<usize> = (col..vars.len())
            .filter(|&row| depends.on(gradient[row], col))
            .collect();
        let roots: Vec<Id> = rows.iter().map(|&row| gradient[row]).collect();
        // The gradient was complete before `depends` was built, so nothing that later sweeps add is
        // entered.
        let nodes = g.reachable_where(&roots, |id| depends.on(id, col));
        let mut tangent = vec![None; g.len()];
        forward(g, &nodes, &[(var, one)], &mut tangent);
        for row in rows {
            if let Some(value) = tangent[gradient[row].index()].filter(|&id| !g.is_zero(id)) {
                entries.push(Entry { row, col, value });
            }
        }
    }
    entries.sort_unstable_by_key(|entry| (entry.row, entry.col));
    entries
}
