//! An interpreter: outputs of a graph as a compact tape, evaluated over any scalar.
//!
//! The tape evaluates models that are not compiled, and is the oracle of those that are. A register
//! is reused as soon as its value is dead, so that large tapes stay in cache.

use num_dual::DualNum;

use crate::graph::Graph;
use crate::node::{Function, Id, Node};
use crate::schedule;

/// Points evaluated at once by [`Tape::eval_batch`].
const LANES: usize = 8;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Step {
    Const(f64),
    Var(u32),
    Neg(u32),
    Add(u32, u32),
    Sub(u32, u32),
    Mul(u32, u32),
    Div(u32, u32),
    Powi(u32, i32),
    Call(Function, u32),
    Output(u32, u32),
}

/// Outputs of a graph, ready to be evaluated.
#[derive(Debug, Clone, PartialEq)]
pub struct Tape {
    /// Operation and the register of its result (unused for outputs).
    steps: Vec<(Step, u32)>,
    registers: usize,
    vars: usize,
    outputs: usize,
}

impl Tape {
    /// The tape of `outputs`, in their order.
    pub fn new(g: &Graph, outputs: &[Id]) -> Self {
        let mut builder = Builder {
            steps: Vec::new(),
            register: vec![u32::MAX; g.len()],
            uses: vec![0; g.len()],
            free: Vec::new(),
            registers: 0,
            vars: 0,
        };
        let order = schedule::order(g, outputs);
        for id in order
            .iter()
            .flat_map(|&id| g.node(id).operands())
            .chain(outputs.iter().copied())
        {
            builder.uses[id.index()] += 1;
        }
        let mut positions: Vec<usize> = (0..outputs.len()).collect();
        positions.sort_by_key(|&k| outputs[k]);
        let write = |builder: &mut Builder, id: Id| {
            let first = positions.partition_point(|&k| outputs[k] < id);
            for &k in positions[first..].iter().take_while(|&&k| outputs[k] == id) {
                let register = builder.operand(g, id);
                builder.steps.push((Step::Output(register, k as u32), 0));
                builder.release(id);
            }
        };
        for &id in &order {
            builder.operation(g, id);
            write(&mut builder, id);
        }
        let mut leaves: Vec<Id> = outputs
            .iter()
            .copied()
            .filter(|&id| g.node(id).is_leaf())
            .collect();
        leaves.sort_unstable();
        leaves.dedup();
        for id in leaves {
            write(&mut builder, id);
        }
        Self {
            steps: builder.steps,
            registers: builder.registers,
            vars: builder.vars,
            outputs: outputs.len(),
        }
    }

    /// Number of variables read: one more than the highest variable number.
    pub fn vars(&self) -> usize {
        self.vars
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// The outputs at `vars`, over any scalar; `f64` is one.
    ///
    /// # Panics
    /// If `vars` is shorter than [`vars`](Self::vars) or `out` shorter than [`outputs`](Self::outputs).
    pub fn eval<D: DualNum<Primitive = f64> + Copy>(&self, vars: &[D], out: &mut [D]) {
        self.eval_with(vars, out, &mut Vec::new());
    }

    /// As [`eval`](Self::eval), with a workspace that may be used again.
    pub fn eval_with<D: DualNum<Primitive = f64> + Copy>(
        &self,
        vars: &[D],
        out: &mut [D],
        work: &mut Vec<D>,
    ) {
        work.clear();
        work.resize(self.registers, D::from(0.0));
        for &(step, result) in &self.steps {
            let at = |register: u32| work[register as usize];
            let value = match step {
                Step::Const(c) => D::from(c),
                Step::Var(i) => vars[i as usize],
                Step::Neg(x) => -at(x),
                Step::Add(x, y) => at(x) + at(y),
                Step::Sub(x, y) => at(x) - at(y),
                Step::Mul(x, y) => at(x) * at(y),
                Step::Div(x, y) => at(x) / at(y),
                Step::Powi(x, n) => at(x).powi(n),
                Step::Call(f, x) => call(f, at(x)),
                Step::Output(x, k) => {
                    out[k as usize] = at(x);
                    continue;
                }
            };
            work[result as usize] = value;
        }
    }

    /// The outputs at `points` points. Variables and outputs are stored one after the other with
    /// all their points: `vars[i * points + k]` is variable `i` at point `k`.
    ///
    /// # Panics
    /// If the slices are shorter than `vars() * points` and `outputs() * points`.
    pub fn eval_batch(&self, points: usize, vars: &[f64], out: &mut [f64]) {
        let mut work = vec![[0.0; LANES]; self.registers];
        for start in (0..points).step_by(LANES) {
            let width = LANES.min(points - start);
            for &(step, result) in &self.steps {
                let at = |register: u32| work[register as usize];
                let value = match step {
                    Step::Const(c) => [c; LANES],
                    Step::Var(i) => {
                        let first = i as usize * points + start;
                        let mut lanes = [0.0; LANES];
                        lanes[..width].copy_from_slice(&vars[first..first + width]);
                        lanes
                    }
                    Step::Neg(x) => at(x).map(|x| -x),
                    Step::Add(x, y) => zip(at(x), at(y), |x, y| x + y),
                    Step::Sub(x, y) => zip(at(x), at(y), |x, y| x - y),
                    Step::Mul(x, y) => zip(at(x), at(y), |x, y| x * y),
                    Step::Div(x, y) => zip(at(x), at(y), |x, y| x / y),
                    Step::Powi(x, n) => at(x).map(|x| x.powi(n)),
                    Step::Call(f, x) => at(x).map(|x| f.apply(x)),
                    Step::Output(x, k) => {
                        let first = k as usize * points + start;
                        out[first..first + width].copy_from_slice(&at(x)[..width]);
                        continue;
                    }
                };
                work[result as usize] = value;
            }
        }
    }
}

fn zip(x: [f64; LANES], y: [f64; LANES], f: impl Fn(f64, f64) -> f64) -> [f64; LANES] {
    std::array::from_fn(|k| f(x[k], y[k]))
}

/// A function of a dual number.
pub(crate) fn call<D: DualNum<Primitive = f64> + Copy>(f: Function, x: D) -> D {
    match f {
        Function::Sin => x.sin(),
        Function::Cos => x.cos(),
        Function::Tan => x.tan(),
        Function::Tanh => tanh(x),
        Function::Atan => x.atan(),
        Function::Exp => x.exp(),
        Function::Ln => x.ln(),
        Function::Sqrt => x.sqrt(),
        Function::Abs => {
            if x.re() < 0.0 {
                -x
            } else {
                x
            }
        }
        Function::Sign => D::from(crate::node::sign(x.re())),
    }
}

/// `tanh |x| = −m / (m + 2)` with `m = e^(−2|x|) − 1`: finite for every argument, with full
/// relative precision in its derivatives. The quotient of `sinh` and `cosh` overflows beyond |x| =
/// 710.
fn tanh<D: DualNum<Primitive = f64> + Copy>(x: D) -> D {
    if D::NDERIV == 0 {
        return x.tanh();
    }
    let negative = x.re() < 0.0;
    let m = if negative { x * 2.0 } else { x * -2.0 }.exp_m1();
    let t = m / (m + 2.0);
    if negative { t } else { -t }
}

struct Builder {
    steps: Vec<(Step, u32)>,
    register: Vec<u32>,
    uses: Vec<u32>,
    free: Vec<u32>,
    registers: usize,
    vars: usize,
}

impl Builder {
    fn allocate(&mut self) -> u32 {
        self.free.pop().unwrap_or_else(|| {
            self.registers += 1;
            (self.registers - 1) as u32
        })
    }

    /// The register of an operand; constants and variables are loaded when first used.
    fn operand(&mut self, g: &Graph, id: Id) -> u32 {
        if self.register[id.index()] == u32::MAX {
            let step = match g.node(id) {
                Node::Const(c) => Step::Const(c.value()),
                Node::Var(i) => {
                    self.vars = self.vars.max(i as usize + 1);
                    Step::Var(i)
                }
                _ => unreachable!("operations come after their operands"),
            };
            let register = self.allocate();
            self.steps.push((step, register));
            self.register[id.index()] = register;
        }
        self.register[id.index()]
    }

    fn release(&mut self, id: Id) {
        self.uses[id.index()] -= 1;
        if self.uses[id.index()] == 0 {
            self.free.push(self.register[id.index()]);
        }
    }

    fn operation(&mut self, g: &Graph, id: Id) {
        let step = match g.node(id) {
            Node::Const(_) | Node::Var(_) => unreachable!("leaves are not scheduled"),
            Node::Neg(x) => Step::Neg(self.operand(g, x)),
            Node::Add(x, y) => Step::Add(self.operand(g, x), self.operand(g, y)),
            Node::Sub(x, y) => Step::Sub(self.operand(g, x), self.operand(g, y)),
            Node::Mul(x, y) => Step::Mul(self.operand(g, x), self.operand(g, y)),
            Node::Div(x, y) => Step::Div(self.operand(g, x), self.operand(g, y)),
            Node::Powi(x, n) => Step::Powi(self.operand(g, x), n),
            Node::Call(f, x) => Step::Call(f, self.operand(g, x)),
        };
        for operand in g.node(id).operands() {
            self.release(operand);
        }
        let register = self.allocate();
        self.steps.push((step, register));
        self.register[id.index()] = register;
    }
}
