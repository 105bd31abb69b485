//! The two inner loops of a substep for lanes of derivatives, compiled for AVX2 with FMA beside the portable form and chosen at
//! run time. The bodies are the generic functions of [`rigid`](crate::rigid) and [`simulate`](crate::simulate).

use multiversion::multiversion;

use crate::effect::Wide;
use crate::rigid::{self, Body, Hinge, Surroundings, Workspace};
use crate::simulate;

/// [`rigid::mass_and_bias`] over lanes.
#[multiversion(targets("x86_64+avx2+fma"))]
#[allow(
    clippy::too_many_arguments,
    reason = "the generic function takes a pair, which the attribute cannot pass on"
)]
pub(crate) fn mass_and_bias(
    hinges: &[Hinge],
    bodies: &[Body<Wide>],
    around: &Surroundings<Wide>,
    q: &[Wide],
    v: &[Wide],
    work: &mut Workspace<Wide>,
    mass: &mut [Wide],
    bias: &mut [Wide],
) {
    rigid::mass_and_bias(hinges, bodies, around, (q, v), work, mass, bias);
}

/// Solution of the rows that move, over lanes.
#[multiversion(targets("x86_64+avx2+fma"))]
pub(crate) fn reduced(
    m: usize,
    a: &[Wide],
    b: &[Wide],
    status: &[i8],
    l: &mut [Wide],
    x: &mut [Wide],
) {
    simulate::reduced(m, a, b, status, l, x);
}
