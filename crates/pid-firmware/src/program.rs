//! Expressions as straight-line code: one name per operation.

use std::fmt::Write;

use pid_symbolic::schedule::{order, twin};
use pid_symbolic::{Function, Graph, Id, Node};

use crate::Precision;

/// What differs between languages.
pub(crate) trait Language {
    /// A number.
    fn number(&self, x: f64) -> String;
    /// A function of an argument.
    fn call(&self, f: Function, x: &str) -> String;
    /// A name for a value.
    fn bind(&self, name: &str, value: &str) -> String;
    /// Names for sine and cosine of an argument, where one call gives both.
    fn sine_cosine(&self, _sine: &str, _cosine: &str, _x: &str) -> Option<String> {
        None
    }
}

/// A number with all the digits it needs, as C and Rust read it, without a suffix.
pub(crate) fn digits(x: f64, precision: Precision) -> String {
    match precision {
        Precision::F32 => format!("{:?}", x as f32),
        Precision::F64 => format!("{x:?}"),
    }
}

/// The lines that compute `outputs`, and the names of the outputs. Variables are `q`, `v` and `a` of `n`
/// entries each.
pub(crate) fn lines(
    g: &Graph,
    outputs: &[Id],
    n: usize,
    language: &dyn Language,
) -> (String, Vec<String>) {
    let order = order(g, outputs);
    let mut names: Vec<String> = vec![String::new(); g.len()];
    for id in g.reachable(outputs) {
        match g.node(id) {
            Node::Const(c) => {
                let text = language.number(c.value());
                // `x - -1` reads as well as `x - (-1)`, `-(-1)` better than `--1`.
                names[id.index()] = match text.starts_with('-') {
                    true => format!("({text})"),
                    false => text,
                };
            }
            Node::Var(i) => {
                let (kind, entry) = (i as usize / n, i as usize % n);
                names[id.index()] = format!("{}[{entry}]", ["q", "v", "a"][kind.min(2)]);
            }
            _ => {}
        }
    }
    for (k, &id) in order.iter().enumerate() {
        names[id.index()] = format!("x{k}");
    }
    let mut out = String::new();
    let mut given = vec![false; g.len()];
    for &id in &order {
        if given[id.index()] {
            continue;
        }
        let of = |x: Id| names[x.index()].as_str();
        let own = of(id);
        let node = g.node(id);
        // Writing to a text cannot fail.
        let mut line = |text: &str| {
            let _ = writeln!(out, "    {text}");
        };
        if let (Node::Call(f, x), Some(other)) = (node, twin(g, node))
            && !of(other).is_empty()
        {
            let (sine, cosine) = match f {
                Function::Sin => (own, of(other)),
                _ => (of(other), own),
            };
            if let Some(text) = language.sine_cosine(sine, cosine, of(x)) {
                line(&text);
                given[other.index()] = true;
                continue;
            }
        }
        if let Node::Powi(x, exponent) = node {
            for text in power(own, of(x), exponent, language) {
                line(&text);
            }
            continue;
        }
        let value = match node {
            Node::Const(_) | Node::Var(_) | Node::Powi(..) => continue,
            Node::Neg(x) => format!("-{}", of(x)),
            Node::Add(x, y) => format!("{} + {}", of(x), of(y)),
            Node::Sub(x, y) => format!("{} - {}", of(x), of(y)),
            Node::Mul(x, y) => format!("{} * {}", of(x), of(y)),
            Node::Div(x, y) => format!("{} / {}", of(x), of(y)),
            Node::Call(f, x) => language.call(f, of(x)),
        };
        line(&language.bind(own, &value));
    }
    let outputs = outputs.iter().map(|x| names[x.index()].clone());
    (out, outputs.collect())
}

/// The lines of `own = xⁿ`: squares, and their product.
fn power(own: &str, x: &str, n: i32, language: &dyn Language) -> Vec<String> {
    let mut lines = Vec::new();
    let mut factors: Vec<String> = Vec::new();
    let (mut left, mut square, mut depth) = (n.unsigned_abs(), x.to_owned(), 0);
    while left > 0 {
        if left % 2 == 1 {
            factors.push(square.clone());
        }
        left /= 2;
        if left > 0 {
            depth += 1;
            let next = format!("{own}_{depth}");
            lines.push(language.bind(&next, &format!("{square} * {square}")));
            square = next;
        }
    }
    let product = factors.join(" * ");
    let value = match n < 0 {
        true => format!("{} / ({product})", language.number(1.0)),
        false => product,
    };
    lines.push(language.bind(own, &value));
    lines
}
