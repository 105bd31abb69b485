//! Running a program over numbers and lanes of numbers.

use super::{Code, Op, Run};
use crate::node::Function;

/// Points evaluated at once by [`Program::eval_lanes`](super::Program::eval_lanes).
pub const LANES: usize = 4;

/// What a slot holds.
pub(super) trait Element: Copy {
    /// A constant.
    fn splat(x: f64) -> Self;
    /// f(x).
    fn map(self, f: impl Fn(f64) -> f64) -> Self;
    /// f(x, y).
    fn zip(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self;
    /// A work space of zeros.
    fn zeros(len: usize) -> Box<[Self]>;
}

impl Element for f64 {
    #[inline(always)]
    fn splat(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn map(self, f: impl Fn(f64) -> f64) -> Self {
        f(self)
    }
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        f(self, other)
    }
    fn zeros(len: usize) -> Box<[Self]> {
        vec![0.0; len].into_boxed_slice()
    }
}

impl Element for [f64; LANES] {
    #[inline(always)]
    fn splat(x: f64) -> Self {
        [x; LANES]
    }
    #[inline(always)]
    fn map(self, f: impl Fn(f64) -> f64) -> Self {
        std::array::from_fn(|k| f(self[k]))
    }
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        std::array::from_fn(|k| f(self[k], other[k]))
    }
    fn zeros(len: usize) -> Box<[Self]> {
        vec![[0.0; LANES]; len].into_boxed_slice()
    }
}

/// Number of a slot, and the work space it belongs to.
pub(super) trait Slot: Copy {
    /// Slots of elements.
    type Work<T>: ?Sized;
    /// The value in a slot.
    fn get<T: Copy>(self, work: &Self::Work<T>) -> T;
    /// Writes a slot.
    fn set<T>(self, work: &mut Self::Work<T>, value: T);
}

/// A slot of at most 2¹⁶. The work space has as many, whatever the program needs: no access has to be checked, and memory
/// that is never touched costs nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Narrow(u16);

impl Narrow {
    /// Number of slots.
    pub(super) const COUNT: usize = 1 << 16;

    /// The slot with this number, which must be below [`Narrow::COUNT`].
    pub(super) fn new(slot: u32) -> Self {
        Self(u16::try_from(slot).expect("the number of slots was compared before"))
    }
}

impl Slot for Narrow {
    type Work<T> = [T; Narrow::COUNT];
    #[inline(always)]
    fn get<T: Copy>(self, work: &Self::Work<T>) -> T {
        work[usize::from(self.0)]
    }
    #[inline(always)]
    fn set<T>(self, work: &mut Self::Work<T>, value: T) {
        work[usize::from(self.0)] = value;
    }
}

impl Slot for u32 {
    type Work<T> = [T];
    #[inline(always)]
    fn get<T: Copy>(self, work: &[T]) -> T {
        work[self as usize]
    }
    #[inline(always)]
    fn set<T>(self, work: &mut [T], value: T) {
        work[self as usize] = value;
    }
}

/// Memory of evaluations over `f64` or over lanes; any program may use it, one after the other.
#[derive(Debug, Clone, Default)]
pub struct Scratch<T> {
    narrow: Option<Box<[T; Narrow::COUNT]>>,
    wide: Box<[T]>,
}

impl<T> Scratch<T> {
    /// Empty; memory is taken at the first evaluation.
    pub fn new() -> Self {
        Self {
            narrow: None,
            wide: Box::new([]),
        }
    }
}

#[allow(private_bounds, reason = "the two elements are f64 and lanes of f64")]
impl<T: Element> Scratch<T> {
    pub(super) fn narrow(&mut self) -> &mut [T; Narrow::COUNT] {
        self.narrow.get_or_insert_with(|| {
            T::zeros(Narrow::COUNT)
                .try_into()
                .unwrap_or_else(|_| unreachable!("zeros of this length"))
        })
    }

    pub(super) fn wide(&mut self, len: usize) -> &mut [T] {
        if self.wide.len() < len {
            self.wide = T::zeros(len);
        }
        &mut self.wide
    }
}

/// Runs the instructions and reads the outputs.
pub(super) fn run<S: Slot, T: Element, const N: usize>(
    runs: &[Run],
    code: &Code<S>,
    work: &mut S::Work<T>,
    out: [&mut [T]; N],
) {
    let mut rest = code.args.as_slice();
    for run in runs {
        let (args, after) = rest.split_at(run.count as usize * (run.op.arity() + 1));
        rest = after;
        match run.op {
            Op::Neg => unary(args, work, |x: T| x.map(|x| -x)),
            Op::Add => binary(args, work, add),
            Op::Sub => binary(args, work, sub),
            Op::Mul => binary(args, work, mul),
            Op::Div => binary(args, work, |x: T, y| x.zip(y, |x, y| x / y)),
            Op::MulMul => ternary(args, work, |x, y, z| mul(mul(x, y), z)),
            Op::MulAdd => ternary(args, work, |x, y, z| add(mul(x, y), z)),
            Op::MulSub => ternary(args, work, |x, y, z| sub(mul(x, y), z)),
            Op::SubMul => ternary(args, work, |x, y, z| sub(x, mul(y, z))),
            Op::MulAddMul => quaternary(args, work, |x, y, z, w| add(mul(x, y), mul(z, w))),
            Op::MulSubMul => quaternary(args, work, |x, y, z, w| sub(mul(x, y), mul(z, w))),
            Op::Powi(n) => unary(args, work, |x: T| x.map(|x| x.powi(n))),
            Op::Call(Function::Sin) => unary(args, work, |x: T| x.map(f64::sin)),
            Op::Call(Function::Cos) => unary(args, work, |x: T| x.map(f64::cos)),
            Op::Call(f) => unary(args, work, |x: T| x.map(|x| f.apply(x))),
        }
    }
    let mut slots = code.outputs.iter();
    for part in out {
        for (out, slot) in part.iter_mut().zip(&mut slots) {
            *out = slot.get(work);
        }
    }
}

#[inline(always)]
fn add<T: Element>(x: T, y: T) -> T {
    x.zip(y, |x, y| x + y)
}

#[inline(always)]
fn sub<T: Element>(x: T, y: T) -> T {
    x.zip(y, |x, y| x - y)
}

#[inline(always)]
fn mul<T: Element>(x: T, y: T) -> T {
    x.zip(y, |x, y| x * y)
}

#[inline(always)]
fn unary<S: Slot, T: Element>(args: &[S], work: &mut S::Work<T>, f: impl Fn(T) -> T) {
    for &[x, result] in args.as_chunks().0 {
        result.set(work, f(x.get(work)));
    }
}

#[inline(always)]
fn binary<S: Slot, T: Element>(args: &[S], work: &mut S::Work<T>, f: impl Fn(T, T) -> T) {
    for &[x, y, result] in args.as_chunks().0 {
        result.set(work, f(x.get(work), y.get(work)));
    }
}

#[inline(always)]
fn ternary<S: Slot, T: Element>(args: &[S], work: &mut S::Work<T>, f: impl Fn(T, T, T) -> T) {
    for &[x, y, z, result] in args.as_chunks().0 {
        result.set(work, f(x.get(work), y.get(work), z.get(work)));
    }
}

#[inline(always)]
fn quaternary<S: Slot, T: Element>(args: &[S], work: &mut S::Work<T>, f: impl Fn(T, T, T, T) -> T) {
    for &[x, y, z, w, result] in args.as_chunks().0 {
        result.set(work, f(x.get(work), y.get(work), z.get(work), w.get(work)));
    }
}
