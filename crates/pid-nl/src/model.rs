//! The parts of a file after its head: bounds, start, and expressions on one graph.

use std::path::Path;

use pid_symbolic::{Graph, Id};

use crate::NlError;
use crate::expression;
use crate::head::{self, Head};
use crate::lines::Lines;

/// What a file says, as expressions of the variables 0 … n.
pub(crate) struct Model {
    pub(crate) head: Head,
    pub(crate) graph: Graph,
    /// The variables.
    pub(crate) x: Vec<Id>,
    /// The first objective; zero if there is none.
    pub(crate) objective: Id,
    /// Whether it is to be made large.
    pub(crate) maximise: bool,
    pub(crate) constraints: Vec<Id>,
    pub(crate) bounds: Vec<(f64, f64)>,
    pub(crate) rows: Vec<(f64, f64)>,
    pub(crate) start: Vec<f64>,
}

/// What of the file has been read: a file that is cut must not pass for another program.
#[derive(Default)]
struct Seen {
    constraints: usize,
    objectives: usize,
    ranges: bool,
    bounds: bool,
    terms: [usize; 2],
}

impl Seen {
    /// The first thing that the head announces and the file lacks.
    fn lacks(&self, head: &Head) -> Option<&'static str> {
        let complete = [
            (
                "the expressions of all constraints",
                self.constraints >= head.m,
            ),
            ("the objectives", self.objectives >= head.objectives),
            (
                "the bounds of the constraints (r)",
                self.ranges || head.m == 0,
            ),
            (
                "the bounds of the variables (b)",
                self.bounds || head.n == 0,
            ),
            (
                "the linear terms of all constraints (J)",
                self.terms[0] >= head.terms[0],
            ),
            (
                "the linear terms of the objectives (G)",
                self.terms[1] >= head.terms[1],
            ),
        ];
        complete
            .into_iter()
            .find(|(_, there)| !there)
            .map(|(what, _)| what)
    }
}

/// Reads a file's text.
pub(crate) fn read(file: &Path, text: &str) -> Result<Model, NlError> {
    let mut lines = Lines::new(file, text);
    let head = head::read(&mut lines, file)?;
    let (n, m) = (head.n, head.m);
    let mut graph = Graph::new();
    let zero = graph.zero();
    let x: Vec<Id> = (0..n).map(|i| graph.var(i)).collect();
    let mut values: Vec<Option<Id>> = x.iter().copied().map(Some).collect();
    values.resize(n + head.defined, None);
    let mut model = Model {
        graph,
        x,
        objective: zero,
        maximise: false,
        constraints: vec![zero; m],
        bounds: vec![(f64::NEG_INFINITY, f64::INFINITY); n],
        rows: vec![(f64::NEG_INFINITY, f64::INFINITY); m],
        start: vec![0.0; n],
        head,
    };
    let mut seen = Seen::default();
    while let Some(line) = lines.try_next() {
        model.part(&mut lines, &mut values, &mut seen, line)?;
    }
    match seen.lacks(&model.head) {
        Some(what) => Err(lines.end(what)),
        None => Ok(model),
    }
}

impl Model {
    /// Reads the part that a line begins.
    fn part(
        &mut self,
        lines: &mut Lines<'_>,
        values: &mut [Option<Id>],
        seen: &mut Seen,
        line: &str,
    ) -> Result<(), NlError> {
        let (kind, rest) = line.split_at(line.chars().next().map_or(0, char::len_utf8));
        let mut words = rest.split_whitespace();
        let mut word = || words.next().unwrap_or("");
        let (n, m) = (self.head.n, self.head.m);
        match kind {
            "V" => self.define(lines, values, line)?,
            "C" => {
                let row = lines.position("a constraint", word(), m)?;
                let value = expression::read(lines, &mut self.graph, values)?;
                self.constraints[row] = self.graph.add(self.constraints[row], value);
                seen.constraints += 1;
            }
            "O" => {
                let number = lines.position("an objective", word(), self.head.objectives)?;
                let maximise = word() == "1";
                seen.objectives += 1;
                let value = expression::read(lines, &mut self.graph, values)?;
                if number == 0 {
                    self.maximise = maximise;
                    self.objective = self.graph.add(self.objective, value);
                }
            }
            "J" => {
                let row = lines.position("a constraint", word(), m)?;
                for _ in 0..lines.count("the number of linear terms", word())? {
                    let term = self.term(lines, values)?;
                    self.constraints[row] = self.graph.add(self.constraints[row], term);
                    seen.terms[0] += 1;
                }
            }
            "G" => {
                let number = lines.position("an objective", word(), self.head.objectives)?;
                for _ in 0..lines.count("the number of linear terms", word())? {
                    let term = self.term(lines, values)?;
                    seen.terms[1] += 1;
                    if number == 0 {
                        self.objective = self.graph.add(self.objective, term);
                    }
                }
            }
            "x" => {
                for _ in 0..lines.count("the number of start values", word())? {
                    let (position, value) = lines.pair("a start value", n)?;
                    self.start[position] = value;
                }
            }
            "r" => {
                seen.ranges = true;
                for row in 0..m {
                    self.rows[row] = range(lines, "bounds of a constraint")?;
                }
            }
            "b" => {
                seen.bounds = true;
                for variable in 0..n {
                    self.bounds[variable] = range(lines, "bounds of a variable")?;
                }
            }
            // Multipliers to start from, lengths of columns, suffixes: nothing that the program needs.
            "d" | "k" | "K" => skip(lines, word())?,
            "S" => {
                word();
                skip(lines, rest.split_whitespace().nth(1).unwrap_or(""))?;
            }
            "F" => {
                return Err(lines.not_smooth("an imported function", "write it out in the model"));
            }
            "L" => {
                return Err(lines.not_smooth("a logical constraint", "write the model without it"));
            }
            _ => {
                let mend = "parts begin with one of the letters V C O J G x r b d k S";
                return Err(lines.refuse("the beginning of a part", line, mend));
            }
        }
        Ok(())
    }

    /// A defined variable: linear terms and an expression.
    fn define(
        &mut self,
        lines: &mut Lines<'_>,
        values: &mut [Option<Id>],
        line: &str,
    ) -> Result<(), NlError> {
        let mut words = line[1..].split_whitespace();
        let mut word = || words.next().unwrap_or("");
        let defined = lines.position("a defined variable", word(), values.len())?;
        if defined < self.head.n {
            let mend = "number it after the variables";
            return Err(lines.refuse("a defined variable", line, mend));
        }
        let mut terms = Vec::new();
        for _ in 0..lines.count("the number of linear terms", word())? {
            terms.push(self.term(lines, values)?);
        }
        terms.push(expression::read(lines, &mut self.graph, values)?);
        values[defined] = Some(self.graph.sum(terms));
        Ok(())
    }

    /// A linear term: a variable's position and its factor.
    fn term(&mut self, lines: &mut Lines<'_>, values: &[Option<Id>]) -> Result<Id, NlError> {
        let (position, factor) = lines.pair("a linear term", values.len())?;
        let Some(variable) = values[position] else {
            return Err(lines.refuse(
                "a linear term",
                &position.to_string(),
                "define it before it is used",
            ));
        };
        let factor = self.graph.constant(factor);
        Ok(self.graph.mul(factor, variable))
    }
}

fn skip(lines: &mut Lines<'_>, count: &str) -> Result<(), NlError> {
    for _ in 0..lines.count("the number of lines", count)? {
        lines.next("a part")?;
    }
    Ok(())
}

/// A line of bounds: its kind and as many numbers as that has.
fn range(lines: &mut Lines<'_>, item: &str) -> Result<(f64, f64), NlError> {
    let line = lines.next(item)?;
    let words: Vec<&str> = line.split_whitespace().collect();
    let number = |text: &&str| lines.number(item, text);
    let (least, most) = match words[..] {
        ["0", ref lower, ref upper, ..] => (number(lower)?, number(upper)?),
        ["1", ref upper, ..] => (f64::NEG_INFINITY, number(upper)?),
        ["2", ref lower, ..] => (number(lower)?, f64::INFINITY),
        ["3", ..] => (f64::NEG_INFINITY, f64::INFINITY),
        ["4", ref value, ..] => (number(value)?, number(value)?),
        ["5", ..] => {
            return Err(lines.not_smooth(
                "a complementarity",
                "write it as inequalities and a product",
            ));
        }
        _ => {
            let mend = "write `0 LOWER UPPER`, `1 UPPER`, `2 LOWER`, `3` or `4 VALUE`";
            return Err(lines.refuse(item, line, mend));
        }
    };
    if least > most {
        return Err(lines.refuse(item, line, "write the lower bound first"));
    }
    Ok((least, most))
}
