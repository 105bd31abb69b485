//! The arena. Constructors fold what needs no further knowledge: constants, 0 and ±1, signs, and
//! the order of commutative operands.
//!
//! Folding assumes finite values (`0 · x = 0`, `x − x = 0`, `x / x = 1`); it never expands and
//! never distributes, so an expression does not grow.

use std::collections::HashMap;

use crate::node::{Constant, Function, Id, Node};

/// An arena of expressions in which equal expressions share one [`Id`].
#[derive(Debug, Clone, Default)]
pub struct Graph {
    nodes: Vec<Node>,
    ids: HashMap<Node, Id>,
}

impl Graph {
    /// An empty graph.
    pub fn new() -> Self {
        Self::default()
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether the graph is empty.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// The operation of an expression.
    pub fn node(&self, id: Id) -> Node {
        self.nodes[id.index()]
    }

    /// The expression of an operation, if the graph has it.
    pub fn find(&self, node: &Node) -> Option<Id> {
        self.ids.get(node).copied()
    }

    /// The value of a constant, `None` for anything else.
    pub fn value(&self, id: Id) -> Option<f64> {
        match self.node(id) {
            Node::Const(c) => Some(c.value()),
            _ => None,
        }
    }

    /// Whether the expression is the constant zero.
    pub fn is_zero(&self, id: Id) -> bool {
        self.value(id) == Some(0.0)
    }

    fn intern(&mut self, node: Node) -> Id {
        if let Some(&id) = self.ids.get(&node) {
            return id;
        }
        let id = Id(u32::try_from(self.nodes.len()).expect("a graph has fewer than 2³² nodes"));
        self.nodes.push(node);
        self.ids.insert(node, id);
        id
    }

    /// The folded constant, if it is finite.
    fn folded(&mut self, value: f64) -> Option<Id> {
        value.is_finite().then(|| self.constant(value))
    }

    /// A number.
    pub fn constant(&mut self, value: f64) -> Id {
        self.intern(Node::Const(Constant::new(value)))
    }

    /// The number 0.
    pub fn zero(&mut self) -> Id {
        self.constant(0.0)
    }

    /// The number 1.
    pub fn one(&mut self) -> Id {
        self.constant(1.0)
    }

    /// The independent variable number `index`.
    pub fn var(&mut self, index: usize) -> Id {
        self.intern(Node::Var(
            u32::try_from(index).expect("fewer than 2³² variables"),
        ))
    }

    /// −x.
    pub fn neg(&mut self, x: Id) -> Id {
        match self.node(x) {
            Node::Const(c) => self.constant(-c.value()),
            Node::Neg(y) => y,
            Node::Mul(c, y) if self.value(c).is_some() => {
                let c = self.neg(c);
                self.mul(c, y)
            }
            _ => self.intern(Node::Neg(x)),
        }
    }

    /// x + y.
    pub fn add(&mut self, x: Id, y: Id) -> Id {
        if let (Some(a), Some(b)) = (self.value(x), self.value(y))
            && let Some(id) = self.folded(a + b)
        {
            return id;
        }
        if self.is_zero(x) {
            return y;
        }
        if self.is_zero(y) {
            return x;
        }
        match (self.node(x), self.node(y)) {
            (Node::Neg(a), Node::Neg(b)) => {
                let sum = self.add(a, b);
                self.neg(sum)
            }
            (Node::Neg(a), _) => self.sub(y, a),
            (_, Node::Neg(b)) => self.sub(x, b),
            _ if x == y => {
                let two = self.constant(2.0);
                self.mul(two, x)
            }
            _ => self.intern(Node::Add(x.min(y), x.max(y))),
        }
    }

    /// x − y.
    pub fn sub(&mut self, x: Id, y: Id) -> Id {
        if let (Some(a), Some(b)) = (self.value(x), self.value(y))
            && let Some(id) = self.folded(a - b)
        {
            return id;
        }
        if x == y {
            return self.zero();
        }
        if self.is_zero(x) {
            return self.neg(y);
        }
        if self.is_zero(y) {
            return x;
        }
        match (self.node(x), self.node(y)) {
            (Node::Neg(a), Node::Neg(b)) => self.sub(b, a),
            (Node::Neg(a), _) => {
                let sum = self.add(a, y);
                self.neg(sum)
            }
            (_, Node::Neg(b)) => self.add(x, b),
            // One of x − y and y − x exists; the other is its negative.
            _ if self.ids.contains_key(&Node::Sub(y, x)) => {
                let mirrored = self.intern(Node::Sub(y, x));
                self.neg(mirrored)
            }
            _ => self.intern(Node::Sub(x, y)),
        }
    }

    /// x · y.
    pub fn mul(&mut self, x: Id, y: Id) -> Id {
        match (self.value(x), self.value(y)) {
            (Some(a), Some(b)) => {
                if let Some(id) = self.folded(a * b) {
                    return id;
                }
            }
            // Constants stand first.
            (None, Some(_)) => return self.mul(y, x),
            (Some(0.0), None) => return x,
            (Some(1.0), None) => return y,
            (Some(-1.0), None) => return self.neg(y),
            _ => {}
        }
        match (self.node(x), self.node(y)) {
            (Node::Neg(a), Node::Neg(b)) => self.mul(a, b),
            (Node::Const(c), Node::Neg(b)) => {
                let c = self.constant(-c.value());
                self.mul(c, b)
            }
            (Node::Neg(a), _) => {
                let product = self.mul(a, y);
                self.neg(product)
            }
            (_, Node::Neg(b)) => {
                let product = self.mul(x, b);
                self.neg(product)
            }
            // Constants of products move outwards, where they meet.
            (_, Node::Mul(c, b)) if self.value(c).is_some() => {
                let (inner, outer) = if self.value(x).is_some() {
                    (b, self.mul(c, x))
                } else {
                    (self.mul(x, b), c)
                };
                if self.value(outer).is_some() {
                    self.mul(outer, inner)
                } else {
                    // The product of the two constants is not finite.
                    self.intern(Node::Mul(x, y))
                }
            }
            (Node::Mul(c, a), _) if self.value(c).is_some() => {
                let inner = self.mul(a, y);
                self.mul(c, inner)
            }
            (Node::Const(_), _) => self.intern(Node::Mul(x, y)),
            _ => self.intern(Node::Mul(x.min(y), x.max(y))),
        }
    }

    /// x / y. Division by a constant becomes multiplication with its reciprocal.
    pub fn div(&mut self, x: Id, y: Id) -> Id {
        if let Some(b) = self.value(y) {
            if let Some(a) = self.value(x)
                && let Some(id) = self.folded(a / b)
            {
                return id;
            }
            if b != 0.0 && (1.0 / b).is_finite() {
                let reciprocal = self.constant(1.0 / b);
                return self.mul(reciprocal, x);
            }
        }
        if self.is_zero(x) && self.value(y).is_none() {
            return x;
        }
        if x == y {
            return self.one();
        }
        match (self.node(x), self.node(y)) {
            (Node::Neg(a), Node::Neg(b)) => self.div(a, b),
            (Node::Neg(a), _) => {
                let quotient = self.div(a, y);
                self.neg(quotient)
            }
            (_, Node::Neg(b)) => {
                let quotient = self.div(x, b);
                self.neg(quotient)
            }
            _ => self.intern(Node::Div(x, y)),
        }
    }

    /// xⁿ.
    pub fn powi(&mut self, x: Id, n: i32) -> Id {
        if let Some(a) = self.value(x)
            && let Some(id) = self.folded(a.powi(n))
        {
            return id;
        }
        match n {
            0 => self.one(),
            1 => x,
            2 => self.mul(x, x),
            -1 => {
                let one = self.one();
                self.div(one, x)
            }
            _ => match self.node(x) {
                Node::Neg(a) => {
                    let power = self.powi(a, n);
                    if n % 2 == 0 { power } else { self.neg(power) }
                }
                _ => self.intern(Node::Powi(x, n)),
            },
        }
    }

    /// f(x).
    pub fn call(&mut self, f: Function, x: Id) -> Id {
        match self.node(x) {
            Node::Const(c) => {
                if let Some(id) = self.folded(f.apply(c.value())) {
                    return id;
                }
            }
            Node::Neg(a) if f.is_even() => return self.call(f, a),
            Node::Neg(a) if f.is_odd() => {
                let y = self.call(f, a);
                return self.neg(y);
            }
            _ => {}
        }
        self.intern(Node::Call(f, x))
    }

    /// sin x.
    pub fn sin(&mut self, x: Id) -> Id {
        self.call(Function::Sin, x)
    }

    /// cos x.
    pub fn cos(&mut self, x: Id) -> Id {
        self.call(Function::Cos, x)
    }

    /// Sum of expressions, left to right; 0 for none.
    pub fn sum(&mut self, terms: impl IntoIterator<Item = Id>) -> Id {
        let zero = self.zero();
        terms
            .into_iter()
            .fold(zero, |sum, term| self.add(sum, term))
    }

    /// `outputs` with variables replaced: `replacement(i)` is the new expression of variable `i`,
    /// or `None` to keep it.
    pub fn substitute(
        &mut self,
        outputs: &[Id],
        mut replacement: impl FnMut(&mut Self, u32) -> Option<Id>,
    ) -> Vec<Id> {
        let order = self.reachable(outputs);
        let mut new: Vec<Option<Id>> = vec![None; self.len()];
        for id in order {
            let of =
                |x: Id| new[x.index()].expect("operands come before the operations that use them");
            let image = match self.node(id) {
                Node::Const(_) => id,
                Node::Var(i) => replacement(self, i).unwrap_or(id),
                Node::Neg(x) => {
                    let x = of(x);
                    self.neg(x)
                }
                Node::Add(x, y) => {
                    let (x, y) = (of(x), of(y));
                    self.add(x, y)
                }
                Node::Sub(x, y) => {
                    let (x, y) = (of(x), of(y));
                    self.sub(x, y)
                }
                Node::Mul(x, y) => {
                    let (x, y) = (of(x), of(y));
                    self.mul(x, y)
                }
                Node::Div(x, y) => {
                    let (x, y) = (of(x), of(y));
                    self.div(x, y)
                }
                Node::Powi(x, n) => {
                    let x = of(x);
                    self.powi(x, n)
                }
                Node::Call(f, x) => {
                    let x = of(x);
                    self.call(f, x)
                }
            };
            new[id.index()] = Some(image);
        }
        outputs
            .iter()
            .map(|id| new[id.index()].expect("outputs are reachable"))
            .collect()
    }

    /// Every expression that `outputs` depend on, themselves included, operands before operations.
    pub fn reachable(&self, outputs: &[Id]) -> Vec<Id> {
        self.reachable_where(outputs, |_| true)
    }

    /// As [`reachable`](Self::reachable), not entering expressions for which `enter` is false.
    pub fn reachable_where(&self, outputs: &[Id], enter: impl Fn(Id) -> bool) -> Vec<Id> {
        let mut seen = vec![false; self.len()];
        let mut stack: Vec<Id> = outputs.to_vec();
        let mut found = Vec::new();
        while let Some(id) = stack.pop() {
            if !seen[id.index()] && enter(id) {
                seen[id.index()] = true;
                found.push(id);
                stack.extend(self.node(id).operands());
            }
        }
        found.sort_unstable();
        found
    }
}
