//! A file as a program for the solvers.

use std::path::Path;

use pid_nlp::{Nlp, SparsePattern};
use pid_symbolic::program::Scratch;
use pid_symbolic::{Graph, Id, Program, diff};

use crate::NlError;
use crate::model::{self, Model};

/// Rows of the Jacobian that are derived at once: what a dense row of each takes stays small.
const ROWS: usize = 64;

/// A nonlinear program from a `.nl` file, with exact sparse derivatives.
///
/// What is to be made large in the file is negated: the solvers minimise.
#[derive(Debug)]
pub struct Problem {
    bounds: Vec<(f64, f64)>,
    rows: Vec<(f64, f64)>,
    start: Vec<f64>,
    maximise: bool,
    options: Vec<String>,
    jacobian_pattern: SparsePattern,
    hessian_pattern: SparsePattern,
    objective: Program,
    gradient: Program,
    constraints: Program,
    jacobian: Program,
    hessian: Program,
    scratch: Scratch<f64>,
}

impl Problem {
    /// Reads a file.
    ///
    /// # Errors
    /// A file that cannot be read, is no `.nl` file in text form, or holds whole variables, logic, complementarities
    /// or imported functions; with its place.
    pub fn read(file: impl AsRef<Path>) -> Result<Self, NlError> {
        let file = file.as_ref();
        let bytes = std::fs::read(file).map_err(|error| NlError::Unreadable {
            file: file.to_owned(),
            error,
        })?;
        // Files in binary form are no text; the head says so.
        Self::parse(file, &String::from_utf8_lossy(&bytes))
    }

    /// Reads a file's text; `file` stands in messages.
    ///
    /// # Errors
    /// As [`Problem::read`].
    pub fn parse(file: impl AsRef<Path>, text: &str) -> Result<Self, NlError> {
        Ok(Self::of(model::read(file.as_ref(), text)?))
    }

    fn of(model: Model) -> Self {
        let Model {
            head,
            mut graph,
            x,
            mut objective,
            maximise,
            constraints,
            bounds,
            rows,
            start,
        } = model;
        let g = &mut graph;
        if maximise {
            objective = g.neg(objective);
        }
        let gradient = diff::gradient(g, objective, &x);
        let (jacobian_pattern, jacobian) = jacobian(g, &constraints, &x);
        let (hessian_pattern, hessian) = hessian(g, objective, &constraints, &x);
        Self {
            bounds,
            rows,
            start,
            maximise,
            options: head.options,
            objective: Program::new(g, &[objective]),
            gradient: Program::new(g, &gradient),
            constraints: Program::new(g, &constraints),
            jacobian: Program::new(g, &jacobian),
            hessian: Program::new(g, &hessian),
            jacobian_pattern,
            hessian_pattern,
            scratch: Scratch::new(),
        }
    }

    /// The start that the file states, 0 where it states none; length n.
    pub fn start(&self) -> &[f64] {
        &self.start
    }

    /// Whether the file's objective is to be made large: [`Nlp::objective`] is then its negative.
    pub fn maximises(&self) -> bool {
        self.maximise
    }

    /// The options in the head of the file, which an answer to AMPL repeats.
    pub(crate) fn options(&self) -> &[String] {
        &self.options
    }
}

/// Structure and values of ∂c/∂x, by rows.
fn jacobian(g: &mut Graph, constraints: &[Id], x: &[Id]) -> (SparsePattern, Vec<Id>) {
    let (mut pattern, mut values) = (SparsePattern::default(), Vec::new());
    for (first, part) in (0..).step_by(ROWS).zip(constraints.chunks(ROWS)) {
        for (row, of_row) in diff::jacobian(g, part, x).into_iter().enumerate() {
            for (col, value) in of_row.into_iter().enumerate() {
                if !g.is_zero(value) {
                    pattern.push(first + row, col);
                    values.push(value);
                }
            }
        }
    }
    (pattern, values)
}

/// Structure and values of the lower triangle of ∇²(σ f + λᵀ c); σ and λ are the variables n, n + 1, ….
fn hessian(g: &mut Graph, objective: Id, constraints: &[Id], x: &[Id]) -> (SparsePattern, Vec<Id>) {
    let sigma = g.var(x.len());
    let mut lagrangian = g.mul(sigma, objective);
    for (i, &c) in constraints.iter().enumerate() {
        let lambda = g.var(x.len() + 1 + i);
        let product = g.mul(lambda, c);
        lagrangian = g.add(lagrangian, product);
    }
    let (mut pattern, mut values) = (SparsePattern::default(), Vec::new());
    for entry in diff::hessian(g, lagrangian, x) {
        pattern.push(entry.row, entry.col);
        values.push(entry.value);
    }
    (pattern, values)
}

/// Writes the numbers that a program reads.
fn fill(places: &mut [f64], parts: [&[f64]; 3]) {
    for (place, value) in places.iter_mut().zip(parts.into_iter().flatten()) {
        *place = *value;
    }
}

impl Nlp for Problem {
    fn n(&self) -> usize {
        self.bounds.len()
    }

    fn m(&self) -> usize {
        self.rows.len()
    }

    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        for (j, &(least, most)) in self.bounds.iter().enumerate() {
            (lower[j], upper[j]) = (least, most);
        }
    }

    fn constraint_bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        for (i, &(least, most)) in self.rows.iter().enumerate() {
            (lower[i], upper[i]) = (least, most);
        }
    }

    fn objective(&mut self, x: &[f64]) -> f64 {
        let mut value = [0.0];
        self.objective
            .eval(&mut self.scratch, |v| fill(v, [x, &[], &[]]), [&mut value]);
        value[0]
    }

    fn gradient(&mut self, x: &[f64], gradient: &mut [f64]) {
        self.gradient
            .eval(&mut self.scratch, |v| fill(v, [x, &[], &[]]), [gradient]);
    }

    fn constraints(&mut self, x: &[f64], c: &mut [f64]) {
        self.constraints
            .eval(&mut self.scratch, |v| fill(v, [x, &[], &[]]), [c]);
    }

    fn jacobian_pattern(&self) -> &SparsePattern {
        &self.jacobian_pattern
    }

    fn jacobian(&mut self, x: &[f64], values: &mut [f64]) {
        self.jacobian
            .eval(&mut self.scratch, |v| fill(v, [x, &[], &[]]), [values]);
    }

    fn hessian_pattern(&self) -> &SparsePattern {
        &self.hessian_pattern
    }

    fn hessian(&mut self, x: &[f64], sigma: f64, lambda: &[f64], values: &mut [f64]) {
        self.hessian.eval(
            &mut self.scratch,
            |v| fill(v, [x, &[sigma], lambda]),
            [values],
        );
    }
}
