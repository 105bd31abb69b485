//! Places of values in the work space: variables, constants, then intermediate values, whose places
//! are used again.

use super::Leaves;
use super::select::Instruction;
use crate::graph::Graph;
use crate::node::Id;

/// Slots of all instructions.
#[derive(Debug)]
pub(super) struct Layout {
    /// Per instruction: the operands, then the result.
    pub(super) args: Vec<u32>,
    pub(super) outputs: Vec<u32>,
    pub(super) size: usize,
}

/// Gives every value a slot; values that are outputs keep theirs.
pub(super) fn assign(
    g: &Graph,
    leaves: &Leaves,
    instructions: &[Instruction],
    outputs: &[Id],
) -> Layout {
    const NEVER: usize = usize::MAX;
    let mut last = vec![0; g.len()];
    for (k, instruction) in instructions.iter().enumerate() {
        for operand in instruction.operands() {
            last[operand.index()] = k;
        }
    }
    for output in outputs {
        last[output.index()] = NEVER;
    }

    let mut slot = vec![u32::MAX; g.len()];
    let mut free = Vec::new();
    let mut size = leaves.count();
    let mut args = Vec::new();
    for (k, instruction) in instructions.iter().enumerate() {
        for &operand in instruction.operands() {
            let of = leaves
                .slot(g, operand)
                .unwrap_or_else(|| slot[operand.index()]);
            args.push(of);
        }
        for &operand in instruction.operands() {
            let of = &mut slot[operand.index()];
            if last[operand.index()] == k && *of != u32::MAX {
                free.push(*of);
                // An operand that occurs twice is released once.
                *of = u32::MAX;
            }
        }
        let result = free.pop().unwrap_or_else(|| {
            size += 1;
            u32::try_from(size - 1)
                .expect("fewer slots than nodes, of which there are fewer than 2³²")
        });
        slot[instruction.result.index()] = result;
        args.push(result);
    }
    let outputs = outputs
        .iter()
        .map(|&id| leaves.slot(g, id).unwrap_or_else(|| slot[id.index()]))
        .collect();
    Layout {
        args,
        outputs,
        size,
    }
}
