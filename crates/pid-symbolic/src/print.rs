//! Readable text of an expression.

use crate::graph::Graph;
use crate::node::{Id, Node};

/// Binding strength: sum, product, negation, power or atom.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Level {
    Sum,
    Product,
    Prefix,
    Atom,
}

/// The expression in ordinary notation, variables named by `name`. Shared subexpressions are
/// written out each time, so this is meant for small expressions.
pub fn expression(g: &Graph, id: Id, name: &impl Fn(u32) -> String) -> String {
    write(g, id, name).0
}

fn write(g: &Graph, id: Id, name: &impl Fn(u32) -> String) -> (String, Level) {
    let at = |x: Id, least: Level| {
        let (text, level) = write(g, x, name);
        if level < least {
            format!("({text})")
        } else {
            text
        }
    };
    match g.node(id) {
        Node::Const(c) if c.value() < 0.0 => (format!("{}", c.value()), Level::Prefix),
        Node::Const(c) => (format!("{}", c.value()), Level::Atom),
        Node::Var(i) => (name(i), Level::Atom),
        Node::Neg(x) => (format!("-{}", at(x, Level::Product)), Level::Prefix),
        Node::Add(x, y) => (
            format!("{} + {}", at(x, Level::Sum), at(y, Level::Sum)),
            Level::Sum,
        ),
        Node::Sub(x, y) => (
            format!("{} - {}", at(x, Level::Sum), at(y, Level::Product)),
            Level::Sum,
        ),
        Node::Mul(x, y) => (
            format!("{}*{}", at(x, Level::Product), at(y, Level::Product)),
            Level::Product,
        ),
        Node::Div(x, y) => (
            format!("{}/{}", at(x, Level::Product), at(y, Level::Atom)),
            Level::Product,
        ),
        Node::Powi(x, n) => (format!("{}^{n}", at(x, Level::Atom)), Level::Atom),
        Node::Call(f, x) => (format!("{}({})", f.name(), at(x, Level::Sum)), Level::Atom),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parentheses_where_needed_only() {
        let mut g = Graph::new();
        let (x, y, two) = (g.var(0), g.var(1), g.constant(2.0));
        let sum = g.add(x, y);
        let product = g.mul(two, sum);
        let sine = g.sin(product);
        let cube = g.powi(sum, 3);
        let quotient = g.div(sine, cube);
        let difference = g.sub(x, quotient);
        let negative = g.neg(difference);
        let name = |i| ["x", "y"][i as usize].to_owned();
        assert_eq!(
            expression(&g, negative, &name),
            "-(x - sin(2*(x + y))/(x + y)^3)"
        );
    }
}
