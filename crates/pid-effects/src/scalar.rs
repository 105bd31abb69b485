//! Numbers the simulation runs on: plain, dual, or several first derivatives side by side.

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use num_dual::DualNum;
use pid_symbolic::Function;
use pid_symbolic::program::Element;

/// A real number that may carry derivatives.
///
/// Implemented for every [`DualNum`] over `f64` (and so for `f64` itself) and for [`Lanes`].
pub trait Scalar:
    Copy
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
    + AddAssign
    + SubAssign
{
    /// A constant.
    fn constant(x: f64) -> Self;
    /// The value without derivatives.
    fn value(self) -> f64;
    /// Sine.
    fn sine(self) -> Self;
    /// Cosine.
    fn cosine(self) -> Self;
    /// Sine and cosine.
    fn sine_cosine(self) -> (Self, Self);
    /// Exponential.
    fn exponential(self) -> Self;
    /// Square root.
    fn root(self) -> Self;

    /// Zero.
    fn nil() -> Self {
        Self::constant(0.0)
    }
    /// Square.
    fn square(self) -> Self {
        self * self
    }
    /// 1 over the number.
    fn inverse(self) -> Self {
        Self::constant(1.0) / self
    }
    /// Absolute value; at zero the derivative is taken from the right.
    fn magnitude(self) -> Self {
        if self.value() < 0.0 { -self } else { self }
    }
    /// Hyperbolic tangent.
    fn hyperbolic_tangent(self) -> Self {
        // From the side on which the exponential is small.
        let small = (-(self.magnitude() * 2.0)).exponential();
        let size = (-small + 1.0) / (small + 1.0);
        size * if self.value() < 0.0 { -1.0 } else { 1.0 }
    }
    /// The number limited to `low..=high`; the derivative is that of the active branch.
    fn limit(self, low: Self, high: Self) -> Self {
        if self.value() < low.value() {
            low
        } else if self.value() > high.value() {
            high
        } else {
            self
        }
    }
}

impl<D: DualNum<Primitive = f64> + Copy + Send + Sync + 'static> Scalar for D {
    fn constant(x: f64) -> Self {
        D::from(x)
    }
    fn value(self) -> f64 {
        self.re()
    }
    fn sine(self) -> Self {
        self.sin()
    }
    fn cosine(self) -> Self {
        self.cos()
    }
    fn sine_cosine(self) -> (Self, Self) {
        self.sin_cos()
    }
    fn exponential(self) -> Self {
        self.exp()
    }
    fn root(self) -> Self {
        self.sqrt()
    }
}

/// A value and its first derivatives in `N` directions, without the optional parts of the general
/// dual numbers: the inner loop of the simulation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lanes<const N: usize> {
    /// Value.
    pub re: f64,
    /// Derivatives.
    pub eps: [f64; N],
}

impl<const N: usize> Lanes<N> {
    /// The variable of one lane.
    ///
    /// # Panics
    /// If there is no such lane.
    pub fn variable(re: f64, lane: usize) -> Self {
        let mut eps = [0.0; N];
        eps[lane] = 1.0;
        Lanes { re, eps }
    }
    #[inline(always)]
    fn chain(mut self, re: f64, slope: f64) -> Self {
        // A loop and not `map`, which is not inlined in the large kernels.
        for e in &mut self.eps {
            *e *= slope;
        }
        self.re = re;
        self
    }
    #[inline(always)]
    fn both(self, other: Self, re: f64, f: impl Fn(f64, f64) -> f64) -> Self {
        let mut eps = [0.0; N];
        for i in 0..N {
            eps[i] = f(self.eps[i], other.eps[i]);
        }
        Lanes { re, eps }
    }
}

impl<const N: usize> Add for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        self.both(o, self.re + o.re, |a, b| a + b)
    }
}
impl<const N: usize> Sub for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        self.both(o, self.re - o.re, |a, b| a - b)
    }
}
impl<const N: usize> Mul for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    #[allow(clippy::suspicious_arithmetic_impl, reason = "the product rule adds")]
    fn mul(self, o: Self) -> Self {
        self.both(o, self.re * o.re, |a, b| a * o.re + b * self.re)
    }
}
impl<const N: usize> Div for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        let inverse = 1.0 / o.re;
        let re = self.re * inverse;
        self.both(o, re, |a, b| (a - b * re) * inverse)
    }
}
impl<const N: usize> Neg for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.chain(-self.re, -1.0)
    }
}
impl<const N: usize> Add<f64> for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn add(mut self, x: f64) -> Self {
        self.re += x;
        self
    }
}
impl<const N: usize> Sub<f64> for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn sub(mut self, x: f64) -> Self {
        self.re -= x;
        self
    }
}
impl<const N: usize> Mul<f64> for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, x: f64) -> Self {
        self.chain(self.re * x, x)
    }
}
impl<const N: usize> Div<f64> for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, x: f64) -> Self {
        self.chain(self.re / x, 1.0 / x)
    }
}
impl<const N: usize> AddAssign for Lanes<N> {
    #[inline(always)]
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}
impl<const N: usize> SubAssign for Lanes<N> {
    #[inline(always)]
    fn sub_assign(&mut self, o: Self) {
        *self = *self - o;
    }
}

impl<const N: usize> Scalar for Lanes<N> {
    #[inline(always)]
    fn constant(x: f64) -> Self {
        Lanes {
            re: x,
            eps: [0.0; N],
        }
    }
    #[inline(always)]
    fn value(self) -> f64 {
        self.re
    }
    #[inline(always)]
    fn sine(self) -> Self {
        let (s, c) = self.re.sin_cos();
        self.chain(s, c)
    }
    #[inline(always)]
    fn cosine(self) -> Self {
        let (s, c) = self.re.sin_cos();
        self.chain(c, -s)
    }
    #[inline(always)]
    fn sine_cosine(self) -> (Self, Self) {
        let (s, c) = self.re.sin_cos();
        (self.chain(s, c), self.chain(c, -s))
    }
    #[inline(always)]
    fn exponential(self) -> Self {
        let x = self.re.exp();
        self.chain(x, x)
    }
    #[inline(always)]
    fn root(self) -> Self {
        let x = self.re.sqrt();
        self.chain(x, 0.5 / x)
    }
}

impl<const N: usize> Element for Lanes<N> {
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self::constant(x)
    }
    #[inline(always)]
    fn minus(self) -> Self {
        -self
    }
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self + other
    }
    #[inline(always)]
    fn less(self, other: Self) -> Self {
        self - other
    }
    #[inline(always)]
    fn times(self, other: Self) -> Self {
        self * other
    }
    #[inline(always)]
    fn over(self, other: Self) -> Self {
        self / other
    }
    #[inline(always)]
    fn power(self, n: i32) -> Self {
        let below = self.re.powi(n - 1);
        self.chain(below * self.re, f64::from(n) * below)
    }
    #[inline(always)]
    fn call(self, f: Function) -> Self {
        match f {
            Function::Sin => self.sine(),
            Function::Cos => self.cosine(),
            _ => {
                let (x, y) = (self.re, f.apply(self.re));
                let slope = match f {
                    Function::Sin | Function::Cos | Function::Sign => 0.0,
                    Function::Tan => 1.0 + y * y,
                    Function::Tanh => 1.0 - y * y,
                    Function::Atan => 1.0 / (1.0 + x * x),
                    Function::Exp => y,
                    Function::Ln => 1.0 / x,
                    Function::Sqrt => 0.5 / y,
                    Function::Abs => x.signum(),
                };
                self.chain(y, slope)
            }
        }
    }
}
