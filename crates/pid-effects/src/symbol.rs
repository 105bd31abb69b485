//! Numbers that are expressions of a graph: an effect's equation over them becomes code.
//!
//! The laws of the library take plain numbers, without a graph beside them. So the graph that their
//! operations go to is that of the thread, from [`on`] to its end.

use std::cell::RefCell;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use pid_symbolic::{Function, Graph, Id};

use crate::scalar::Scalar;

thread_local! {
    static GRAPH: RefCell<Graph> = RefCell::new(Graph::new());
}

/// An expression of the graph that [`on`] works on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Symbol(pub Id);

/// Runs `work`, whose operations on symbols go to `graph`. Calls do not nest.
pub fn on<R>(graph: &mut Graph, work: impl FnOnce() -> R) -> R {
    GRAPH.with_borrow_mut(|own| std::mem::swap(own, graph));
    let out = work();
    GRAPH.with_borrow_mut(|own| std::mem::swap(own, graph));
    out
}

impl Symbol {
    fn of(operation: impl FnOnce(&mut Graph) -> Id) -> Self {
        Symbol(GRAPH.with_borrow_mut(operation))
    }
    fn call(self, f: Function) -> Self {
        Self::of(|g| g.call(f, self.0))
    }
}

macro_rules! operator {
    ($trait:ident, $method:ident, $own:ident) => {
        impl $trait for Symbol {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                Self::of(|g| g.$own(self.0, other.0))
            }
        }
        impl $trait<f64> for Symbol {
            type Output = Self;
            fn $method(self, other: f64) -> Self {
                $trait::$method(self, Symbol::constant(other))
            }
        }
    };
}
operator!(Add, add, add);
operator!(Sub, sub, sub);
operator!(Mul, mul, mul);
operator!(Div, div, div);

impl Neg for Symbol {
    type Output = Self;
    fn neg(self) -> Self {
        Self::of(|g| g.neg(self.0))
    }
}
impl AddAssign for Symbol {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}
impl SubAssign for Symbol {
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl Scalar for Symbol {
    fn constant(x: f64) -> Self {
        Self::of(|g| g.constant(x))
    }
    /// That of a constant; of everything else it is not known.
    fn value(self) -> f64 {
        GRAPH.with_borrow(|g| g.value(self.0)).unwrap_or(f64::NAN)
    }
    fn sine(self) -> Self {
        self.call(Function::Sin)
    }
    fn cosine(self) -> Self {
        self.call(Function::Cos)
    }
    fn sine_cosine(self) -> (Self, Self) {
        (self.sine(), self.cosine())
    }
    fn exponential(self) -> Self {
        self.call(Function::Exp)
    }
    fn root(self) -> Self {
        self.call(Function::Sqrt)
    }
    fn magnitude(self) -> Self {
        self.call(Function::Abs)
    }
    fn hyperbolic_tangent(self) -> Self {
        self.call(Function::Tanh)
    }
    fn limit(self, low: Self, high: Self) -> Self {
        (low + high + (self - low).magnitude() - (self - high).magnitude()) * 0.5
    }
}

#[cfg(test)]
mod tests {
    use pid_symbolic::Tape;

    use super::*;

    /// Every operation of a scalar, once.
    fn all<D: Scalar>(x: D, y: D) -> D {
        let (s, c) = (x * 2.0).sine_cosine();
        let mut sum = s * y - c / (y + 3.0);
        sum += (x - 0.5).magnitude() + (-y).exponential();
        sum -= (x * x + 1.0).root() * y.hyperbolic_tangent();
        sum + (x * 3.0).limit(-y.square(), y.square()) / 2.0 + y.inverse()
    }

    #[test]
    fn a_law_over_symbols_is_the_law_over_numbers() {
        let mut g = Graph::new();
        let (x, y) = (g.var(0), g.var(1));
        let law = on(&mut g, || all(Symbol(x), Symbol(y)));
        let tape = Tape::new(&g, &[law.0]);
        for (x, y) in [(0.3_f64, 0.7_f64), (-1.2, 0.4), (2.0, -1.1)] {
            let mut out = [0.0];
            tape.eval(&[x, y], &mut out);
            assert!((out[0] - all(x, y)).abs() < 1e-13, "{out:?}");
        }
        // Outside, there is a graph too.
        assert_eq!((Symbol::constant(2.0) * 3.0).value(), 6.0);
    }
}
