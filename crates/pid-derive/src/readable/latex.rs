//! Formulas as LaTeX.

use std::fmt::Write;

use pid_symbolic::Function;

use super::level::{self, Level};
use super::{Formula, Readable, Variable};

pub(super) fn equations(r: &Readable<'_>) -> String {
    let joints = r.joints();
    let mut text = String::new();
    let mut part = |lines: Vec<(String, &Formula)>| {
        if lines.is_empty() {
            return;
        }
        let lines: Vec<String> = lines
            .into_iter()
            .map(|(name, value)| format!("  {name} &= {}", formula(r, value)))
            .collect();
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "\\begin{{align*}}\n{}\n\\end{{align*}}",
            lines.join(" \\\\\n")
        );
    };
    part(
        r.shared
            .iter()
            .enumerate()
            .map(|(k, value)| (format!("s_{{{}}}", k + 1), value))
            .collect(),
    );
    let indices = |i: usize, j: usize| subscript(&format!("{}, {}", joints[i], joints[j]));
    let pairs = (0..joints.len()).flat_map(|i| (0..=i).map(move |j| (i, j)));
    part(
        pairs
            .zip(&r.mass_matrix)
            .filter(|(_, value)| **value != Formula::Number(0.0))
            .map(|((i, j), value)| (format!("M{}", indices(i, j)), value))
            .collect(),
    );
    for (name, values) in [("b", &r.bias), ("f_L", &r.applied_force)] {
        part(
            joints
                .iter()
                .zip(values)
                .map(|(joint, value)| match name {
                    "b" => (format!("b{}", subscript(joint)), value),
                    _ => (format!("f{}", subscript(&format!("L, {joint}"))), value),
                })
                .collect(),
        );
    }
    text
}

fn formula(r: &Readable<'_>, f: &Formula) -> String {
    write(r, f).0
}

fn brackets(text: &str) -> String {
    format!("\\left({text}\\right)")
}

fn write(r: &Readable<'_>, f: &Formula) -> (String, Level) {
    let at = |x: &Formula, least: Level| {
        let (text, level) = write(r, x);
        if level < least { brackets(&text) } else { text }
    };
    match f {
        Formula::Number(x) => (number(*x), Level::Atom),
        Formula::Shared(k) => (format!("s_{{{k}}}"), Level::Atom),
        Formula::Variable(k) => {
            let name = match r.variable(*k) {
                Variable::Position(joint) => format!("q{}", subscript(joint)),
                Variable::Velocity(joint) => format!("\\dot{{q}}{}", subscript(joint)),
                Variable::Acceleration(joint) => format!("\\ddot{{q}}{}", subscript(joint)),
                Variable::Input(name) | Variable::Param(name) => symbol(name),
            };
            (name, Level::Atom)
        }
        Formula::Sum(terms) => (level::sum(terms, at), Level::Sum),
        Formula::Negative(x) => (format!("-{}", at(x, Level::Product)), Level::Sum),
        Formula::Product(factors) => {
            let mut text = String::new();
            for (k, factor) in factors.iter().enumerate() {
                if k > 0 {
                    // Two numbers side by side would read as one.
                    text += match factor {
                        Formula::Number(_) => " \\cdot ",
                        _ => " \\, ",
                    };
                }
                text += &at(factor, Level::Product);
            }
            (text, Level::Product)
        }
        Formula::Quotient(x, y) => (
            format!("\\frac{{{}}}{{{}}}", write(r, x).0, write(r, y).0),
            Level::Product,
        ),
        Formula::Power(x, n) => match &**x {
            // sin² x.
            Formula::Call(f, y) if *n > 0 && command(*f).is_some() => {
                let name = command(*f).unwrap_or_default();
                (format!("{name}^{{{n}}} {}", argument(r, y)), Level::Atom)
            }
            Formula::Variable(k) => {
                let base = at(x, Level::Atom);
                let base = match r.variable(*k) {
                    Variable::Param(_) | Variable::Input(_) => base,
                    _ => format!("{{{base}}}"),
                };
                (format!("{base}^{{{n}}}"), Level::Atom)
            }
            Formula::Number(_) | Formula::Shared(_) => {
                (format!("{}^{{{n}}}", at(x, Level::Atom)), Level::Atom)
            }
            _ => (format!("{}^{{{n}}}", brackets(&write(r, x).0)), Level::Atom),
        },
        Formula::Call(Function::Sqrt, x) => (format!("\\sqrt{{{}}}", write(r, x).0), Level::Atom),
        Formula::Call(Function::Abs, x) => {
            (format!("\\left|{}\\right|", write(r, x).0), Level::Atom)
        }
        Formula::Call(f, x) => {
            let name = command(*f).unwrap_or("\\operatorname{sign}");
            (format!("{name} {}", argument(r, x)), Level::Atom)
        }
    }
}

/// The argument of a function: a single symbol needs no brackets.
fn argument(r: &Readable<'_>, x: &Formula) -> String {
    match x {
        Formula::Variable(_) | Formula::Shared(_) | Formula::Number(_) => write(r, x).0,
        _ => brackets(&write(r, x).0),
    }
}

/// The command of a function whose power is written at its name.
fn command(f: Function) -> Option<&'static str> {
    match f {
        Function::Sin => Some("\\sin"),
        Function::Cos => Some("\\cos"),
        Function::Tan => Some("\\tan"),
        Function::Tanh => Some("\\tanh"),
        Function::Atan => Some("\\arctan"),
        Function::Exp => Some("\\exp"),
        Function::Ln => Some("\\ln"),
        _ => None,
    }
}

fn number(x: f64) -> String {
    if x != 0.0 && !(1e-4..1e6).contains(&x.abs()) {
        let text = format!("{x:e}");
        if let Some((mantissa, exponent)) = text.split_once('e') {
            return format!("{mantissa} \\cdot 10^{{{exponent}}}");
        }
    }
    x.to_string()
}

fn subscript(text: &str) -> String {
    format!(
        "_{{\\mathrm{{{}}}}}",
        text.replace('_', "\\_").replace(", ", ",\\,")
    )
}

/// `m1` as `m_{1}`, `iz1` as `i_{z1}`, `dry_elbow` as an upright word with a subscript.
fn symbol(name: &str) -> String {
    let (stem, rest) = name.split_once('_').unwrap_or((name, ""));
    let digits = stem.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    let (word, number) = stem.split_at(digits);
    let mut index = number.to_owned();
    let mut base = word.to_owned();
    let mut letters = word.chars();
    // One or two letters with a number: a symbol with an index.
    if let (Some(first), Some(second), None) = (letters.next(), letters.next(), letters.next())
        && !number.is_empty()
    {
        base = first.to_string();
        index = format!("{second}{number}");
    }
    if base.chars().count() > 1 {
        base = format!("\\mathrm{{{base}}}");
    }
    if !rest.is_empty() {
        if !index.is_empty() {
            index += ",\\,";
        }
        index += &rest.replace('_', "\\_");
    }
    match index.is_empty() {
        true => base,
        false if index.chars().all(|c| c.is_ascii_digit()) => format!("{base}_{{{index}}}"),
        false => format!("{base}_{{\\mathrm{{{index}}}}}"),
    }
}
