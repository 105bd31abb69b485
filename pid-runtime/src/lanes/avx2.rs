//! Functions that generated lane code calls: arithmetic on four numbers, and functions of them to
//! about 2 units in the last place.
//!
//! Everything is a safe function of vectors that requires AVX2 and FMA of its caller, checked by
//! the compiler. Arguments for which the fast path is not accurate (|x| > 10⁶ in sine and cosine,
//! infinities, NaN) take the functions of `std`. Polynomials are Taylor's: on the reduced intervals
//! the terms left out are below 1e-17.

pub use std::arch::x86_64::{
    __m256d as V, _mm256_add_pd as add, _mm256_div_pd as div, _mm256_fmadd_pd as mul_add,
    _mm256_fmsub_pd as mul_sub, _mm256_fnmadd_pd as sub_mul, _mm256_mul_pd as mul,
    _mm256_set1_pd as all, _mm256_sqrt_pd as sqrt, _mm256_sub_pd as sub,
};
use std::arch::x86_64::{
    _CMP_LE_OQ, _mm256_add_epi64, _mm256_and_pd, _mm256_andnot_pd, _mm256_blendv_pd,
    _mm256_castpd_si256, _mm256_castsi256_pd, _mm256_cmp_pd, _mm256_min_pd, _mm256_movemask_pd,
    _mm256_or_pd, _mm256_set1_epi64x, _mm256_slli_epi64, _mm256_xor_pd,
};

use super::Lane;

/// Vector of a lane.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub fn load(x: Lane) -> V {
    bytemuck::cast(x)
}

/// Lane of a vector.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub fn store(x: V) -> Lane {
    bytemuck::cast(x)
}

/// −x.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub fn neg(x: V) -> V {
    _mm256_xor_pd(x, all(-0.0))
}

/// |x|.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub fn abs(x: V) -> V {
    _mm256_andnot_pd(all(-0.0), x)
}

/// A function of one number, number by number.
#[inline]
#[target_feature(enable = "avx2,fma")]
fn each(x: V, f: fn(f64) -> f64) -> V {
    load(store(x).map(f))
}

/// −1, 0 or 1; NaN for NaN.
#[inline(never)]
#[target_feature(enable = "avx2,fma")]
pub fn sign(x: V) -> V {
    each(x, crate::__private::sign)
}

/// Tangent.
#[inline(never)]
#[target_feature(enable = "avx2,fma")]
pub fn tan(x: V) -> V {
    each(x, f64::tan)
}

/// Arc tangent.
#[inline(never)]
#[target_feature(enable = "avx2,fma")]
pub fn atan(x: V) -> V {
    each(x, f64::atan)
}

/// Natural logarithm.
#[inline(never)]
#[target_feature(enable = "avx2,fma")]
pub fn ln(x: V) -> V {
    each(x, f64::ln)
}

/// Exponential.
#[inline(never)]
#[target_feature(enable = "avx2,fma")]
pub fn exp(x: V) -> V {
    each(x, f64::exp)
}

/// c₀ + x (c₁ + x (c₂ + …)).
#[inline]
#[target_feature(enable = "avx2,fma")]
fn polynomial<const N: usize>(x: V, c: [f64; N]) -> V {
    let mut y = all(c[N - 1]);
    for k in (0..N - 1).rev() {
        y = mul_add(y, x, all(c[k]));
    }
    y
}

/// Adding 1.5 · 2⁵² to a number below 2⁵¹ rounds it to an integer, which then stands in the lowest bits.
const ROUND: f64 = 6755399441055744.0;

/// 1/k! for k = 0 … 17.
const fn inverse_factorials() -> [f64; 18] {
    let mut out = [1.0; 18];
    let mut factorial = 1.0;
    let mut k = 1;
    while k < 18 {
        factorial *= k as f64;
        out[k] = 1.0 / factorial;
        k += 1;
    }
    out
}

const F: [f64; 18] = inverse_factorials();

/// Sine and cosine.
#[inline(never)]
#[target_feature(enable = "avx2,fma")]
pub fn sin_cos(x: V) -> (V, V) {
    let small = _mm256_cmp_pd::<_CMP_LE_OQ>(abs(x), all(1e6));
    if _mm256_movemask_pd(small) != 0b1111 {
        return (each(x, f64::sin), each(x, f64::cos));
    }
    // x = n π/2 + r. The first difference is exact; the low parts of π/2 matter where r is small.
    const LOW: [f64; 2] = [6.123233995736766e-17, -1.4973849048591698e-33];
    let shifted = mul_add(x, all(std::f64::consts::FRAC_2_PI), all(ROUND));
    let n = sub(shifted, all(ROUND));
    let r = sub_mul(n, all(std::f64::consts::FRAC_PI_2), x);
    let r = sub_mul(n, all(LOW[0]), r);
    let r = sub_mul(n, all(LOW[1]), r);

    let z = mul(r, r);
    let s = polynomial(z, [-F[3], F[5], -F[7], F[9], -F[11], F[13], -F[15], F[17]]);
    let s = mul_add(mul(s, z), r, r);
    let c = polynomial(z, [F[4], -F[6], F[8], -F[10], F[12], -F[14], F[16]]);
    let half = mul(z, all(0.5));
    let w = sub(all(1.0), half);
    let lost = sub(sub(all(1.0), w), half);
    let c = add(w, mul_add(c, mul(z, z), lost));

    // n mod 4: odd swaps sine and cosine, its second bit is the sign of the sine, that of n + 1 the
    // sign of the cosine.
    let n = _mm256_castpd_si256(shifted);
    let swap = _mm256_castsi256_pd(_mm256_slli_epi64::<63>(n));
    let second = |n| _mm256_and_pd(_mm256_castsi256_pd(_mm256_slli_epi64::<62>(n)), all(-0.0));
    let next = _mm256_add_epi64(n, _mm256_set1_epi64x(1));
    (
        _mm256_xor_pd(_mm256_blendv_pd(s, c, swap), second(n)),
        _mm256_xor_pd(_mm256_blendv_pd(c, s, swap), second(next)),
    )
}

/// Sine.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub fn sin(x: V) -> V {
    sin_cos(x).0
}

/// Cosine.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub fn cos(x: V) -> V {
    sin_cos(x).1
}

/// Hyperbolic tangent, `tanh |x| = −m / (m + 2)` with `m = e^(−2|x|) − 1`.
#[inline(never)]
#[target_feature(enable = "avx2,fma")]
pub fn tanh(x: V) -> V {
    // Beyond 20 it is 1 to the last bit. NaN passes through the minimum as its second argument.
    let size = _mm256_min_pd(all(20.0), abs(x));
    let y = mul(size, all(-2.0));
    // y = n ln 2 + r with n ln 2's high part exact.
    const HIGH: f64 = 0.693_147_180_369_123_8; // ln 2 to 33 bits
    const LOW: f64 = 1.908_214_929_270_587_7e-10;
    let shifted = mul_add(y, all(std::f64::consts::LOG2_E), all(ROUND));
    let n = sub(shifted, all(ROUND));
    let r = sub_mul(n, all(HIGH), y);
    let r = sub_mul(n, all(LOW), r);
    let p = polynomial(
        r,
        [
            F[2], F[3], F[4], F[5], F[6], F[7], F[8], F[9], F[10], F[11], F[12], F[13],
        ],
    );
    let p = mul_add(mul(r, r), p, r);
    // 2ⁿ, −58 ≤ n ≤ 0, by its exponent; then m = 2ⁿ p + (2ⁿ − 1).
    let exponent = _mm256_add_epi64(_mm256_castpd_si256(shifted), _mm256_set1_epi64x(1023));
    let power = _mm256_castsi256_pd(_mm256_slli_epi64::<52>(exponent));
    let m = mul_add(power, p, sub(power, all(1.0)));
    let t = div(neg(m), add(m, all(2.0)));
    _mm256_or_pd(t, _mm256_and_pd(x, all(-0.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ulps(x: f64, y: f64) -> f64 {
        if x == y || x.is_nan() && y.is_nan() {
            return 0.0;
        }
        (x - y).abs() / (f64::EPSILON * y.abs().max(f64::MIN_POSITIVE))
    }

    /// Arguments over many scales, near the ends of the reduced intervals and where a fast path ends.
    fn arguments() -> Vec<f64> {
        let mut out = vec![
            0.0,
            -0.0,
            1e-300,
            1e-20,
            1e-9,
            1e6,
            -1e6,
            1.000001e6,
            1e15,
            1e300,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::NAN,
            20.0,
            -19.99,
            21.0,
            0.17328679513998632,
        ];
        for k in -40..=40 {
            let edge = f64::from(k) * std::f64::consts::FRAC_PI_4;
            out.extend([edge, edge.next_up(), edge.next_down(), 1e4 * edge]);
        }
        let mut x = 0.37_f64;
        for k in 0..40_000 {
            x = (x * 997.0 + 0.1).fract();
            out.push((x - 0.5) * [1e-3, 1.0, 6.0, 60.0, 1e4, 1.9e6][k % 6]);
        }
        while out.len() % 4 != 0 {
            out.push(1.0);
        }
        out
    }

    fearless_simd::kernel! {
    fn worst(level: Avx2, f: usize) -> f64 {
        let mut worst: f64 = 0.0;
        for x in arguments().chunks_exact(4) {
            let v = load(x.try_into().unwrap());
            let (found, expected): (V, fn(f64) -> f64) = match f {
                0 => (sin(v), f64::sin),
                1 => (cos(v), f64::cos),
                _ => (tanh(v), f64::tanh),
            };
            for (found, x) in store(found).into_iter().zip(x) {
                let expected = expected(*x);
                let error = ulps(found, expected);
                assert!(error <= 3.0, "f{f}({x:e}) = {found:e} for {expected:e}");
                worst = worst.max(error);
            }
        }
        worst
    }
    }

    #[test]
    fn functions_are_accurate_to_a_few_units_in_the_last_place() {
        let Some(level) = fearless_simd::Level::new().as_avx2() else {
            eprintln!("skipped: this processor has no AVX2");
            return;
        };
        assert!(worst(level, 0) <= 2.0);
        assert!(worst(level, 1) <= 2.0);
        assert!(worst(level, 2) <= 3.0);
    }
}
