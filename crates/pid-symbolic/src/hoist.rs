//! Partial evaluation: what depends on slow variables alone is computed once, beforehand.

use crate::graph::Graph;
use crate::node::{Id, Node};

/// A computation in two steps.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hoisted {
    /// What is computed beforehand, from slow variables.
    pub before: Vec<Id>,
    /// The outputs as functions of the remaining variables and of the results of
    /// [`before`](Self::before), which are variables from the number given on.
    pub after: Vec<Id>,
}

/// Splits a computation. `slow` says of each variable whether it is known beforehand; results of
/// the first step become the variables `first`, `first + 1`, …; `given` are expressions that the
/// caller computes itself, with the variables that hold them.
pub fn hoist(
    g: &mut Graph,
    outputs: &[Id],
    slow: impl Fn(u32) -> bool,
    first: usize,
    given: &[(Id, usize)],
) -> Hoisted {
    let order = g.reachable(outputs);
    let length = g.len();
    // Whether an expression reads no fast variable.
    let mut early = vec![false; length];
    for &id in &order {
        early[id.index()] = match g.node(id) {
            Node::Const(_) => true,
            Node::Var(i) => slow(i),
            node => {
                given.iter().all(|(own, _)| *own != id) && node.operands().all(|x| early[x.index()])
            }
        };
    }
    let mut new: Vec<Option<Id>> = vec![None; length];
    for &(id, variable) in given {
        if id.index() < length {
            new[id.index()] = Some(g.var(variable));
        }
    }
    let mut before = Vec::new();
    // The image of an operand of a late expression, or of an output.
    let mut image = |g: &mut Graph, new: &mut Vec<Option<Id>>, x: Id| -> Id {
        if let Some(image) = new[x.index()] {
            return image;
        }
        let image = if g.value(x).is_some() {
            x
        } else {
            before.push(x);
            g.var(first + before.len() - 1)
        };
        new[x.index()] = Some(image);
        image
    };
    for &id in &order {
        if early[id.index()] || new[id.index()].is_some() {
            continue;
        }
        let node = g.node(id);
        let mut operands = node.operands();
        let mut next = |g: &mut Graph, new: &mut Vec<Option<Id>>| {
            let x = operands
                .next()
                .expect("as many operands as the operation has");
            image(g, new, x)
        };
        let own = match node {
            Node::Const(_) | Node::Var(_) => id,
            Node::Neg(_) => {
                let x = next(g, &mut new);
                g.neg(x)
            }
            Node::Add(..) => {
                let (x, y) = (next(g, &mut new), next(g, &mut new));
                g.add(x, y)
            }
            Node::Sub(..) => {
                let (x, y) = (next(g, &mut new), next(g, &mut new));
                g.sub(x, y)
            }
            Node::Mul(..) => {
                let (x, y) = (next(g, &mut new), next(g, &mut new));
                g.mul(x, y)
            }
            Node::Div(..) => {
                let (x, y) = (next(g, &mut new), next(g, &mut new));
                g.div(x, y)
            }
            Node::Powi(_, n) => {
                let x = next(g, &mut new);
                g.powi(x, n)
            }
            Node::Call(f, _) => {
                let x = next(g, &mut new);
                g.call(f, x)
            }
        };
        new[id.index()] = Some(own);
    }
    let after = outputs.iter().map(|&x| image(g, &mut new, x)).collect();
    Hoisted { before, after }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::program::Scratch;
    use crate::{Cost, Program};

    #[test]
    fn two_steps_give_what_one_gives() {
        // Variables: x, y fast, a, b slow; the sine of x is given in variable 4.
        let mut g = Graph::new();
        let [x, y, a, b] = [0, 1, 2, 3].map(|i| g.var(i));
        let product = g.mul(a, b);
        let root = g.call(crate::Function::Sqrt, product);
        let sine = g.sin(x);
        let weighted = g.mul(root, sine);
        let square = g.mul(y, y);
        let f = g.add(weighted, square);
        let outputs = [f, product, sine];
        let split = hoist(&mut g, &outputs, |i| i == 2 || i == 3, 5, &[(sine, 4)]);
        assert_eq!(split.before, [root, product]);
        // What is left costs a product and two operations for y² and the sum.
        assert_eq!(Cost::of(&g, &split.after).total(), 3);

        let at = [0.3, -0.7, 1.2, 2.5];
        let run = |outputs: &[Id], vars: &[f64]| {
            let program = Program::new(&g, outputs);
            let mut out = vec![0.0; outputs.len()];
            let fill = |z: &mut [f64]| {
                let n = z.len();
                z.copy_from_slice(&vars[..n]);
            };
            program.eval(&mut Scratch::new(), fill, [&mut out]);
            out
        };
        let direct = run(&outputs, &at);
        let before = run(&split.before, &at);
        let late = [&at[..], &[0.3_f64.sin()], &before].concat();
        assert_eq!(run(&split.after, &late), direct);
    }
}
