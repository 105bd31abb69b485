//! Outputs of a graph as a program for fast repeated evaluation over any [`Element`]: `f64`,
//! [`LANES`] points at a time, numbers with derivatives.
//!
//! A [`Tape`](crate::Tape) decides for every operation what to do next; on a processor that
//! decision costs several times the operation. A program decides once per run of equal operations:
//!
//! - products that are used once are fused into the sum that uses them (`a·b + c`, `a·b − c·d`, …),
//!   with the roundings of the separate operations;
//! - operations are sorted into runs of one kind within windows of the depth-first order (`select`);
//! - values live in the slots of one work space; a slot is used again as soon as its value is dead
//!   (`slots`).
//!
//! Results equal those of [`Tape`](crate::Tape) bit by bit.
//!
//! # Example
//! ```
//! use pid_symbolic::{Graph, Program, program::Scratch};
//!
//! let mut g = Graph::new();
//! let (x, y) = (g.var(0), g.var(1));
//! let product = g.mul(x, y);
//! let f = g.add(product, x);
//! let program = Program::new(&g, &[f]);
//! let (mut scratch, mut out) = (Scratch::new(), [0.0]);
//! program.eval(&mut scratch, |vars| vars.copy_from_slice(&[3.0, 5.0]), [&mut out]);
//! assert_eq!(out, [18.0]);
//! ```

mod execute;
mod select;
mod slots;

use std::ops::Range;

pub use execute::{Element, LANES, Scratch};
use execute::{Narrow, Tiny};

use crate::graph::Graph;
use crate::node::{Function, Id, Node};
use crate::schedule;

/// Operation of a run of instructions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Op {
    /// −a.
    Neg,
    /// a + b.
    Add,
    /// a − b.
    Sub,
    /// a b.
    Mul,
    /// a / b.
    Div,
    /// a b c.
    MulMul,
    /// a b + c.
    MulAdd,
    /// a b − c.
    MulSub,
    /// a − b c.
    SubMul,
    /// a b + c d.
    MulAddMul,
    /// a b − c d.
    MulSubMul,
    /// aⁿ.
    Powi(i32),
    /// f(a).
    Call(Function),
}

impl Op {
    /// Number of operands.
    fn arity(self) -> usize {
        match self {
            Self::Neg | Self::Powi(_) | Self::Call(_) => 1,
            Self::Add | Self::Sub | Self::Mul | Self::Div => 2,
            Self::MulMul | Self::MulAdd | Self::MulSub | Self::SubMul => 3,
            Self::MulAddMul | Self::MulSubMul => 4,
        }
    }
}

/// Equal operations, one after the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Run {
    op: Op,
    count: u32,
}

/// Slots of operands and results, in the order of the instructions, and of the outputs.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Code<S> {
    /// Per instruction: the operands, then the result.
    args: Vec<S>,
    outputs: Vec<S>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Slots {
    /// Fewer than 2⁸ slots: reads and writes need no check, and everything is near.
    Tiny(Code<Tiny>),
    /// Fewer than 2¹⁶ slots: reads and writes need no check.
    Narrow(Code<Narrow>),
    /// Any number.
    Wide(Code<u32>),
}

/// Outputs of a graph, ready to be evaluated again and again.
#[derive(Debug, Clone, PartialEq)]
pub struct Program {
    runs: Vec<Run>,
    slots: Slots,
    /// Values of the slots after the variables.
    constants: Vec<f64>,
    /// For each variable up to the highest one: whether it is read.
    reads: Vec<bool>,
    size: usize,
}

impl Program {
    /// The program of `outputs`, in their order.
    pub fn new(g: &Graph, outputs: &[Id]) -> Self {
        let order = schedule::order(g, outputs);
        let leaves = Leaves::new(g, &order, outputs);
        let instructions = select::instructions(g, &order, outputs);
        let layout = slots::assign(g, &leaves, &instructions, outputs);

        let mut runs: Vec<Run> = Vec::new();
        for instruction in &instructions {
            match runs.last_mut() {
                Some(run) if run.op == instruction.op && run.count < u32::MAX => run.count += 1,
                _ => runs.push(Run {
                    op: instruction.op,
                    count: 1,
                }),
            }
        }
        let slots = if layout.size <= Tiny::COUNT {
            let tiny = |slots: &[u32]| slots.iter().map(|&s| Tiny::new(s)).collect();
            Slots::Tiny(Code {
                args: tiny(&layout.args),
                outputs: tiny(&layout.outputs),
            })
        } else if layout.size <= Narrow::COUNT {
            let narrow = |slots: &[u32]| slots.iter().map(|&s| Narrow::new(s)).collect();
            Slots::Narrow(Code {
                args: narrow(&layout.args),
                outputs: narrow(&layout.outputs),
            })
        } else {
            Slots::Wide(Code {
                args: layout.args,
                outputs: layout.outputs,
            })
        };
        Self {
            runs,
            slots,
            constants: leaves.constants,
            reads: leaves.reads,
            size: layout.size,
        }
    }

    /// The same with a work space of exactly the slots it needs, each access checked: for programs
    /// that run seldom, over elements so large that 2¹⁶ of them cost more than the evaluation.
    pub fn exact(mut self) -> Self {
        if let Slots::Narrow(code) = &self.slots {
            let numbers = |slots: &[Narrow]| slots.iter().map(|s| s.number()).collect();
            self.slots = Slots::Wide(Code {
                args: numbers(&code.args),
                outputs: numbers(&code.outputs),
            });
        }
        self
    }

    /// Number of variables: one more than the highest variable number read.
    pub fn vars(&self) -> usize {
        self.reads.len()
    }

    /// Whether any variable of a range of numbers is read.
    pub fn reads(&self, vars: Range<usize>) -> bool {
        vars.into_iter()
            .any(|var| self.reads.get(var).is_some_and(|&read| read))
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        match &self.slots {
            Slots::Tiny(code) => code.outputs.len(),
            Slots::Narrow(code) => code.outputs.len(),
            Slots::Wide(code) => code.outputs.len(),
        }
    }

    /// Number of instructions, and of the runs they form.
    pub fn instructions(&self) -> (usize, usize) {
        let count = self.runs.iter().map(|run| run.count as usize).sum();
        (count, self.runs.len())
    }

    /// Number of slots of the work space: variables, constants, intermediate values.
    pub fn slots(&self) -> usize {
        self.size
    }

    /// The outputs at one point. `fill` is given the places of the [`vars`](Self::vars) variables,
    /// which hold arbitrary numbers, and writes those that are read. The slices of `out` take the
    /// outputs one after the other. Allocates only if `scratch` was never used with a program of
    /// this size.
    ///
    /// # Panics
    /// If the slices of `out` do not have [`outputs`](Self::outputs) places together.
    pub fn eval<const N: usize>(
        &self,
        scratch: &mut Scratch<f64>,
        fill: impl FnOnce(&mut [f64]),
        out: [&mut [f64]; N],
    ) {
        self.evaluate(scratch, fill, out);
    }

    /// The outputs at [`LANES`] points: lane `k` of variables and outputs belongs to point `k`.
    ///
    /// # Panics
    /// As [`eval`](Self::eval).
    pub fn eval_lanes<const N: usize>(
        &self,
        scratch: &mut Scratch<[f64; LANES]>,
        fill: impl FnOnce(&mut [[f64; LANES]]),
        out: [&mut [[f64; LANES]]; N],
    ) {
        self.evaluate(scratch, fill, out);
    }

    /// The outputs over any [`Element`], compiled for the processor features of the caller.
    ///
    /// # Panics
    /// As [`eval`](Self::eval).
    #[inline(always)]
    pub fn evaluate<T: Element, const N: usize>(
        &self,
        scratch: &mut Scratch<T>,
        fill: impl FnOnce(&mut [T]),
        out: [&mut [T]; N],
    ) {
        self.load(scratch, |_| {});
        self.resume(scratch, fill, out);
    }

    /// Writes constants, and variables by `fill`, for evaluations by [`resume`](Self::resume).
    pub fn load<T: Element>(&self, scratch: &mut Scratch<T>, fill: impl FnOnce(&mut [T])) {
        let work = match &self.slots {
            Slots::Tiny(_) => &mut scratch.tiny()[..],
            Slots::Narrow(_) => &mut scratch.narrow()[..],
            Slots::Wide(_) => scratch.wide(self.size),
        };
        let (vars, rest) = work.split_at_mut(self.reads.len());
        fill(vars);
        for (slot, &constant) in rest.iter_mut().zip(&self.constants) {
            *slot = T::splat(constant);
        }
    }

    /// The outputs once more: constants are those of the last [`load`](Self::load), and so are the
    /// variables that `fill` leaves. No other program may have used `scratch` since.
    ///
    /// # Panics
    /// As [`eval`](Self::eval).
    #[inline(always)]
    pub fn resume<T: Element, const N: usize>(
        &self,
        scratch: &mut Scratch<T>,
        fill: impl FnOnce(&mut [T]),
        out: [&mut [T]; N],
    ) {
        let places = out.iter().map(|out| out.len()).sum::<usize>();
        assert_eq!(places, self.outputs(), "one place per output");
        let vars = self.reads.len();
        match &self.slots {
            Slots::Tiny(code) => {
                let work = scratch.tiny();
                fill(&mut work[..vars]);
                execute::run(&self.runs, code, work, out);
            }
            Slots::Narrow(code) => {
                let work = scratch.narrow();
                fill(&mut work[..vars]);
                execute::run(&self.runs, code, work, out);
            }
            Slots::Wide(code) => {
                let work = scratch.wide(self.size);
                fill(&mut work[..vars]);
                execute::run(&self.runs, code, work, out);
            }
        }
    }
}

/// Constants and variables that are read.
struct Leaves {
    constants: Vec<f64>,
    /// Nodes of the constants, sorted.
    constant_ids: Vec<Id>,
    reads: Vec<bool>,
}

impl Leaves {
    fn new(g: &Graph, order: &[Id], outputs: &[Id]) -> Self {
        let mut constant_ids = Vec::new();
        let mut reads = Vec::new();
        let used = order
            .iter()
            .flat_map(|&id| g.node(id).operands())
            .chain(outputs.iter().copied());
        for id in used {
            match g.node(id) {
                Node::Const(_) => constant_ids.push(id),
                Node::Var(var) => {
                    let var = var as usize;
                    if reads.len() <= var {
                        reads.resize(var + 1, false);
                    }
                    reads[var] = true;
                }
                _ => {}
            }
        }
        constant_ids.sort_unstable();
        constant_ids.dedup();
        let constants = constant_ids
            .iter()
            .map(|&id| g.value(id).expect("only constants were kept"))
            .collect();
        Self {
            constants,
            constant_ids,
            reads,
        }
    }

    /// Number of slots that hold variables and constants.
    fn count(&self) -> usize {
        self.reads.len() + self.constants.len()
    }

    /// The slot of a leaf, `None` for an operation.
    fn slot(&self, g: &Graph, id: Id) -> Option<u32> {
        match g.node(id) {
            Node::Var(var) => Some(var),
            Node::Const(_) => {
                let place = self
                    .constant_ids
                    .binary_search(&id)
                    .expect("every constant that is read was kept");
                Some((self.reads.len() + place) as u32)
            }
            _ => None,
        }
    }
}
