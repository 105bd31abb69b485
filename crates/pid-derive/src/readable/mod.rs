//! The equations of motion for people: as text and as LaTeX.
//!
//! Small systems are expanded to sums of products with `sin² + cos² = 1` applied. They are
//! collected by the factors that move: each product of sines, cosines, velocities and inputs has
//! one factor of parameters. Systems whose expansion grows too long are written as they are
//! computed, with names for shared subexpressions.
//!
//! The text is in the language of expressions of `robot!`: `q.elbow`, `v.elbow`, names of
//! parameters and inputs.

mod expand;
mod latex;
mod level;
mod text;

use std::collections::HashMap;

use pid_symbolic::{Function, Graph, Id, Node};

use crate::equations::Equations;
use crate::model::Robot;

/// A formula.
#[derive(Debug, Clone, PartialEq)]
pub enum Formula {
    /// A number.
    Number(f64),
    /// A variable of the equations, by its number in `z`.
    Variable(usize),
    /// A shared formula, by its number from 1.
    Shared(usize),
    /// A sum; terms that are [`Formula::Negative`] are subtracted.
    Sum(Vec<Formula>),
    /// A product.
    Product(Vec<Formula>),
    /// −x.
    Negative(Box<Formula>),
    /// x / y.
    Quotient(Box<Formula>, Box<Formula>),
    /// xⁿ.
    Power(Box<Formula>, i32),
    /// f(x).
    Call(Function, Box<Formula>),
}

/// Kind of a variable of the equations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Variable<'a> {
    /// Coordinate of a joint.
    Position(&'a str),
    /// Its velocity.
    Velocity(&'a str),
    /// Its acceleration.
    Acceleration(&'a str),
    /// An input.
    Input(&'a str),
    /// A parameter.
    Param(&'a str),
}

/// The equations of motion of a robot as formulas.
#[derive(Debug, Clone, PartialEq)]
pub struct Readable<'a> {
    robot: &'a Robot,
    joints: Vec<&'a str>,
    /// Shared formulas; each refers to those before it only.
    pub shared: Vec<Formula>,
    /// Lower triangle of M, row by row.
    pub mass_matrix: Vec<Formula>,
    /// b.
    pub bias: Vec<Formula>,
    /// f_L.
    pub applied_force: Vec<Formula>,
}

impl<'a> Readable<'a> {
    /// Formulas of the equations of a robot.
    pub fn new(g: &Graph, robot: &'a Robot, equations: &Equations) -> Self {
        let outputs = [
            equations.mass_matrix.as_slice(),
            &equations.bias,
            &equations.applied_force,
        ]
        .concat();
        let motion = 3 * equations.symbols.q.len() + equations.symbols.u.len();
        let (shared, mut formulas) = match expand::all(g, &outputs, motion) {
            Some(formulas) => (Vec::new(), formulas),
            None => named(g, &outputs),
        };
        let (nm, nq) = (equations.mass_matrix.len(), equations.bias.len());
        let applied_force = formulas.split_off(nm + nq);
        let bias = formulas.split_off(nm);
        let mut joints: Vec<_> = robot.joints.iter().filter(|j| j.coord.is_some()).collect();
        joints.sort_by_key(|j| j.coord);
        Self {
            robot,
            joints: joints.into_iter().map(|j| j.name.as_str()).collect(),
            shared,
            mass_matrix: formulas,
            bias,
            applied_force,
        }
    }

    /// Kind of a variable.
    pub fn variable(&self, number: usize) -> Variable<'a> {
        let (nq, nu) = (self.joints.len(), self.robot.inputs.len());
        match number {
            k if k < nq => Variable::Position(self.joints[k]),
            k if k < 2 * nq => Variable::Velocity(self.joints[k - nq]),
            k if k < 3 * nq => Variable::Acceleration(self.joints[k - 2 * nq]),
            k if k < 3 * nq + nu => Variable::Input(&self.robot.inputs[k - 3 * nq].name),
            k => Variable::Param(&self.robot.params[k - 3 * nq - nu].name),
        }
    }

    /// Names of the coordinates' joints.
    pub fn joints(&self) -> &[&'a str] {
        &self.joints
    }

    /// Name of the robot.
    pub fn name(&self) -> &str {
        &self.robot.name
    }

    /// The equations as text; entries of M that are zero are left out.
    pub fn text(&self) -> String {
        text::equations(self)
    }

    /// The equations as LaTeX: an `align*` environment per part.
    pub fn latex(&self) -> String {
        latex::equations(self)
    }
}

/// Formulas as computed. An operation used more than once is named, unless it is as short as its name.
fn named(g: &Graph, outputs: &[Id]) -> (Vec<Formula>, Vec<Formula>) {
    let order = g.reachable(outputs);
    let mut uses: HashMap<Id, usize> = HashMap::new();
    for &id in &order {
        for operand in g.node(id).operands() {
            *uses.entry(operand).or_default() += 1;
        }
    }
    for &id in outputs {
        *uses.entry(id).or_default() += 1;
    }
    let mut shared = Vec::new();
    let mut formulas: HashMap<Id, Formula> = HashMap::new();
    for id in order {
        let of = |x: Id| formulas[&x].clone();
        let two = |x: Id, y: Id| (of(x), of(y));
        let formula = match g.node(id) {
            Node::Const(c) => number(c.value()),
            Node::Var(i) => Formula::Variable(i as usize),
            Node::Neg(x) => negative(of(x)),
            Node::Add(x, y) => {
                let (x, y) = two(x, y);
                sum(x, y)
            }
            Node::Sub(x, y) => {
                let (x, y) = two(x, y);
                sum(x, negative(y))
            }
            Node::Mul(x, y) if x == y => Formula::Power(Box::new(of(x)), 2),
            Node::Mul(x, y) => {
                let (x, y) = two(x, y);
                product(x, y)
            }
            Node::Div(x, y) => {
                let (x, y) = two(x, y);
                Formula::Quotient(Box::new(x), Box::new(y))
            }
            Node::Powi(x, n) => Formula::Power(Box::new(of(x)), n),
            Node::Call(f, x) => Formula::Call(f, Box::new(of(x))),
        };
        let short = match g.node(id) {
            Node::Neg(x) => g.node(x).is_leaf(),
            node => node.is_leaf(),
        };
        let formula = if uses[&id] > 1 && !short {
            shared.push(formula);
            Formula::Shared(shared.len())
        } else {
            formula
        };
        formulas.insert(id, formula);
    }
    let outputs = outputs.iter().map(|id| formulas[id].clone()).collect();
    (shared, outputs)
}

fn number(value: f64) -> Formula {
    if value < 0.0 {
        Formula::Negative(Box::new(Formula::Number(-value)))
    } else {
        Formula::Number(value)
    }
}

fn negative(x: Formula) -> Formula {
    match x {
        Formula::Negative(x) => *x,
        x => Formula::Negative(Box::new(x)),
    }
}

fn sum(x: Formula, y: Formula) -> Formula {
    let terms = |x| match x {
        Formula::Sum(terms) => terms,
        x => vec![x],
    };
    let mut all = terms(x);
    match y {
        Formula::Negative(y) => match *y {
            Formula::Sum(terms) => all.extend(terms.into_iter().map(negative)),
            y => all.push(negative(y)),
        },
        y => all.extend(terms(y)),
    }
    Formula::Sum(all)
}

fn product(x: Formula, y: Formula) -> Formula {
    let mut minus = false;
    let mut factors = Vec::new();
    for factor in [x, y] {
        let factor = match factor {
            Formula::Negative(x) => {
                minus = !minus;
                *x
            }
            x => x,
        };
        match factor {
            Formula::Product(more) => factors.extend(more),
            x => factors.push(x),
        }
    }
    let product = Formula::Product(factors);
    if minus { negative(product) } else { product }
}
