//! `--constrain`: relations between parameters and states, written as formulas.
//!
//! ```text
//! mass_upper + mass_lower <= 12.5        viscous_left == viscous_right        v_elbow * v_elbow <= 4
//! ```
//!
//! Names are those of parameters, and `q_JOINT`, `v_JOINT` for positions and velocities; in quotes
//! where they are not words. With a state in it, a relation holds at every node. The text is an
//! expression of Rust, which `syn` parses, evaluated over dual numbers.

use std::sync::Arc;

use pid_fit::transcribe::{Constraint, Place, Sense};
use pid_runtime::dynamics::Dynamics;
use pid_runtime::generic::functions::{Exact, GenericFunction};
use pid_runtime::num_dual::DualNum;
use syn::{BinOp, Expr, Lit, UnOp};

use crate::error::CliError;
use crate::parameters::nearest;

/// Functions of one number.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Function {
    Sin,
    Cos,
    Tan,
    Exp,
    Ln,
    Sqrt,
    Abs,
}

const FUNCTIONS: [(&str, Function); 7] = [
    ("sin", Function::Sin),
    ("cos", Function::Cos),
    ("tan", Function::Tan),
    ("exp", Function::Exp),
    ("ln", Function::Ln),
    ("sqrt", Function::Sqrt),
    ("abs", Function::Abs),
];

/// An expression over (x, p).
#[derive(Debug, Clone, PartialEq)]
enum Term {
    Number(f64),
    Variable(usize),
    Add(Box<Term>, Box<Term>),
    Sub(Box<Term>, Box<Term>),
    Mul(Box<Term>, Box<Term>),
    Div(Box<Term>, Box<Term>),
    Of(Function, Box<Term>),
}

impl Term {
    fn value<D: DualNum<Primitive = f64> + Copy>(&self, x: &[D], p: &[D]) -> D {
        let value = |term: &Term| term.value(x, p);
        match self {
            Term::Number(number) => D::from(*number),
            Term::Variable(at) => match at.checked_sub(x.len()) {
                Some(parameter) => p[parameter],
                None => x[*at],
            },
            Term::Add(a, b) => value(a) + value(b),
            Term::Sub(a, b) => value(a) - value(b),
            Term::Mul(a, b) => value(a) * value(b),
            Term::Div(a, b) => value(a) / value(b),
            Term::Of(function, a) => match function {
                Function::Sin => value(a).sin(),
                Function::Cos => value(a).cos(),
                Function::Tan => value(a).tan(),
                Function::Exp => value(a).exp(),
                Function::Ln => value(a).ln(),
                Function::Sqrt => value(a).sqrt(),
                Function::Abs => value(a).abs(),
            },
        }
    }

    fn variables(&self, found: &mut Vec<usize>) {
        match self {
            Term::Number(_) => {}
            Term::Variable(at) => found.push(*at),
            Term::Of(_, a) => a.variables(found),
            Term::Add(a, b) | Term::Sub(a, b) | Term::Mul(a, b) | Term::Div(a, b) => {
                a.variables(found);
                b.variables(found);
            }
        }
    }
}

impl GenericFunction for Term {
    fn outputs(&self) -> usize {
        1
    }

    fn variables(&self) -> Option<Vec<usize>> {
        let mut found = Vec::new();
        self.variables(&mut found);
        found.sort_unstable();
        found.dedup();
        Some(found)
    }

    fn evaluate<D: DualNum<Primitive = f64> + Copy>(&self, x: &[D], p: &[D], out: &mut [D]) {
        out[0] = self.value(x, p);
    }
}

/// The relation in a text, for a model.
///
/// # Errors
/// [`CliError::Constraint`] for a text that is no relation, an unknown name, or a relation of
/// numbers alone.
pub(crate) fn parse(text: &str, model: &dyn Dynamics) -> Result<Constraint, CliError> {
    let wrong = |reason: String| CliError::Constraint {
        text: text.to_owned(),
        reason,
    };
    const RELATION: &str = "a relation has the form LEFT <= RIGHT, LEFT >= RIGHT or LEFT == RIGHT";
    let parsed: Expr = syn::parse_str(text).map_err(|error| {
        wrong(format!(
            "{error}\n  help: {RELATION}; names that are not words stand in quotes"
        ))
    })?;
    let names = names(model);
    let side = |expr: &Expr| term(expr, &names).map_err(&wrong);
    let (left, right, sense) = match &parsed {
        Expr::Assign(e) => (side(&e.left)?, side(&e.right)?, Sense::Equal),
        Expr::Binary(e) => match e.op {
            BinOp::Eq(_) => (side(&e.left)?, side(&e.right)?, Sense::Equal),
            BinOp::Le(_) => (side(&e.left)?, side(&e.right)?, Sense::AtMost),
            BinOp::Ge(_) => (side(&e.right)?, side(&e.left)?, Sense::AtMost),
            _ => return Err(wrong(format!("no relation\n  help: {RELATION}"))),
        },
        _ => return Err(wrong(format!("no relation\n  help: {RELATION}"))),
    };
    let function = Term::Sub(Box::new(left), Box::new(right));
    let (nx, np) = (2 * model.dims().nq, model.dims().np);
    let mut variables = Vec::new();
    function.variables(&mut variables);
    let place = match variables.iter().min() {
        None => return Err(wrong("no parameter and no state in it".to_owned())),
        Some(first) if *first < nx => Place::EveryNode,
        Some(_) => Place::Parameters,
    };
    Ok(Constraint {
        name: text.to_owned(),
        place,
        sense,
        function: Arc::new(Exact::new(function, nx, np)),
    })
}

/// Names of states and parameters in their order.
fn names(model: &dyn Dynamics) -> Vec<String> {
    let of = |prefix: &'static str| {
        let joints = model.joints().iter();
        joints.map(move |j| format!("{prefix}_{}", j.name))
    };
    let parameters = model.params().iter().map(|p| p.name.to_string());
    of("q").chain(of("v")).chain(parameters).collect()
}

fn term(expr: &Expr, names: &[String]) -> Result<Term, String> {
    let boxed = |expr: &Expr| term(expr, names).map(Box::new);
    let named = |name: &str| match names.iter().position(|n| n == name) {
        Some(at) => Ok(Term::Variable(at)),
        None => {
            let meant = match nearest(name, names.iter().map(String::as_str)) {
                Some(nearest) => format!("did you mean `{nearest}`? "),
                None => String::new(),
            };
            Err(format!(
                "no parameter or state named `{name}`\n  help: {meant}the report lists the parameters; states are q_JOINT and v_JOINT"
            ))
        }
    };
    match expr {
        Expr::Lit(e) => match &e.lit {
            Lit::Int(number) => Ok(Term::Number(
                number.base10_parse().map_err(|e| e.to_string())?,
            )),
            Lit::Float(number) => Ok(Term::Number(
                number.base10_parse().map_err(|e| e.to_string())?,
            )),
            Lit::Str(name) => named(&name.value()),
            _ => Err("numbers and names are allowed, no other literals".to_owned()),
        },
        Expr::Path(e) => match e.path.get_ident() {
            Some(name) => named(&name.to_string()),
            None => Err("names are single words".to_owned()),
        },
        Expr::Paren(e) => term(&e.expr, names),
        Expr::Group(e) => term(&e.expr, names),
        Expr::Unary(e) => match e.op {
            UnOp::Neg(_) => Ok(Term::Sub(Box::new(Term::Number(0.0)), boxed(&e.expr)?)),
            _ => Err("the sign `-` is the only operator on one term".to_owned()),
        },
        Expr::Binary(e) => {
            let (a, b) = (boxed(&e.left)?, boxed(&e.right)?);
            match e.op {
                BinOp::Add(_) => Ok(Term::Add(a, b)),
                BinOp::Sub(_) => Ok(Term::Sub(a, b)),
                BinOp::Mul(_) => Ok(Term::Mul(a, b)),
                BinOp::Div(_) => Ok(Term::Div(a, b)),
                _ => Err("the operators are + - * /, and one relation in all".to_owned()),
            }
        }
        Expr::Call(e) => {
            let name = match e.func.as_ref() {
                Expr::Path(f) => f.path.get_ident().map(ToString::to_string),
                _ => None,
            };
            let name = name.unwrap_or_default();
            let known = FUNCTIONS.iter().find(|(f, _)| *f == name);
            match (known, e.args.len()) {
                (Some((_, function)), 1) => Ok(Term::Of(*function, boxed(&e.args[0])?)),
                _ => Err(format!(
                    "no function of one number named `{name}`\n  help: {}",
                    FUNCTIONS.map(|(f, _)| f).join(", ")
                )),
            }
        }
        _ => Err("only numbers, names, + - * / and functions of one number are allowed".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pid_models::TwoLink;

    const NX: usize = 4;

    fn value(text: &str, x: &[f64], p: &[f64]) -> f64 {
        let constraint = parse(text, &TwoLink).unwrap();
        let mut out = [f64::NAN];
        constraint.function.value(x, p, &mut out);
        out[0]
    }

    #[test]
    fn relations_are_differences_of_their_sides() {
        let p: Vec<f64> = (1..=TwoLink.dims().np).map(|k| k as f64).collect();
        let (a, b) = (&TwoLink.params()[0].name, &TwoLink.params()[1].name);
        let joint = &TwoLink.joints()[1].name;
        let x = [0.1, 0.2, 0.3, 0.4];
        assert_eq!(value(&format!("{a} + 3 * {b} <= 4.5"), &x, &p), 2.5);
        assert_eq!(value(&format!("-{a} / 4 >= {b} - 1"), &x, &p), 1.25);
        assert_eq!(value(&format!("\"{a}\" = ({b} - 5) * 2"), &x, &p), 7.0);
        let text = format!("sqrt(v_{joint} * v_{joint}) + cos(q_{joint}) <= exp(1) * {a}");
        let expected = 0.4 + 0.2_f64.cos() - 1.0_f64.exp();
        assert!((value(&text, &x, &p) - expected).abs() < 1e-15);
        let of = |text: &str| parse(text, &TwoLink).unwrap();
        assert_eq!(of(&text).place, Place::EveryNode);
        assert_eq!(of(&text).function.variables(), Some(vec![1, 3, NX]));
        let equal = of(&format!("{a} == {b}"));
        assert_eq!(
            (equal.place, equal.sense),
            (Place::Parameters, Sense::Equal)
        );
    }

    #[test]
    fn what_is_no_relation_is_explained() {
        let name = &TwoLink.params()[0].name;
        for (text, parts) in [
            (format!("{name} + 1"), &["no relation", "LEFT <= RIGHT"][..]),
            (format!("{name} < 1"), &["no relation", "LEFT <= RIGHT"]),
            ("1 <= 2".to_owned(), &["no parameter and no state"]),
            (
                format!("{name}x <= 2"),
                &["no parameter or state named", "did you mean", name],
            ),
            (format!("0 <= {name} <= 2"), &["LEFT <= RIGHT"]),
            (format!("sinh({name}) <= 2"), &["no function", "sqrt"]),
            (format!("{name} % 2 <= 2"), &["operators are + - * /"]),
            (format!("!{name} <= 2"), &["the sign `-`"]),
            (format!("{name} <= [2]"), &["only numbers, names"]),
            (format!("{name} <= true"), &["no other literals"]),
        ] {
            let message = parse(&text, &TwoLink).unwrap_err().to_string();
            for part in [&[text.as_str()], parts].concat() {
                assert!(message.contains(part), "{message}");
            }
        }
    }
}
