//! Numbers in resolved expressions: constants, and values at given parameters.

use pid_derive::model::{Expr, Func};

/// Value of an expression; `at` gives the leaves.
pub(super) fn eval(e: &Expr, at: &impl Fn(&Expr) -> Option<f64>) -> Option<f64> {
    Some(match e {
        Expr::Num(x) => *x,
        Expr::Neg(x) => -eval(x, at)?,
        Expr::Add(a, b) => eval(a, at)? + eval(b, at)?,
        Expr::Sub(a, b) => eval(a, at)? - eval(b, at)?,
        Expr::Mul(a, b) => eval(a, at)? * eval(b, at)?,
        Expr::Div(a, b) => eval(a, at)? / eval(b, at)?,
        Expr::Powi(x, n) => eval(x, at)?.powi(*n),
        Expr::Call(f, x) => {
            let x = eval(x, at)?;
            match f {
                Func::Sin => x.sin(),
                Func::Cos => x.cos(),
                Func::Tan => x.tan(),
                Func::Tanh => x.tanh(),
                Func::Atan => x.atan(),
                Func::Exp => x.exp(),
                Func::Ln => x.ln(),
                Func::Sqrt => x.sqrt(),
                Func::Abs => x.abs(),
                Func::Sign => x.signum(),
            }
        }
        leaf => at(leaf)?,
    })
}

/// Value of an expression without parameters.
pub(super) fn constant(e: &Expr) -> Option<f64> {
    eval(e, &|_| None)
}

/// Value of an expression of parameters.
pub(super) fn at_params(e: &Expr, p: &[f64]) -> Option<f64> {
    eval(e, &|leaf| match leaf {
        Expr::Param(k) => p.get(*k).copied(),
        _ => None,
    })
}

/// A product, factors 1 left out.
pub(super) fn times(a: Expr, b: Expr) -> Expr {
    match (a, b) {
        (Expr::Num(1.0), x) | (x, Expr::Num(1.0)) => x,
        (a, b) => Expr::Mul(Box::new(a), Box::new(b)),
    }
}

/// A sum, terms 0 left out.
pub(super) fn plus(a: Expr, b: Expr) -> Expr {
    match (a, b) {
        (Expr::Num(0.0), x) | (x, Expr::Num(0.0)) => x,
        (a, b) => Expr::Add(Box::new(a), Box::new(b)),
    }
}
