//! The Hock-Schittkowski collection of test problems, written from the formulas published in W.
//! Hock, K. Schittkowski, *Test Examples for Nonlinear Programming Codes*, Lecture Notes in
//! Economics and Mathematical Systems 187, Springer, 1981.
//!
//! Every problem is written once, generic over dual numbers; gradients, Jacobians and Hessians are
//! exact derivatives of that one formula. Starts and optima are the published ones. Where the
//! book's optimum is known to be off, [`Info::optimum`] keeps the book's number and
//! [`Info::refined`] the value the problem has.

pub mod command;
mod p001_030;
mod p031_058;
mod p059_081;
mod p083_107;
mod p108_119;
pub mod study;
mod tables;

use pid_nlp::Nlp;
use pid_nlp::formula::{Exact, Number};
use std::marker::PhantomData;

/// A constraint's value with its lower and upper bound.
pub type Row<D> = (D, f64, f64);

/// A formula of the collection.
pub trait Formula: 'static {
    /// Number, start, bounds, published optimum.
    fn info() -> Info;
    /// Objective and constraints at `x`.
    fn evaluate<D: Number>(x: &[D]) -> (D, Vec<Row<D>>);
}

/// What the book says about a problem.
#[derive(Debug, Clone, PartialEq)]
pub struct Info {
    /// Number in the book.
    pub number: u32,
    /// Published start, feasible or not.
    pub start: Vec<f64>,
    /// Bounds on the variables.
    pub bounds: Vec<(f64, f64)>,
    /// Objective the book prints for the optimum.
    pub optimum: f64,
    /// Objective of the optimum where the book's number is imprecise; its source stands with the problem.
    pub refined: Option<f64>,
}

impl Info {
    /// The objective to compare with.
    pub fn reference(&self) -> f64 {
        self.refined.unwrap_or(self.optimum)
    }
}

/// A problem of the collection as [`Exact`] takes it.
struct Problem<F> {
    info: Info,
    rows: Vec<(f64, f64)>,
    formula: PhantomData<F>,
}

impl<F: Formula> Problem<F> {
    fn new() -> Self {
        let info = F::info();
        let (_, rows) = F::evaluate::<f64>(&info.start);
        let rows = rows.into_iter().map(|(_, l, u)| (l, u)).collect();
        Self {
            info,
            rows,
            formula: PhantomData,
        }
    }
}

impl<F: Formula> pid_nlp::formula::Formula for Problem<F> {
    fn variables(&self) -> Vec<(f64, f64)> {
        self.info.bounds.clone()
    }

    fn rows(&self) -> Vec<(f64, f64)> {
        self.rows.clone()
    }

    fn evaluate<D: Number>(&self, x: &[D], c: &mut [D]) -> D {
        let (objective, rows) = F::evaluate(x);
        for (c, (value, _, _)) in c.iter_mut().zip(rows) {
            *c = value;
        }
        objective
    }
}

/// A problem and what the book says about it.
pub struct Case {
    /// What the book says.
    pub info: Info,
    /// The problem.
    pub problem: Box<dyn Nlp>,
}

impl Case {
    fn of<F: Formula>() -> Self {
        Self {
            info: F::info(),
            problem: Box::new(Exact::new(Problem::<F>::new())),
        }
    }
}

/// All problems, by number.
pub fn all() -> Vec<Case> {
    let mut cases = p001_030::cases();
    cases.extend(p031_058::cases());
    cases.extend(p059_081::cases());
    cases.extend(p083_107::cases());
    cases.extend(p108_119::cases());
    cases.sort_by_key(|case| case.info.number);
    cases
}

const INF: f64 = f64::INFINITY;

/// `g ≥ 0`.
fn ge<D: Number>(g: D) -> Row<D> {
    (g, 0.0, INF)
}

/// `h = 0`.
fn eq<D: Number>(h: D) -> Row<D> {
    (h, 0.0, 0.0)
}

/// `lower ≤ g ≤ upper`.
fn within<D: Number>(lower: f64, g: D, upper: f64) -> Row<D> {
    (g, lower, upper)
}

/// A constant.
fn k<D: Number>(value: f64) -> D {
    D::from(value)
}

/// The same bounds for `n` variables.
fn each(n: usize, lower: f64, upper: f64) -> Vec<(f64, f64)> {
    vec![(lower, upper); n]
}

/// No bounds.
fn free(n: usize) -> Vec<(f64, f64)> {
    each(n, -INF, INF)
}

/// Variables that are not negative.
fn positive(n: usize) -> Vec<(f64, f64)> {
    each(n, 0.0, INF)
}

/// Σ over slices of formulas.
fn sum<D: Number>(terms: impl IntoIterator<Item = D>) -> D {
    terms.into_iter().fold(D::zero(), |a, b| a + b)
}

/// Declares problems: name, number, start, bounds, optimum, formula; and the function `cases` that
/// lists them.
macro_rules! problems {
    ($($(#[$doc:meta])* $name:ident $number:literal
        from $start:expr, in $bounds:expr, to $optimum:expr $(, refined $refined:expr)?;
        ($($x:tt)*) => $body:expr;
    )*) => {
        $(
            $(#[$doc])*
            struct $name;
            impl Formula for $name {
                fn info() -> Info {
                    #[allow(unused_mut, unused_assignments)]
                    let mut refined = None;
                    $(refined = Some($refined);)?
                    Info {
                        number: $number,
                        start: $start.to_vec(),
                        bounds: $bounds.to_vec(),
                        optimum: $optimum,
                        refined,
                    }
                }
                fn evaluate<D: Number>(x: &[D]) -> (D, Vec<Row<D>>) {
                    problems!(@bind x $($x)*);
                    $body
                }
            }
        )*
        pub(super) fn cases() -> Vec<Case> {
            vec![$(Case::of::<$name>()),*]
        }
    };
    (@bind $x:ident slice $name:ident) => { let $name = $x; };
    (@bind $x:ident $($name:ident)*) => {
        let &[$($name),*] = $x else { unreachable!("the start has the length of the pattern") };
    };
}
use problems;
