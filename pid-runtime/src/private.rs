//! Functions that generated code calls. Not part of the public interface: they may change with any
//! release.

#[cfg(feature = "std")]
use num_dual::DualNum;

#[cfg(feature = "std")]
pub use crate::lanes::one_by_one;
#[cfg(feature = "std")]
pub use fearless_simd;

#[cfg(all(feature = "std", target_arch = "x86_64"))]
pub use crate::lanes::avx2;
#[cfg(all(feature = "std", target_arch = "x86_64"))]
pub use pid_lanes::kernel::avx2 as level;

/// Functions of numbers, without `std`.
#[cfg(not(feature = "std"))]
pub mod real {
    pub use libm::{
        atan, cos, exp, fabs as abs, log as ln, sin, sincos as sin_cos, sqrt, tan, tanh,
    };
}

/// −1, 0 or 1; NaN for NaN.
#[inline]
pub fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

/// The sign of a dual number; its derivative is zero.
#[inline]
#[cfg(feature = "std")]
pub fn dual_sign<D: DualNum<Primitive = f64> + Copy>(x: D) -> D {
    D::from(sign(x.re()))
}

/// The absolute value of a dual number; at zero its derivative is 1.
#[inline]
#[cfg(feature = "std")]
pub fn dual_abs<D: DualNum<Primitive = f64> + Copy>(x: D) -> D {
    if x.re() < 0.0 { -x } else { x }
}

/// The hyperbolic tangent of a dual number, `tanh |x| = −m / (m + 2)` with `m = e^(−2|x|) − 1`.
///
/// Finite, and exact in its derivatives, for every argument: the quotient of `sinh` and `cosh` is
/// NaN beyond |x| = 710, which is where dry friction `tanh(50 v)` is evaluated.
#[inline]
#[cfg(feature = "std")]
pub fn dual_tanh<D: DualNum<Primitive = f64> + Copy>(x: D) -> D {
    if x.re().abs() < 0.5 {
        // Near zero m + 2 would cancel in the second derivative.
        return x.sinh() / x.cosh();
    }
    let negative = x.re() < 0.0;
    let m = if negative { x * 2.0 } else { x * -2.0 }.exp_m1();
    let t = m / (m + 2.0);
    if negative { t } else { -t }
}

/// Checks that a slice has the length that the model states.
///
/// # Panics
/// If it has another length.
#[inline]
#[cfg(feature = "std")]
pub fn exact<'a, T, const N: usize>(slice: &'a [T], name: &str) -> &'a [T; N] {
    match slice.try_into() {
        Ok(array) => array,
        Err(_) => wrong_length(name, N, slice.len()),
    }
}

/// As [`exact`], mutable.
///
/// # Panics
/// If it has another length.
#[inline]
#[cfg(feature = "std")]
pub fn exact_mut<'a, T, const N: usize>(slice: &'a mut [T], name: &str) -> &'a mut [T; N] {
    let found = slice.len();
    match slice.try_into() {
        Ok(array) => array,
        Err(_) => wrong_length(name, N, found),
    }
}

#[cold]
#[inline(never)]
#[cfg(feature = "std")]
fn wrong_length(name: &str, expected: usize, found: usize) -> ! {
    panic!("`{name}` must have {expected} entries, the dimensions of the model, but has {found}")
}

/// A symmetric matrix from its lower triangle, row by row.
#[inline]
pub fn symmetric<const N: usize>(packed: &[f64]) -> [[f64; N]; N] {
    core::array::from_fn(|i| {
        core::array::from_fn(|j| {
            let (row, col) = (i.max(j), i.min(j));
            packed[row * (row + 1) / 2 + col]
        })
    })
}

#[cfg(all(test, feature = "std"))]
mod tests {
    use super::*;
    use num_dual::HyperDual64;

    #[test]
    fn tanh_agrees_with_its_closed_derivatives_and_never_overflows() {
        for x in [
            -2000.0, -30.0, -3.0, -0.1, -1e-9, 0.0, 1e-9, 0.7, 5.0, 25.0, 800.0_f64,
        ] {
            let y = dual_tanh(HyperDual64::new(x, 1.0, 1.0, 0.0));
            let cosh = x.cosh();
            let (first, second) = (1.0 / (cosh * cosh), -2.0 * x.tanh() / (cosh * cosh));
            for (found, expected) in [
                (y.re, x.tanh()),
                (y.eps1, first),
                (y.eps2, first),
                (y.eps1eps2, second),
            ] {
                assert!(
                    (found - expected).abs() <= 4e-15 * expected.abs(),
                    "x = {x}: {found} for {expected}"
                );
            }
        }
    }

    #[test]
    #[should_panic(expected = "`q` must have 2 entries, the dimensions of the model, but has 3")]
    fn wrong_length_names_the_argument() {
        let _: &[f64; 2] = exact(&[0.0; 3], "q");
    }
}
