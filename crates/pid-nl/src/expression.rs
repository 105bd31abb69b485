//! Expressions in prefix form, one operation, variable or number a line.
//!
//! The codes are those of D. M. Gay, *Writing .nl Files*, Sandia National Laboratories, 2005. Reading does not recurse:
//! a file may nest as deep as it is long.

use pid_symbolic::{Function, Graph, Id};

use crate::NlError;
use crate::lines::Lines;

/// An operation that waits for operands.
struct Waiting {
    code: u32,
    operands: usize,
    found: Vec<Id>,
}

/// Reads one expression; `values[i]` is variable or defined variable `i`.
pub(crate) fn read(
    lines: &mut Lines<'_>,
    g: &mut Graph,
    values: &[Option<Id>],
) -> Result<Id, NlError> {
    let mut waiting: Vec<Waiting> = Vec::new();
    loop {
        let line = lines.next("an expression")?;
        let (kind, rest) = line.split_at(line.chars().next().map_or(0, char::len_utf8));
        let mut value = match kind {
            "o" => {
                let code = lines.whole("the code of an operation", rest)?;
                let operands = operands(lines, code)?;
                let found = Vec::with_capacity(operands.min(8));
                if operands > 0 {
                    waiting.push(Waiting {
                        code,
                        operands,
                        found,
                    });
                    continue;
                }
                apply(lines, g, code, &[])?
            }
            "v" => {
                let position = lines.position("a variable", rest, values.len())?;
                let mend = "define it before it is used";
                values[position].ok_or_else(|| lines.refuse("a variable", line, mend))?
            }
            "n" | "s" | "l" => {
                let number = lines.number("a number", rest)?;
                g.constant(number)
            }
            "f" => {
                return Err(lines.not_smooth("an imported function", "write it out in the model"));
            }
            "h" => return Err(lines.not_smooth("a text", "leave it out of the model")),
            _ => {
                let mend = "write an operation (o), a variable (v) or a number (n)";
                return Err(lines.refuse("a line of an expression", line, mend));
            }
        };
        loop {
            let Some(last) = waiting.last_mut() else {
                return Ok(value);
            };
            last.found.push(value);
            if last.found.len() < last.operands {
                break;
            }
            let Some(done) = waiting.pop() else {
                return Ok(value);
            };
            value = apply(lines, g, done.code, &done.found)?;
        }
    }
}

/// How many operands an operation has; of lists, the next line says so.
fn operands(lines: &mut Lines<'_>, code: u32) -> Result<usize, NlError> {
    Ok(match code {
        0..=3 | 5 | 6 | 48 => 2,
        15 | 16 | 37..=47 | 49..=53 => 1,
        11 | 12 | 54 => {
            let count = lines.next("the number of operands")?;
            lines.count("the number of operands", count)?
        }
        _ => {
            let name = match code {
                4 => "the remainder (o4)",
                13 => "`floor` (o13)",
                14 => "`ceil` (o14)",
                20..=34 => "a comparison (o20 to o34)",
                35 => "`if` (o35)",
                55 => "whole division (o55)",
                56..=58 => "rounding (o56 to o58)",
                59..=63 | 66..=74 => "a logical or counting operation (o59 to o74)",
                64 => "a piecewise-linear term (o64)",
                65 => "`if` on texts (o65)",
                _ => "an unknown operation",
            };
            return Err(lines.not_smooth(
                &format!("{name}, code {code}"),
                "write the model without it",
            ));
        }
    })
}

/// An operation on its operands.
fn apply(lines: &Lines<'_>, g: &mut Graph, code: u32, x: &[Id]) -> Result<Id, NlError> {
    Ok(match (code, x) {
        (0, &[a, b]) => g.add(a, b),
        (1, &[a, b]) => g.sub(a, b),
        (2, &[a, b]) => g.mul(a, b),
        (3, &[a, b]) => g.div(a, b),
        (5, &[a, b]) => power(g, a, b),
        // `less`: the part of a − b above zero.
        (6, &[a, b]) => {
            let (difference, zero) = (g.sub(a, b), g.zero());
            extreme(g, difference, zero, 1.0)
        }
        (11, &[first, ref rest @ ..]) => rest.iter().fold(first, |a, &b| extreme(g, a, b, -1.0)),
        (12, &[first, ref rest @ ..]) => rest.iter().fold(first, |a, &b| extreme(g, a, b, 1.0)),
        (15, &[a]) => g.call(Function::Abs, a),
        (16, &[a]) => g.neg(a),
        (37, &[a]) => g.call(Function::Tanh, a),
        (38, &[a]) => g.call(Function::Tan, a),
        (39, &[a]) => g.call(Function::Sqrt, a),
        (40, &[a]) => exponentials(g, a, -1.0),
        (41, &[a]) => g.sin(a),
        (42, &[a]) => {
            let (log, scale) = (g.call(Function::Ln, a), g.constant(std::f64::consts::LN_10));
            g.div(log, scale)
        }
        (43, &[a]) => g.call(Function::Ln, a),
        (44, &[a]) => g.call(Function::Exp, a),
        (45, &[a]) => exponentials(g, a, 1.0),
        (46, &[a]) => g.cos(a),
        (47, &[a]) => {
            let one = g.one();
            let (above, below) = (g.add(one, a), g.sub(one, a));
            let ratio = g.div(above, below);
            let (log, half) = (g.call(Function::Ln, ratio), g.constant(0.5));
            g.mul(half, log)
        }
        (48, &[y, x]) => angle(g, y, x),
        (49, &[a]) => g.call(Function::Atan, a),
        (50, &[a]) => inverse_hyperbolic(g, a, 1.0),
        (51, &[a]) => arc_sine(g, a),
        (52, &[a]) => inverse_hyperbolic(g, a, -1.0),
        (53, &[a]) => {
            let (arc, right) = (arc_sine(g, a), g.constant(std::f64::consts::FRAC_PI_2));
            g.sub(right, arc)
        }
        (54, terms) => g.sum(terms.iter().copied()),
        _ => {
            let mend = "give it one operand at least";
            return Err(lines.refuse("an operation", &format!("o{code}"), mend));
        }
    })
}

/// xʸ: by multiplication where y is a number that is whole or half of one, by the exponential of y ln x elsewhere.
fn power(g: &mut Graph, x: Id, y: Id) -> Id {
    if let Some(exponent) = g.value(y) {
        let whole = exponent.floor();
        if whole.abs() <= 1000.0 && exponent == whole {
            return g.powi(x, whole as i32);
        }
        if whole.abs() <= 1000.0 && exponent == whole + 0.5 {
            let (power, root) = (g.powi(x, whole as i32), g.call(Function::Sqrt, x));
            return g.mul(power, root);
        }
    }
    let log = g.call(Function::Ln, x);
    let product = g.mul(y, log);
    g.call(Function::Exp, product)
}

/// The larger of two values with `sign` 1, the smaller one with −1.
fn extreme(g: &mut Graph, a: Id, b: Id, sign: f64) -> Id {
    let (sum, difference) = (g.add(a, b), g.sub(a, b));
    let (distance, half, sign) = (
        g.call(Function::Abs, difference),
        g.constant(0.5),
        g.constant(sign),
    );
    let signed = g.mul(sign, distance);
    let twice = g.add(sum, signed);
    g.mul(half, twice)
}

/// (eˣ + `sign` e⁻ˣ) / 2.
fn exponentials(g: &mut Graph, x: Id, sign: f64) -> Id {
    let minus = g.neg(x);
    let (up, down) = (g.call(Function::Exp, x), g.call(Function::Exp, minus));
    let (half, sign) = (g.constant(0.5), g.constant(sign));
    let signed = g.mul(sign, down);
    let sum = g.add(up, signed);
    g.mul(half, sum)
}

/// ln(x + √(x² + `sign`)): the inverse of `sinh` with 1, that of `cosh` with −1.
fn inverse_hyperbolic(g: &mut Graph, x: Id, sign: f64) -> Id {
    let (square, sign) = (g.mul(x, x), g.constant(sign));
    let under = g.add(square, sign);
    let root = g.call(Function::Sqrt, under);
    let sum = g.add(x, root);
    g.call(Function::Ln, sum)
}

/// The angle whose sine is x, `atan(x / √(1 − x²))`.
fn arc_sine(g: &mut Graph, x: Id) -> Id {
    let (one, square) = (g.one(), g.mul(x, x));
    let under = g.sub(one, square);
    let root = g.call(Function::Sqrt, under);
    let ratio = g.div(x, root);
    g.call(Function::Atan, ratio)
}

/// The angle of the point (x, y), `2 atan(y / (√(x² + y²) + x))`; not on the negative x axis.
fn angle(g: &mut Graph, y: Id, x: Id) -> Id {
    let (xx, yy) = (g.mul(x, x), g.mul(y, y));
    let square = g.add(xx, yy);
    let radius = g.call(Function::Sqrt, square);
    let sum = g.add(radius, x);
    let ratio = g.div(y, sum);
    let (half, two) = (g.call(Function::Atan, ratio), g.constant(2.0));
    g.mul(two, half)
}
