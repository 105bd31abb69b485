//! The inner loop, compiled for AVX2 with FMA beside the portable form and chosen at run time.

use multiversion::multiversion;

use crate::effect::{Commands, Pick};
use crate::simulate::{Machine, State};

/// One substep, see [`Machine::step`]; everything generic that it calls is compiled into it.
#[multiversion(targets("x86_64+avx2+fma"))]
pub(crate) fn step<D: Pick>(
    machine: &mut Machine<'_, D>,
    state: &mut State<D>,
    commands: &[Commands<'_>],
    links: Option<f64>,
) {
    machine.advance(state, commands, links);
}
