//! Order of evaluation, lifetimes of values, and splitting into blocks of bounded size.

use crate::graph::Graph;
use crate::node::{Function, Id, Node};

/// Operations needed for `outputs`, operands first, depth first along the outputs so that values
/// are used soon after they are made. Constants and variables are left out. Sine and cosine of one
/// argument stand side by side.
pub fn order(g: &Graph, outputs: &[Id]) -> Vec<Id> {
    let mut needed = vec![false; g.len()];
    for id in g.reachable(outputs) {
        needed[id.index()] = true;
    }
    let mut done = vec![false; g.len()];
    let mut order = Vec::new();
    let mut stack = Vec::new();
    for &output in outputs {
        stack.push((output, false));
        while let Some((id, operands_done)) = stack.pop() {
            let node = g.node(id);
            if done[id.index()] || node.is_leaf() {
                continue;
            }
            if operands_done {
                done[id.index()] = true;
                order.push(id);
                if let Some(twin) =
                    twin(g, node).filter(|twin| needed[twin.index()] && !done[twin.index()])
                {
                    done[twin.index()] = true;
                    order.push(twin);
                }
            } else {
                stack.push((id, true));
                let mut operands = [None; 2];
                for (place, operand) in operands.iter_mut().zip(node.operands()) {
                    *place = Some((operand, false));
                }
                // The first operand is on top.
                stack.extend(operands.into_iter().rev().flatten());
            }
        }
    }
    order
}

/// The cosine of the argument of a sine and the other way round, if the graph has it.
pub fn twin(g: &Graph, node: Node) -> Option<Id> {
    match node {
        Node::Call(Function::Sin, x) => g.find(&Node::Call(Function::Cos, x)),
        Node::Call(Function::Cos, x) => g.find(&Node::Call(Function::Sin, x)),
        _ => None,
    }
}

/// A run of operations that becomes one function.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Block {
    /// Values of earlier blocks, with the slot each is read from.
    pub loads: Vec<(Id, usize)>,
    /// Operations in order.
    pub nodes: Vec<Id>,
    /// Values for later blocks, with the slot each is kept in; written after all loads.
    pub stores: Vec<(Id, usize)>,
    /// Positions of the outputs whose values are known at the end of this block and of no earlier one.
    pub outputs: Vec<usize>,
}

/// How a list of outputs is computed: blocks to be run in turn on a common workspace.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plan {
    /// The blocks, in order; at least one.
    pub blocks: Vec<Block>,
    /// Number of slots of the workspace.
    pub slots: usize,
}

impl Plan {
    /// A plan with at most `limit` operations per block.
    pub fn new(g: &Graph, outputs: &[Id], limit: usize) -> Self {
        let order = order(g, outputs);
        let count = order.len().div_ceil(limit.max(1)).max(1);
        let size = order.len().div_ceil(count).max(1);
        let mut blocks: Vec<Block> = order
            .chunks(size)
            .map(|nodes| Block {
                nodes: nodes.to_vec(),
                ..Block::default()
            })
            .collect();
        if blocks.is_empty() {
            blocks.push(Block::default());
        }

        // Where each operation is computed, and the last block that reads it.
        let mut home = vec![None; g.len()];
        let mut last = vec![0; g.len()];
        for (b, block) in blocks.iter().enumerate() {
            for &id in &block.nodes {
                home[id.index()] = Some(b);
                last[id.index()] = b;
                for operand in g.node(id).operands() {
                    last[operand.index()] = b;
                }
            }
        }
        for (position, output) in outputs.iter().enumerate() {
            blocks[home[output.index()].unwrap_or(0)]
                .outputs
                .push(position);
        }

        let mut slot_of = vec![usize::MAX; g.len()];
        let mut free: Vec<usize> = Vec::new();
        let mut slots = 0;
        for (b, block) in blocks.iter_mut().enumerate() {
            let mut loaded = Vec::new();
            for &id in &block.nodes {
                for operand in g.node(id).operands() {
                    if home[operand.index()].is_some_and(|h| h < b) {
                        loaded.push(operand);
                    }
                }
            }
            loaded.sort_unstable();
            loaded.dedup();
            for id in loaded {
                block.loads.push((id, slot_of[id.index()]));
                if last[id.index()] == b {
                    free.push(slot_of[id.index()]);
                }
            }
            for &id in &block.nodes {
                if last[id.index()] > b {
                    let slot = free.pop().unwrap_or_else(|| {
                        slots += 1;
                        slots - 1
                    });
                    slot_of[id.index()] = slot;
                    block.stores.push((id, slot));
                }
            }
        }
        Self { blocks, slots }
    }

    /// Number of operations in all blocks.
    pub fn operations(&self) -> usize {
        self.blocks.iter().map(|block| block.nodes.len()).sum()
    }
}
