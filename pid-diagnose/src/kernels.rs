//! The two inner loops of a substep for lanes of derivatives, compiled for AVX2 with FMA beside the portable form and chosen at
//! run time. The bodies are the generic functions of [`chain`](crate::chain) and [`simulate`](crate::simulate).

use multiversion::multiversion;

use crate::chain::{Chain, Surroundings};
use crate::effect::Wide;
use crate::simulate;

/// [`Chain::mass_and_bias`] over lanes.
#[multiversion(targets("x86_64+avx2+fma"))]
pub(crate) fn mass_and_bias(
    chain: &mut Chain<Wide>,
    around: &Surroundings<Wide>,
    q: &[Wide],
    v: &[Wide],
    mass: &mut [Wide],
    bias: &mut [Wide],
) {
    chain.mass_and_bias(around, (q, v), mass, bias);
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
