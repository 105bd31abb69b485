//! The variables of a robot and the translation of declared expressions.
//!
//! Variables are numbered as the runtime stacks its arguments: `z = (q, v, a, u, p)`, then the
//! multipliers λ, then one per entry written `_`.

use pid_symbolic::{Function, Graph, Id};

use crate::model::{Expr, Func, Robot};

/// Replacement of an entry written `_`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Blanks {
    /// The number zero: the equations that are emitted.
    Zero,
    /// A variable of its own: to prove that it does not enter.
    Free,
}

/// The variables of a robot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Symbols {
    /// Coordinates.
    pub q: Vec<Id>,
    /// Velocities.
    pub v: Vec<Id>,
    /// Accelerations.
    pub a: Vec<Id>,
    /// Inputs.
    pub u: Vec<Id>,
    /// Parameters.
    pub p: Vec<Id>,
    /// Multipliers of the equations.
    pub lambda: Vec<Id>,
    /// Replacements of the entries written `_`.
    pub blanks: Vec<Id>,
}

impl Symbols {
    /// The variables of a robot.
    pub fn new(g: &mut Graph, robot: &Robot, blanks: Blanks) -> Self {
        let (nq, nu, np) = (robot.nq(), robot.inputs.len(), robot.params.len());
        let mut next = 0;
        let mut take = |g: &mut Graph, count: usize| {
            let ids = (next..next + count).map(|i| g.var(i)).collect::<Vec<_>>();
            next += count;
            ids
        };
        let [q, v, a] = std::array::from_fn(|_| take(g, nq));
        let (u, p, lambda) = (take(g, nu), take(g, np), take(g, nq));
        let blanks = match blanks {
            Blanks::Free => take(g, robot.blanks.len()),
            Blanks::Zero => vec![g.zero(); robot.blanks.len()],
        };
        Self {
            q,
            v,
            a,
            u,
            p,
            lambda,
            blanks,
        }
    }

    /// `z = (q, v, a, u, p)`.
    pub fn z(&self) -> Vec<Id> {
        [&self.q, &self.v, &self.a, &self.u, &self.p]
            .into_iter()
            .flatten()
            .copied()
            .collect()
    }

    /// A declared expression in these variables.
    pub fn expression(&self, g: &mut Graph, expr: &Expr) -> Id {
        match expr {
            Expr::Num(value) => g.constant(*value),
            Expr::Param(k) => self.p[*k],
            Expr::Input(k) => self.u[*k],
            Expr::Position(k) => self.q[*k],
            Expr::Velocity(k) => self.v[*k],
            Expr::Blank(k) => self.blanks[*k],
            Expr::Neg(x) => {
                let x = self.expression(g, x);
                g.neg(x)
            }
            Expr::Add(x, y) => {
                let (x, y) = (self.expression(g, x), self.expression(g, y));
                g.add(x, y)
            }
            Expr::Sub(x, y) => {
                let (x, y) = (self.expression(g, x), self.expression(g, y));
                g.sub(x, y)
            }
            Expr::Mul(x, y) => {
                let (x, y) = (self.expression(g, x), self.expression(g, y));
                g.mul(x, y)
            }
            Expr::Div(x, y) => {
                let (x, y) = (self.expression(g, x), self.expression(g, y));
                g.div(x, y)
            }
            Expr::Powi(x, n) => {
                let x = self.expression(g, x);
                g.powi(x, *n)
            }
            Expr::Call(f, x) => {
                let x = self.expression(g, x);
                g.call(function(*f), x)
            }
        }
    }

    /// Three declared expressions.
    pub fn vector(&self, g: &mut Graph, exprs: &[Expr; 3]) -> [Id; 3] {
        [0, 1, 2].map(|k| self.expression(g, &exprs[k]))
    }
}

fn function(f: Func) -> Function {
    match f {
        Func::Sin => Function::Sin,
        Func::Cos => Function::Cos,
        Func::Tan => Function::Tan,
        Func::Tanh => Function::Tanh,
        Func::Atan => Function::Atan,
        Func::Exp => Function::Exp,
        Func::Ln => Function::Ln,
        Func::Sqrt => Function::Sqrt,
        Func::Abs => Function::Abs,
        Func::Sign => Function::Sign,
    }
}
