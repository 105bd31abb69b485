//! A program with the arguments of a model.

use std::cell::RefCell;
use std::ops::Range;

use pid_runtime::dynamics::{At, Dims};
use pid_runtime::lanes::{Lane, LanesAt};
use pid_symbolic::program::Scratch;
use pid_symbolic::{Graph, Id, Program};

thread_local! {
    /// One work space per thread, for all models. A function never runs inside another one.
    static SCRATCH: RefCell<Scratch<f64>> = RefCell::new(Scratch::new());
    /// The same for several nodes at once.
    static LANES: RefCell<Scratch<Lane>> = RefCell::new(Scratch::new());
}

/// Arguments in the order of the variables.
const PARTS: [&str; 6] = ["q", "v", "a", "u", "p", "lambda"];

/// Outputs as functions of q, v, a, u, p and λ.
#[derive(Debug, Clone)]
pub(crate) struct Function {
    program: Program,
    /// The variables of each part that is read.
    parts: [Option<Range<usize>>; 6],
}

impl Function {
    /// Of a model: one multiplier per equation.
    pub(crate) fn new(g: &Graph, dims: Dims, outputs: &[Id]) -> Self {
        Self::with_multipliers(g, dims, dims.nq, outputs)
    }

    /// With so many multipliers, numbered after z.
    pub(crate) fn with_multipliers(
        g: &Graph,
        dims: Dims,
        multipliers: usize,
        outputs: &[Id],
    ) -> Self {
        let program = Program::new(g, outputs);
        let mut next = 0;
        let parts = [dims.nq, dims.nq, dims.nq, dims.nu, dims.np, multipliers].map(|len| {
            let range = next..next + len;
            next += len;
            program.reads(range.clone()).then_some(range)
        });
        Self { program, parts }
    }

    /// Writes the outputs to the slices of `out`, one after the other.
    ///
    /// # Panics
    /// If a part that is read, or `out`, has another length than the model says.
    pub(crate) fn eval<const N: usize>(&self, at: &At<'_>, lambda: &[f64], out: [&mut [f64]; N]) {
        let fill = |vars: &mut [f64]| {
            let given = [at.q, at.v, at.a, at.u, at.p, lambda];
            for ((part, given), name) in self.parts.iter().zip(given).zip(PARTS) {
                write(vars, part.as_ref(), given, name, |x| x);
            }
        };
        SCRATCH.with_borrow_mut(|scratch| self.program.eval(scratch, fill, out));
    }

    /// As [`eval`](Self::eval) at four nodes.
    pub(crate) fn eval_lanes<const N: usize>(
        &self,
        at: &LanesAt<'_>,
        lambda: &[Lane],
        out: [&mut [Lane]; N],
    ) {
        let fill = |vars: &mut [Lane]| {
            let [q, v, a, u, p, l] = self.parts.each_ref().map(Option::as_ref);
            let lanes = [(q, at.q), (v, at.v), (a, at.a), (u, at.u), (l, lambda)];
            for ((part, given), name) in lanes.into_iter().zip(["q", "v", "a", "u", "lambda"]) {
                write(vars, part, given, name, |x| x);
            }
            write(vars, p, at.p, "p", |x| [x; pid_runtime::lanes::LANES]);
        };
        LANES.with_borrow_mut(|scratch| self.program.eval_lanes(scratch, fill, out));
    }

    /// Instructions, runs of equal ones, and slots.
    pub(crate) fn size(&self) -> (usize, usize, usize) {
        let (instructions, runs) = self.program.instructions();
        (instructions, runs, self.program.slots())
    }
}

/// Writes a part that is read to its variables. Variables after the last one that is read have no place.
fn write<X: Copy, T>(
    vars: &mut [T],
    part: Option<&Range<usize>>,
    given: &[X],
    name: &str,
    f: impl Fn(X) -> T,
) {
    let Some(part) = part else { return };
    if given.len() != part.len() {
        wrong_length(name, part.len(), given.len());
    }
    let end = part.end.min(vars.len());
    for (var, &x) in vars[part.start..end].iter_mut().zip(given) {
        *var = f(x);
    }
}

#[cold]
#[inline(never)]
fn wrong_length(name: &str, expected: usize, found: usize) -> ! {
    panic!("`{name}` must have {expected} entries, the dimensions of the model, but has {found}")
}
