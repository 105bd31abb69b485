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

use num_dual::{Dual64, DualNum, HyperDual64};
use pid_nlp::{Nlp, SparsePattern};
use std::marker::PhantomData;

/// Numbers the formulas are written in.
pub trait Number: DualNum<Primitive = f64> + Copy {}
impl<T: DualNum<Primitive = f64> + Copy> Number for T {}

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

/// A problem of the collection with exact derivatives by dual numbers.
pub struct Problem<F> {
    bounds: Vec<(f64, f64)>,
    rows: Vec<(f64, f64)>,
    jacobian: SparsePattern,
    hessian: SparsePattern,
    formula: PhantomData<F>,
}

impl<F: Formula> Problem<F> {
    fn new() -> Self {
        let info = F::info();
        let n = info.start.len();
        let (_, rows) = F::evaluate::<f64>(&info.start);
        let (mut jacobian, mut hessian) = (SparsePattern::default(), SparsePattern::default());
        (0..rows.len()).for_each(|i| (0..n).for_each(|j| jacobian.push(i, j)));
        (0..n).for_each(|i| (0..=i).for_each(|j| hessian.push(i, j)));
        Self {
            bounds: info.bounds,
            rows: rows.into_iter().map(|(_, l, u)| (l, u)).collect(),
            jacobian,
            hessian,
            formula: PhantomData,
        }
    }

    fn seeded(x: &[f64], j: usize) -> Vec<Dual64> {
        let seed = |(k, &v): (usize, &f64)| Dual64::new(v, f64::from(u8::from(k == j)));
        x.iter().enumerate().map(seed).collect()
    }
}

impl<F: Formula> Nlp for Problem<F> {
    fn n(&self) -> usize {
        self.bounds.len()
    }

    fn m(&self) -> usize {
        self.rows.len()
    }

    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        for (j, &(l, u)) in self.bounds.iter().enumerate() {
            (lower[j], upper[j]) = (l, u);
        }
    }

    fn constraint_bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        for (i, &(l, u)) in self.rows.iter().enumerate() {
            (lower[i], upper[i]) = (l, u);
        }
    }

    fn objective(&mut self, x: &[f64]) -> f64 {
        F::evaluate(x).0
    }

    fn gradient(&mut self, x: &[f64], gradient: &mut [f64]) {
        for (j, g) in gradient.iter_mut().enumerate() {
            *g = F::evaluate(&Self::seeded(x, j)).0.eps;
        }
    }

    fn constraints(&mut self, x: &[f64], c: &mut [f64]) {
        for (c, row) in c.iter_mut().zip(F::evaluate(x).1) {
            *c = row.0;
        }
    }

    fn jacobian_pattern(&self) -> &SparsePattern {
        &self.jacobian
    }

    fn jacobian(&mut self, x: &[f64], values: &mut [f64]) {
        let n = self.n();
        for j in 0..n {
            for (i, row) in F::evaluate(&Self::seeded(x, j)).1.iter().enumerate() {
                values[i * n + j] = row.0.eps;
            }
        }
    }

    fn hessian_pattern(&self) -> &SparsePattern {
        &self.hessian
    }

    fn hessian(&mut self, x: &[f64], sigma: f64, lambda: &[f64], values: &mut [f64]) {
        let mut k = 0;
        for i in 0..self.n() {
            for j in 0..=i {
                let unit = |a: usize, b: usize| f64::from(u8::from(a == b));
                let seed =
                    |(k, &v): (usize, &f64)| HyperDual64::new(v, unit(k, i), unit(k, j), 0.0);
                let z: Vec<HyperDual64> = x.iter().enumerate().map(seed).collect();
                let (f, rows) = F::evaluate(&z);
                values[k] = if sigma == 0.0 {
                    0.0
                } else {
                    sigma * f.eps1eps2
                };
                for (row, &l) in rows.iter().zip(lambda) {
                    if l != 0.0 {
                        values[k] += l * row.0.eps1eps2;
                    }
                }
                k += 1;
            }
        }
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
            problem: Box::new(Problem::<F>::new()),
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
