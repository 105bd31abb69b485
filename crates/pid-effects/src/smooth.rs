//! Numbers with second derivatives over which an effect's equation has no corners.

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use num_dual::{DualNum, HyperDual64};
use pid_symbolic::Function;
use pid_symbolic::program::Element;

use crate::scalar::Scalar;

/// A hyper-dual number (J. A. Fike, J. J. Alonso, AIAA 2011-886) whose absolute value and limits are smooth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Smooth(pub HyperDual64);

/// Rounding of |x| at zero: √(x² + ε²), in the unit of x. A thousandth of a newton metre is below
/// any drive's noise.
pub(crate) const ROUND: f64 = 1e-3;
/// Rounding of a limit, share of the distance between the two: the corner is left by 0.25 % of that.
pub(crate) const CORNER: f64 = 5e-3;
/// Rounding at zero of one and the slope of a friction that grows with the load: there a gear locks itself. It changes
/// the friction of a gear that is far from it by 1e-4.
pub(crate) const JAM: f64 = 0.02;
/// Beyond this tanh is ±1 to rounding, and its exponentials would overflow.
const SATURATED: f64 = 20.0;

macro_rules! operator {
    ($trait:ident, $method:ident) => {
        impl $trait for Smooth {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                Smooth($trait::$method(self.0, other.0))
            }
        }
        impl $trait<f64> for Smooth {
            type Output = Self;
            fn $method(self, other: f64) -> Self {
                Smooth($trait::$method(self.0, other))
            }
        }
    };
}
operator!(Add, add);
operator!(Sub, sub);
operator!(Mul, mul);
operator!(Div, div);

impl Neg for Smooth {
    type Output = Self;
    fn neg(self) -> Self {
        Smooth(-self.0)
    }
}
impl AddAssign for Smooth {
    fn add_assign(&mut self, other: Self) {
        self.0 += other.0;
    }
}
impl SubAssign for Smooth {
    fn sub_assign(&mut self, other: Self) {
        self.0 -= other.0;
    }
}

impl Smooth {
    /// What a travel exceeds a gap by, and its slope: zero within ± gap/2, the corners rounded as
    /// those of [`Scalar::limit`]. Without a gap the travel itself.
    pub fn beyond(self, gap: Self) -> (Self, Self) {
        if gap.0.re == 0.0 {
            return (self, Smooth::constant(1.0));
        }
        let half = gap * 0.5;
        let round = gap * CORNER;
        let slope = |end: Self| {
            let x = self - end;
            x / (x * x + round * round).root()
        };
        let touch = (slope(half) - slope(-half)) * 0.5 + 1.0;
        (self - self.limit(-half, half), touch)
    }
}

impl Scalar for Smooth {
    fn constant(x: f64) -> Self {
        Smooth(HyperDual64::from_re(x))
    }
    fn value(self) -> f64 {
        self.0.re
    }
    fn sine(self) -> Self {
        Smooth(self.0.sin())
    }
    fn cosine(self) -> Self {
        Smooth(self.0.cos())
    }
    fn sine_cosine(self) -> (Self, Self) {
        let (s, c) = self.0.sin_cos();
        (Smooth(s), Smooth(c))
    }
    fn exponential(self) -> Self {
        Smooth(self.0.exp())
    }
    fn root(self) -> Self {
        Smooth(self.0.sqrt())
    }
    fn magnitude(self) -> Self {
        (self * self + ROUND * ROUND).root()
    }
    fn hyperbolic_tangent(self) -> Self {
        if self.0.re.abs() > SATURATED {
            return Smooth::constant(self.0.re.signum());
        }
        Smooth(self.0.tanh())
    }
    fn limit(self, low: Self, high: Self) -> Self {
        // Half the sum of the distances from both limits, each rounded at zero.
        let round = (high - low) * CORNER;
        let round = round * round;
        let from = |end: Self| {
            let x = self - end;
            (x * x + round).root()
        };
        (low + high + from(low) - from(high)) * 0.5
    }
}

impl Element for Smooth {
    fn splat(x: f64) -> Self {
        Self::constant(x)
    }
    fn minus(self) -> Self {
        -self
    }
    fn plus(self, other: Self) -> Self {
        self + other
    }
    fn less(self, other: Self) -> Self {
        self - other
    }
    fn times(self, other: Self) -> Self {
        self * other
    }
    fn over(self, other: Self) -> Self {
        self / other
    }
    fn power(self, n: i32) -> Self {
        Smooth(self.0.powi(n))
    }
    fn call(self, f: Function) -> Self {
        let x = self.0;
        Smooth(match f {
            Function::Sin => x.sin(),
            Function::Cos => x.cos(),
            Function::Tan => x.tan(),
            Function::Tanh => return self.hyperbolic_tangent(),
            Function::Atan => x.atan(),
            Function::Exp => x.exp(),
            Function::Ln => x.ln(),
            Function::Sqrt => x.sqrt(),
            Function::Abs => x * x.re.signum(),
            Function::Sign => return Self::constant(f.apply(x.re)),
        })
    }
}
