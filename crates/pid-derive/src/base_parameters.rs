//! Base parameters: the smallest set of combinations on which the equations depend.
//!
//! The columns of the regressor Y are linearly dependent as functions of the motion: `Y_D = Y_I C`
//! with the independent columns I. Then `Y p = Y_I (p_I + C p_D)`, and `β = p_I + C p_D` are the
//! base parameters (W. Khalil, F. Bennis, 1995); C is found on random motions by an orthogonal
//! factorization (M. Gautier, 1991).
//!
//! Columns are taken in an order that gives the customary grouping: links from the base outwards
//! (of each the inertia, the first moment and the mass), then rotors, friction and drives. A column
//! joins the set if it is independent of those before it, so parameters are regrouped towards the
//! base.
//!
//! Entries of C are polynomials of the geometry. Those that agree with a simple expression of the
//! declared lengths (a sum of up to three, its square, its product with a length) are written as
//! such.

use pid_symbolic::random::Random;
use pid_symbolic::{Graph, Tape};

use crate::dense::{self, Matrix};
use crate::equations::Equations;
use crate::model::{Expr, Inertial, Robot};
use crate::regressor::Regressor;
use crate::sample;

/// A column is dependent if less than this share of its length is left.
const TOLERANCE: f64 = 1e-8;
/// Rows per column.
const OVERSAMPLING: usize = 3;
/// Coefficients that contribute less than this share of their column are zero.
const ZERO: f64 = 1e-9;
/// Agreement of a coefficient with a number of the declaration.
const MATCH: f64 = 1e-9;

/// A coefficient times a parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Term {
    /// Column of the regressor.
    pub column: usize,
    /// Its coefficient.
    pub coefficient: f64,
    /// The coefficient as written: `0.612^2`; empty for 1.
    pub text: String,
}

/// Base parameters of a regressor.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct BaseParameters {
    /// Columns of the regressor that are independent, ascending within the two kinds of columns.
    pub independent: Vec<usize>,
    /// How many of them are constant columns.
    pub constant: usize,
    /// Terms of each base parameter; the first is its own column with coefficient 1.
    pub terms: Vec<Vec<Term>>,
    /// Columns without effect.
    pub idle: Vec<usize>,
    /// Smallest share of a kept column, and largest share of a dropped one, that the columns before
    /// it do not span.
    pub gap: (f64, f64),
}

impl BaseParameters {
    /// The formula of base parameter `k`: `l1_izz + rotor_j1 + 0.612^2*l3_m`.
    pub fn formula(&self, k: usize, name: impl Fn(usize) -> String) -> String {
        let mut text = String::new();
        for (position, term) in self.terms[k].iter().enumerate() {
            let sign = match (position, term.coefficient < 0.0) {
                (0, false) => "",
                (0, true) => "-",
                (_, false) => " + ",
                (_, true) => " - ",
            };
            text += sign;
            if !term.text.is_empty() {
                text += &term.text;
                text += "*";
            }
            text += &name(term.column);
        }
        text
    }
}

/// Base parameters of the columns of a regressor.
pub fn base_parameters(
    g: &mut Graph,
    robot: &Robot,
    equations: &Equations,
    regressor: &Regressor,
) -> BaseParameters {
    let columns = order(robot, regressor);
    let y = samples(g, robot, equations, regressor).select(&columns);
    let selection = dense::select(&y, TOLERANCE);
    let length: Vec<f64> = (0..columns.len()).map(|k| dense::norm(y.col(k))).collect();
    let lengths = Lengths::new(g, robot, equations);

    let mut terms: Vec<Vec<Term>> = selection
        .independent
        .iter()
        .map(|&k| {
            vec![Term {
                column: columns[k],
                coefficient: 1.0,
                text: String::new(),
            }]
        })
        .collect();
    let mut idle = Vec::new();
    for (k, coefficients) in &selection.dependent {
        if length[*k] == 0.0 {
            idle.push(columns[*k]);
            continue;
        }
        for (position, &coefficient) in coefficients.iter().enumerate() {
            let of = selection.independent[position];
            if coefficient.abs() * length[of] > ZERO * length[*k] {
                let (coefficient, text) = lengths.write(coefficient);
                terms[position].push(Term {
                    column: columns[*k],
                    coefficient,
                    text,
                });
            }
        }
    }
    idle.sort_unstable();
    let mut sorted: Vec<(usize, Vec<Term>)> = selection
        .independent
        .iter()
        .map(|&k| columns[k])
        .zip(terms)
        .collect();
    // Columns are numbered with the constant ones first.
    sorted.sort_by_key(|(column, _)| *column);
    let independent: Vec<usize> = sorted.iter().map(|(column, _)| *column).collect();
    BaseParameters {
        constant: independent
            .iter()
            .filter(|&&column| column < regressor.constant)
            .count(),
        independent,
        terms: sorted.into_iter().map(|(_, terms)| terms).collect(),
        idle,
        gap: selection.gap,
    }
}

/// The columns in the order in which they join the set: constant columns first, of them links outwards.
fn order(robot: &Robot, regressor: &Regressor) -> Vec<usize> {
    let rank = |param: usize| -> (usize, usize) {
        let own = |e: &Expr| *e == Expr::Param(param);
        for (depth, &joint) in robot.order.iter().enumerate() {
            let Inertial::Linear {
                mass,
                first_moment,
                inertia: i,
            } = &robot.links[robot.joints[joint].child].inertial
            else {
                continue;
            };
            let entries = [&i.xx, &i.yy, &i.zz, &i.xy, &i.xz, &i.yz]
                .into_iter()
                .chain(first_moment)
                .chain([mass]);
            if let Some(entry) = entries.into_iter().position(own) {
                return (depth, entry);
            }
        }
        (robot.order.len(), 0)
    };
    let mut columns: Vec<usize> = (0..regressor.params.len()).collect();
    columns.sort_by_key(|&column| {
        (
            column >= regressor.constant,
            rank(regressor.params[column]),
            column,
        )
    });
    columns
}

/// Y on random motions, every equation scaled by its largest effect.
fn samples(g: &Graph, robot: &Robot, equations: &Equations, regressor: &Regressor) -> Matrix {
    let (nq, n) = (equations.residual.len(), regressor.params.len());
    let values: Vec<_> = regressor.entries.iter().map(|entry| entry.value).collect();
    let tape = Tape::new(g, &values);
    let motions = (OVERSAMPLING * n).div_ceil(nq.max(1)) + 4;
    let mut random = Random::new(0xba5e);
    let mut out = vec![0.0; values.len()];
    let mut work = Vec::new();
    let mut y = Matrix::zeros(motions * nq, n);
    for motion in 0..motions {
        let z = sample::point(robot, &mut random);
        tape.eval_with(&z, &mut out, &mut work);
        if !out.iter().all(|x| x.is_finite()) {
            continue;
        }
        let mut largest = vec![0.0_f64; nq];
        for (entry, x) in regressor.entries.iter().zip(&out) {
            largest[entry.row] = largest[entry.row].max(x.abs());
        }
        for (entry, x) in regressor.entries.iter().zip(&out) {
            if largest[entry.row] > 0.0 {
                y[(motion * nq + entry.row, entry.col)] = x / largest[entry.row];
            }
        }
    }
    y
}

/// Positive sums and differences of one, two and three lengths, with their texts; single lengths
/// without brackets.
fn sums(lengths: &[f64]) -> Vec<(f64, String)> {
    let mut sums: Vec<(f64, String)> = lengths.iter().map(|&x| (x, x.to_string())).collect();
    let mut push = |terms: &[f64]| {
        let value: f64 = terms.iter().sum();
        // A sum that cancels has no digits left.
        if value <= 1e-6 * terms.iter().map(|x| x.abs()).sum::<f64>() {
            return;
        }
        let mut text = String::from("(");
        // A positive term stands first.
        let (plus, minus): (Vec<f64>, Vec<f64>) = terms.iter().partition(|&&x| x > 0.0);
        for (k, x) in plus.iter().enumerate() {
            text += if k > 0 { " + " } else { "" };
            text += &x.to_string();
        }
        for x in minus {
            text += &format!(" - {}", -x);
        }
        sums.push((value, text + ")"));
    };
    let n = lengths.len();
    for i in 0..n {
        for j in i + 1..n {
            let (x, y) = (lengths[i], lengths[j]);
            for [a, b] in [[x, y], [x, -y], [-x, y]] {
                push(&[a, b]);
            }
        }
    }
    for i in 0..n {
        for j in i + 1..n {
            for k in j + 1..n {
                for signs in 0..8 {
                    let signed = |bit: u32, x: f64| if signs >> bit & 1 == 1 { -x } else { x };
                    push(&[
                        signed(0, lengths[i]),
                        signed(1, lengths[j]),
                        signed(2, lengths[k]),
                    ]);
                }
            }
        }
    }
    sums
}

/// Lengths of the geometry that are combined; further ones are left as numbers.
const MANY: usize = 16;

/// Numbers of the geometry, and the expressions that they make.
struct Lengths {
    /// Value and text, the simplest first.
    known: Vec<(f64, String)>,
}

impl Lengths {
    fn new(g: &mut Graph, robot: &Robot, equations: &Equations) -> Self {
        let mut lengths: Vec<f64> = Vec::new();
        for joint in &robot.joints {
            for entry in &joint.origin {
                let id = equations.symbols.expression(g, entry);
                if let Some(x) = g.value(id).map(f64::abs)
                    && x != 0.0
                    && x != 1.0
                    && !lengths.contains(&x)
                {
                    lengths.push(x);
                }
            }
        }
        lengths.truncate(MANY);
        let mut known: Vec<(f64, String)> = [2.0, 0.5, 3.0, 4.0]
            .map(|x: f64| (x, x.to_string()))
            .to_vec();
        for sum in sums(&lengths) {
            let (value, text) = &sum;
            known.push((*value, text.clone()));
            known.push((2.0 * value, format!("2*{text}")));
            known.push((value * value, format!("{text}^2")));
            for &x in &lengths {
                known.push((value * x, format!("{x}*{text}")));
                known.push((2.0 * value * x, format!("2*{x}*{text}")));
            }
        }
        for (k, &x) in lengths.iter().enumerate() {
            for &y in &lengths[k + 1..] {
                known.push((x * x + y * y, format!("({x}^2 + {y}^2)")));
            }
        }
        Self { known }
    }

    /// The coefficient as a number of the geometry, if it is one, and its text without sign; empty for ±1.
    fn write(&self, coefficient: f64) -> (f64, String) {
        let size = coefficient.abs();
        let is = |x: f64| (size - x).abs() <= MATCH * x;
        if is(1.0) {
            return (1.0_f64.copysign(coefficient), String::new());
        }
        match self.known.iter().find(|(x, _)| is(*x)) {
            Some((x, text)) => (x.copysign(coefficient), text.clone()),
            None => {
                // The factorization is good for twelve digits.
                let text = format!("{size:.11e}");
                let rounded: f64 = text.parse().unwrap_or(size);
                (rounded.copysign(coefficient), rounded.to_string())
            }
        }
    }
}
