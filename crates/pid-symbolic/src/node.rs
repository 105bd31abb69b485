//! Operations and their identifiers.

/// An expression: index of a [`Node`] in its [`Graph`](crate::Graph).
///
/// Operands always have smaller ids than the operations that use them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Id(pub(crate) u32);

impl Id {
    /// Position in the graph's arena.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// A constant, kept by its bits so that it can be compared and hashed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Constant(u64);

impl Constant {
    /// The constant of a value; both zeros become `+0`.
    pub fn new(value: f64) -> Self {
        Self(if value == 0.0 { 0 } else { value.to_bits() })
    }
    /// Its value.
    pub fn value(self) -> f64 {
        f64::from_bits(self.0)
    }
}

/// Functions of one argument.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Function {
    /// Sine.
    Sin,
    /// Cosine.
    Cos,
    /// Tangent.
    Tan,
    /// Hyperbolic tangent.
    Tanh,
    /// Arc tangent.
    Atan,
    /// Exponential.
    Exp,
    /// Natural logarithm.
    Ln,
    /// Square root.
    Sqrt,
    /// Absolute value.
    Abs,
    /// Sign: −1, 0 or 1; its derivative is taken as zero.
    Sign,
}

impl Function {
    /// All functions.
    pub const ALL: [Self; 10] = [
        Self::Sin,
        Self::Cos,
        Self::Tan,
        Self::Tanh,
        Self::Atan,
        Self::Exp,
        Self::Ln,
        Self::Sqrt,
        Self::Abs,
        Self::Sign,
    ];

    /// Name as written in an expression.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sin => "sin",
            Self::Cos => "cos",
            Self::Tan => "tan",
            Self::Tanh => "tanh",
            Self::Atan => "atan",
            Self::Exp => "exp",
            Self::Ln => "ln",
            Self::Sqrt => "sqrt",
            Self::Abs => "abs",
            Self::Sign => "sign",
        }
    }

    /// The function of a number.
    pub fn apply(self, x: f64) -> f64 {
        match self {
            Self::Sin => x.sin(),
            Self::Cos => x.cos(),
            Self::Tan => x.tan(),
            Self::Tanh => x.tanh(),
            Self::Atan => x.atan(),
            Self::Exp => x.exp(),
            Self::Ln => x.ln(),
            Self::Sqrt => x.sqrt(),
            Self::Abs => x.abs(),
            Self::Sign => sign(x),
        }
    }

    /// Whether f(−x) = −f(x).
    pub fn is_odd(self) -> bool {
        matches!(
            self,
            Self::Sin | Self::Tan | Self::Tanh | Self::Atan | Self::Sign
        )
    }

    /// Whether f(−x) = f(x).
    pub fn is_even(self) -> bool {
        matches!(self, Self::Cos | Self::Abs)
    }
}

/// −1, 0 or 1; NaN for NaN. Unlike [`f64::signum`] it is zero at zero.
pub fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

/// One operation of a graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Node {
    /// A number.
    Const(Constant),
    /// An independent variable, by its number.
    Var(u32),
    /// −x.
    Neg(Id),
    /// x + y.
    Add(Id, Id),
    /// x − y.
    Sub(Id, Id),
    /// x · y.
    Mul(Id, Id),
    /// x / y.
    Div(Id, Id),
    /// xⁿ with |n| ≥ 2, n ≠ 2.
    Powi(Id, i32),
    /// f(x).
    Call(Function, Id),
}

impl Node {
    /// The operands, first to last.
    pub fn operands(&self) -> impl Iterator<Item = Id> + use<> {
        let (first, second) = match *self {
            Self::Const(_) | Self::Var(_) => (None, None),
            Self::Neg(x) | Self::Powi(x, _) | Self::Call(_, x) => (Some(x), None),
            Self::Add(x, y) | Self::Sub(x, y) | Self::Mul(x, y) | Self::Div(x, y) => {
                (Some(x), Some(y))
            }
        };
        first.into_iter().chain(second)
    }

    /// Whether it is a constant or a variable, which cost nothing to evaluate.
    pub fn is_leaf(&self) -> bool {
        matches!(self, Self::Const(_) | Self::Var(_))
    }
}
