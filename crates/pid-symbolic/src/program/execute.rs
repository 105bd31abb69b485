//! Running a program over numbers and lanes of numbers.

use num_dual::{Dual64, DualNum};

use super::{Code, Op, Run};
use crate::node::Function;

/// Points evaluated at once by [`Program::eval_lanes`](super::Program::eval_lanes).
pub const LANES: usize = 4;

/// A number that programs compute with: plain, several side by side, or with derivatives.
pub trait Element: Copy {
    /// A constant.
    fn splat(x: f64) -> Self;
    /// −x.
    fn minus(self) -> Self;
    /// x + y.
    fn plus(self, other: Self) -> Self;
    /// x − y.
    fn less(self, other: Self) -> Self;
    /// x y.
    fn times(self, other: Self) -> Self;
    /// x / y.
    fn over(self, other: Self) -> Self;
    /// xⁿ.
    fn power(self, n: i32) -> Self;
    /// f(x).
    fn call(self, f: Function) -> Self;
    /// A work space of zeros.
    fn zeros(len: usize) -> Box<[Self]> {
        vec![Self::splat(0.0); len].into_boxed_slice()
    }
}

impl Element for f64 {
    #[inline(always)]
    fn splat(x: f64) -> Self {
        x
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
        self.powi(n)
    }
    #[inline(always)]
    fn call(self, f: Function) -> Self {
        f.apply(self)
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
    fn minus(self) -> Self {
        self.map(|x| -x)
    }
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        std::array::from_fn(|k| self[k] + other[k])
    }
    #[inline(always)]
    fn less(self, other: Self) -> Self {
        std::array::from_fn(|k| self[k] - other[k])
    }
    #[inline(always)]
    fn times(self, other: Self) -> Self {
        std::array::from_fn(|k| self[k] * other[k])
    }
    #[inline(always)]
    fn over(self, other: Self) -> Self {
        std::array::from_fn(|k| self[k] / other[k])
    }
    #[inline(always)]
    fn power(self, n: i32) -> Self {
        self.map(|x| x.powi(n))
    }
    #[inline(always)]
    fn call(self, f: Function) -> Self {
        self.map(|x| f.apply(x))
    }
    fn zeros(len: usize) -> Box<[Self]> {
        vec![[0.0; LANES]; len].into_boxed_slice()
    }
}

impl Element for Dual64 {
    fn splat(x: f64) -> Self {
        Dual64::from(x)
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
        self.powi(n)
    }
    fn call(self, f: Function) -> Self {
        crate::eval::call(f, self)
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

/// A slot of at most 2⁸: the whole work space fits the fastest memory, even with derivatives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Tiny(u8);

impl Tiny {
    /// Number of slots.
    pub(super) const COUNT: usize = 1 << 8;

    /// The slot with this number, which must be below [`Tiny::COUNT`].
    pub(super) fn new(slot: u32) -> Self {
        Self(u8::try_from(slot).expect("the number of slots was compared before"))
    }
}

impl Slot for Tiny {
    type Work<T> = [T; Tiny::COUNT];
    #[inline(always)]
    fn get<T: Copy>(self, work: &Self::Work<T>) -> T {
        work[usize::from(self.0)]
    }
    #[inline(always)]
    fn set<T>(self, work: &mut Self::Work<T>, value: T) {
        work[usize::from(self.0)] = value;
    }
}

/// A slot of at most 2¹⁶. The work space always has 2¹⁶ slots: no access has to be checked, and
/// memory that is never touched costs nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Narrow(u16);

impl Narrow {
    /// Number of slots.
    pub(super) const COUNT: usize = 1 << 16;

    /// The slot with this number, which must be below [`Narrow::COUNT`].
    pub(super) fn new(slot: u32) -> Self {
        Self(u16::try_from(slot).expect("the number of slots was compared before"))
    }

    /// Its number.
    pub(super) fn number(self) -> u32 {
        u32::from(self.0)
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

/// Memory of evaluations over one kind of number; any program may use it, one after the other.
#[derive(Debug, Clone, Default)]
pub struct Scratch<T> {
    tiny: Option<Box<[T; Tiny::COUNT]>>,
    narrow: Option<Box<[T; Narrow::COUNT]>>,
    wide: Box<[T]>,
}

impl<T> Scratch<T> {
    /// Empty; memory is taken at the first evaluation.
    pub fn new() -> Self {
        Self {
            tiny: None,
            narrow: None,
            wide: Box::new([]),
        }
    }
}

fn zeros<T: Element, const N: usize>() -> Box<[T; N]> {
    T::zeros(N)
        .try_into()
        .unwrap_or_else(|_| unreachable!("zeros of this length"))
}

impl<T: Element> Scratch<T> {
    pub(super) fn tiny(&mut self) -> &mut [T; Tiny::COUNT] {
        self.tiny.get_or_insert_with(zeros)
    }

    pub(super) fn narrow(&mut self) -> &mut [T; Narrow::COUNT] {
        self.narrow.get_or_insert_with(zeros)
    }

    pub(super) fn wide(&mut self, len: usize) -> &mut [T] {
        if self.wide.len() < len {
            self.wide = T::zeros(len);
        }
        &mut self.wide
    }
}

/// Runs the instructions and reads the outputs, compiled for the processor features of the caller.
#[inline(always)]
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
            Op::Neg => unary(args, work, |x: T| x.minus()),
            Op::Add => binary(args, work, |x: T, y| x.plus(y)),
            Op::Sub => binary(args, work, |x: T, y| x.less(y)),
            Op::Mul => binary(args, work, |x: T, y| x.times(y)),
            Op::Div => binary(args, work, |x: T, y| x.over(y)),
            Op::MulMul => ternary(args, work, |x: T, y, z| x.times(y).times(z)),
            Op::MulAdd => ternary(args, work, |x: T, y, z| x.times(y).plus(z)),
            Op::MulSub => ternary(args, work, |x: T, y, z| x.times(y).less(z)),
            Op::SubMul => ternary(args, work, |x: T, y, z| x.less(y.times(z))),
            Op::MulAddMul => quaternary(args, work, |x: T, y, z, w| x.times(y).plus(z.times(w))),
            Op::MulSubMul => quaternary(args, work, |x: T, y, z, w| x.times(y).less(z.times(w))),
            Op::Powi(n) => unary(args, work, |x: T| x.power(n)),
            Op::Call(Function::Sin) => unary(args, work, |x: T| x.call(Function::Sin)),
            Op::Call(Function::Cos) => unary(args, work, |x: T| x.call(Function::Cos)),
            Op::Call(f) => unary(args, work, |x: T| x.call(f)),
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
