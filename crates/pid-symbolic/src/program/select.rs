//! Chooses the instructions that compute a list of outputs, and their order: fusion, then runs of
//! one kind.

use std::collections::BTreeMap;

use super::Op;
use crate::graph::Graph;
use crate::node::{Id, Node};

/// Operations within which the order may change. Larger windows give longer runs and keep more values alive.
const WINDOW: usize = 1024;

/// One operation on values that were computed before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Instruction {
    pub(super) op: Op,
    operands: [Id; 4],
    pub(super) result: Id,
}

impl Instruction {
    fn new(op: Op, operands: &[Id], result: Id) -> Self {
        let mut all = [result; 4];
        all[..operands.len()].copy_from_slice(operands);
        Self {
            op,
            operands: all,
            result,
        }
    }

    pub(super) fn operands(&self) -> &[Id] {
        &self.operands[..self.op.arity()]
    }
}

/// The instructions for the operations of `order`, fused and sorted into runs.
pub(super) fn instructions(g: &Graph, order: &[Id], outputs: &[Id]) -> Vec<Instruction> {
    let fused = fuse(g, order, outputs);
    let mut sorted = Vec::with_capacity(fused.len());
    let mut place = vec![usize::MAX; g.len()];
    for (start, window) in (0..).step_by(WINDOW).zip(fused.chunks(WINDOW)) {
        for (k, instruction) in window.iter().enumerate() {
            place[instruction.result.index()] = start + k;
        }
        sort(window, start, &place, &mut sorted);
    }
    sorted
}

/// Products that are used once go into the sum, difference or product that uses them; the order of
/// the rest stays.
fn fuse(g: &Graph, order: &[Id], outputs: &[Id]) -> Vec<Instruction> {
    let mut uses = vec![0_u32; g.len()];
    for id in order
        .iter()
        .flat_map(|&id| g.node(id).operands())
        .chain(outputs.iter().copied())
    {
        uses[id.index()] += 1;
    }
    let mut absorbed = vec![false; g.len()];
    let mut instructions = Vec::with_capacity(order.len());
    // Results first, so that a product already taken is known when its own operands are looked at.
    for &id in order.iter().rev() {
        if absorbed[id.index()] {
            continue;
        }
        let mut take = |x: Id| match g.node(x) {
            Node::Mul(a, b) if uses[x.index()] == 1 => {
                absorbed[x.index()] = true;
                Some((a, b))
            }
            _ => None,
        };
        let (op, operands): (Op, &[Id]) = match g.node(id) {
            Node::Const(_) | Node::Var(_) => unreachable!("leaves are not scheduled"),
            Node::Neg(x) => (Op::Neg, &[x]),
            Node::Div(x, y) => (Op::Div, &[x, y]),
            Node::Powi(x, n) => (Op::Powi(n), &[x]),
            Node::Call(f, x) => (Op::Call(f), &[x]),
            Node::Add(x, y) => match (take(x), take(y)) {
                (Some((a, b)), Some((c, d))) => (Op::MulAddMul, &[a, b, c, d]),
                (Some((a, b)), None) => (Op::MulAdd, &[a, b, y]),
                // Sums commute bit by bit.
                (None, Some((a, b))) => (Op::MulAdd, &[a, b, x]),
                (None, None) => (Op::Add, &[x, y]),
            },
            Node::Sub(x, y) => match (take(x), take(y)) {
                (Some((a, b)), Some((c, d))) => (Op::MulSubMul, &[a, b, c, d]),
                (Some((a, b)), None) => (Op::MulSub, &[a, b, y]),
                (None, Some((b, c))) => (Op::SubMul, &[x, b, c]),
                (None, None) => (Op::Sub, &[x, y]),
            },
            Node::Mul(x, y) => match take(x) {
                Some((a, b)) => (Op::MulMul, &[a, b, y]),
                None => match take(y) {
                    Some((a, b)) => (Op::MulMul, &[a, b, x]),
                    None => (Op::Mul, &[x, y]),
                },
            },
        };
        instructions.push(Instruction::new(op, operands, id));
    }
    instructions.reverse();
    instructions
}

/// Appends a window in an order with long runs: of the operations whose operands are known, it
/// always takes the most frequent kind.
fn sort(window: &[Instruction], start: usize, place: &[usize], sorted: &mut Vec<Instruction>) {
    // Operations of the window that wait for each operation, and how many each waits for.
    let mut waiting: Vec<Vec<usize>> = vec![Vec::new(); window.len()];
    let mut missing = vec![0_u32; window.len()];
    let mut ready: BTreeMap<Op, Vec<usize>> = BTreeMap::new();
    for (k, instruction) in window.iter().enumerate() {
        for operand in instruction.operands() {
            let of = place[operand.index()];
            if of != usize::MAX && of >= start {
                waiting[of - start].push(k);
                missing[k] += 1;
            }
        }
        if missing[k] == 0 {
            ready.entry(instruction.op).or_default().push(k);
        }
    }
    while let Some((&op, _)) = ready
        .iter()
        .max_by_key(|(op, list)| (list.len(), std::cmp::Reverse(**op)))
    {
        let mut list = ready.remove(&op).unwrap_or_default();
        let mut next = 0;
        while next < list.len() {
            let k = list[next];
            next += 1;
            sorted.push(window[k]);
            for &waits in &waiting[k] {
                missing[waits] -= 1;
                if missing[waits] == 0 {
                    if window[waits].op == op {
                        list.push(waits);
                    } else {
                        ready.entry(window[waits].op).or_default().push(waits);
                    }
                }
            }
        }
    }
}
