//! Vectors of four numbers for loops over [`Lane`]s, for what the processor can do when the program runs.

#[doc(hidden)]
pub use fearless_simd;
pub use fearless_simd::{Level, Simd, SimdBase, SimdFloat, SimdFrom, f64x4};

use crate::Lane;

/// Environment variable that is read once: with the value `portable`, a program does what it would do on a processor
/// of its architecture without extensions. Results then agree to rounding with those of the widest vectors.
pub const VARIABLE: &str = "PID_LANES";

/// Proof of AVX2 with FMA, where the processor has them and [`VARIABLE`] does not forbid their use.
#[cfg(target_arch = "x86_64")]
#[inline]
pub fn avx2() -> Option<fearless_simd::Avx2> {
    static FOUND: std::sync::OnceLock<Option<fearless_simd::Avx2>> = std::sync::OnceLock::new();
    *FOUND.get_or_init(|| {
        let portable = std::env::var_os(VARIABLE).is_some_and(|value| value == "portable");
        if portable {
            None
        } else {
            Level::new().as_avx2()
        }
    })
}

/// Runs an expression over the token `$simd` for AVX2 with FMA where [`avx2`] has them, for the baseline elsewhere.
/// The functions it calls are generic over [`Simd`] and `#[inline(always)]`.
#[macro_export]
macro_rules! widest {
    ($simd:ident => $work:expr) => {{
        #[cfg(target_arch = "x86_64")]
        {
            if let Some($simd) = $crate::kernel::avx2() {
                $crate::kernel::Simd::vectorize(
                    $simd,
                    #[inline(always)]
                    || $work,
                )
            } else if let Some($simd) = $crate::kernel::Level::new().as_sse2() {
                $crate::kernel::Simd::vectorize(
                    $simd,
                    #[inline(always)]
                    || $work,
                )
            } else {
                unreachable!("SSE2 is part of x86-64")
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        {
            $crate::kernel::fearless_simd::dispatch!($crate::kernel::Level::new(), $simd => $work)
        }
    }};
}
#[doc(inline)]
pub use crate::widest;

/// Vector of a lane.
#[inline(always)]
pub fn load<S: Simd>(simd: S, x: &Lane) -> f64x4<S> {
    f64x4::simd_from(simd, *x)
}

/// Vector of four equal numbers.
#[inline(always)]
pub fn all<S: Simd>(simd: S, x: f64) -> f64x4<S> {
    f64x4::splat(simd, x)
}

/// `y += a x`, number by number.
#[inline(always)]
pub fn axpy<S: Simd>(simd: S, a: f64x4<S>, x: &[Lane], y: &mut [Lane]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y = a.mul_add(load(simd, x), load(simd, y)).into();
    }
}

/// `y += a x + b z`, number by number.
#[inline(always)]
pub fn axpy2<S: Simd>(
    simd: S,
    (a, x): (f64x4<S>, &[Lane]),
    (b, z): (f64x4<S>, &[Lane]),
    y: &mut [Lane],
) {
    for ((y, x), z) in y.iter_mut().zip(x).zip(z) {
        let sum = a.mul_add(load(simd, x), load(simd, y));
        *y = b.mul_add(load(simd, z), sum).into();
    }
}

/// Writes lanes as four (or `count`) runs of numbers one after another.
#[inline(always)]
pub fn unpack<S: Simd>(simd: S, lanes: &[Lane], count: usize, out: &mut [f64]) {
    let size = lanes.len();
    if count == super::LANES {
        let (a, rest) = out.split_at_mut(size);
        let (b, rest) = rest.split_at_mut(size);
        let (c, d) = rest.split_at_mut(size);
        let mut blocks = lanes.chunks_exact(super::LANES);
        let whole = size - size % super::LANES;
        let mut k = 0;
        for block in &mut blocks {
            let [x, y, z, w] = [0, 1, 2, 3].map(|i| load(simd, &block[i]));
            let (xz, yw) = (x.interleave(z), y.interleave(w));
            let (first, second) = (xz.0.interleave(yw.0), xz.1.interleave(yw.1));
            a[k..k + 4].copy_from_slice(&<Lane>::from(first.0));
            b[k..k + 4].copy_from_slice(&<Lane>::from(first.1));
            c[k..k + 4].copy_from_slice(&<Lane>::from(second.0));
            d[k..k + 4].copy_from_slice(&<Lane>::from(second.1));
            k += 4;
        }
        for k in whole..size {
            (a[k], b[k], c[k], d[k]) = (lanes[k][0], lanes[k][1], lanes[k][2], lanes[k][3]);
        }
        return;
    }
    for (lane, out) in out.chunks_exact_mut(size.max(1)).take(count).enumerate() {
        for (out, x) in out.iter_mut().zip(lanes) {
            *out = x[lane];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unpacking_transposes() {
        for size in [0, 1, 4, 7, 8] {
            let lanes: Vec<Lane> = (0..size)
                .map(|k| [0, 1, 2, 3].map(|l| f64::from(100 * l + k)))
                .collect();
            for count in 1..=4 {
                let mut out = vec![f64::NAN; count * lanes.len()];
                widest!(simd => unpack(simd, &lanes, count, &mut out));
                for (at, x) in out.iter().enumerate() {
                    let (l, k) = (at / lanes.len(), at % lanes.len());
                    assert_eq!(*x, (100 * l + k) as f64);
                }
            }
        }
    }
}
