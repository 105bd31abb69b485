//! Formulas as text, in the language of expressions of `robot!`.

use std::fmt::Write;

use super::level::{self, Level};
use super::{Formula, Readable, Variable};

pub(super) fn equations(readable: &Readable<'_>) -> String {
    let joints = readable.joints();
    let mut text = format!(
        "{}: M(q, p) a + b(q, v, p) = f_L(q, v, p, u)\n",
        readable.name()
    );
    let mut line = |name: String, value: &Formula| {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{name} = {}", formula(readable, value));
    };
    for (k, value) in readable.shared.iter().enumerate() {
        line(format!("s{}", k + 1), value);
    }
    let mut entries = readable.mass_matrix.iter();
    for i in 0..joints.len() {
        for (j, value) in (0..=i).zip(&mut entries) {
            if *value != Formula::Number(0.0) {
                line(format!("M[{}, {}]", joints[i], joints[j]), value);
            }
        }
    }
    for (name, values) in [("b", &readable.bias), ("f_L", &readable.applied_force)] {
        for (joint, value) in joints.iter().zip(values) {
            line(format!("{name}[{joint}]"), value);
        }
    }
    text
}

fn formula(readable: &Readable<'_>, formula: &Formula) -> String {
    write(readable, formula).0
}

fn write(r: &Readable<'_>, f: &Formula) -> (String, Level) {
    let at = |x: &Formula, least: Level| {
        let (text, level) = write(r, x);
        if level < least {
            format!("({text})")
        } else {
            text
        }
    };
    match f {
        Formula::Number(x) => (x.to_string(), Level::Atom),
        Formula::Shared(k) => (format!("s{k}"), Level::Atom),
        Formula::Variable(k) => {
            let name = match r.variable(*k) {
                Variable::Position(joint) => format!("q.{joint}"),
                Variable::Velocity(joint) => format!("v.{joint}"),
                Variable::Acceleration(joint) => format!("a.{joint}"),
                Variable::Input(name) | Variable::Param(name) => name.to_owned(),
            };
            (name, Level::Atom)
        }
        Formula::Sum(terms) => (level::sum(terms, at), Level::Sum),
        Formula::Negative(x) => (format!("-{}", at(x, Level::Product)), Level::Sum),
        Formula::Product(factors) => {
            let factors: Vec<String> = factors
                .iter()
                .map(|x| match x {
                    // a*(b/c) keeps its order of evaluation.
                    Formula::Quotient(..) => at(x, Level::Atom),
                    x => at(x, Level::Product),
                })
                .collect();
            (factors.join("*"), Level::Product)
        }
        Formula::Quotient(x, y) => (
            format!("{}/{}", at(x, Level::Product), at(y, Level::Atom)),
            Level::Product,
        ),
        // A power of a power needs brackets, as in the language.
        Formula::Power(x, n) => {
            let base = match **x {
                Formula::Power(..) => format!("({})", write(r, x).0),
                _ => at(x, Level::Atom),
            };
            (format!("{base}^{n}"), Level::Atom)
        }
        Formula::Call(f, x) => (format!("{}({})", f.name(), at(x, Level::Sum)), Level::Atom),
    }
}
