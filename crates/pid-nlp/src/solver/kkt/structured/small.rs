//! LU factors of four small dense matrices at a time, each with its own row permutation.

use pid_lanes::kernel::{Simd, all, axpy, load};
use pid_lanes::{LANES, Lane};

/// Ratio of a pivot to its row below which a step Jacobian counts as singular.
pub(super) const SINGULAR: f64 = 1e-13;

/// Factorises in place, the inverse of the pivots on the diagonal. Gives the lane and the relative
/// pivot where one is singular.
#[inline(always)]
pub(super) fn lu_factor<S: Simd>(
    simd: S,
    a: &mut [Lane],
    n: usize,
    pivots: &mut [[u8; LANES]],
) -> Result<(), (usize, f64)> {
    for k in 0..n {
        for lane in 0..LANES {
            let (mut best, mut row) = (a[k * n + k][lane].abs(), k);
            for i in k + 1..n {
                if a[i * n + k][lane].abs() > best {
                    (best, row) = (a[i * n + k][lane].abs(), i);
                }
            }
            let rest = a[k * n + k..].iter();
            let scale = rest.fold(0.0_f64, |s, v| s.max(v[lane].abs()));
            let relative = if scale > 0.0 { best / scale } else { 0.0 };
            if relative.is_nan() || relative <= SINGULAR {
                return Err((lane, relative));
            }
            pivots[k][lane] = row as u8;
            if row != k {
                for j in 0..n {
                    let kept = a[k * n + j][lane];
                    a[k * n + j][lane] = a[row * n + j][lane];
                    a[row * n + j][lane] = kept;
                }
            }
        }
        let inverse = all(simd, 1.0) / load(simd, &a[k * n + k]);
        a[k * n + k] = inverse.into();
        let (above, below) = a.split_at_mut((k + 1) * n);
        for row in below.chunks_exact_mut(n) {
            let l = load(simd, &row[k]) * inverse;
            row[k] = l.into();
            axpy(simd, -l, &above[k * n + k + 1..], &mut row[k + 1..]);
        }
    }
    Ok(())
}

/// Solves `B X = R` in place for the rows of R, each of length w.
#[inline(always)]
pub(super) fn lu_solve<S: Simd>(
    simd: S,
    lu: &[Lane],
    n: usize,
    pivots: &[[u8; LANES]],
    r: &mut [Lane],
    w: usize,
) {
    for (k, rows) in pivots.iter().enumerate() {
        for (lane, p) in rows.iter().enumerate() {
            let p = *p as usize;
            if p != k {
                for j in 0..w {
                    let kept = r[k * w + j][lane];
                    r[k * w + j][lane] = r[p * w + j][lane];
                    r[p * w + j][lane] = kept;
                }
            }
        }
    }
    for i in 1..n {
        let (above, rest) = r.split_at_mut(i * w);
        for k in 0..i {
            let l = load(simd, &lu[i * n + k]);
            axpy(simd, -l, &above[k * w..(k + 1) * w], &mut rest[..w]);
        }
    }
    for k in (0..n).rev() {
        let (head, below) = r.split_at_mut((k + 1) * w);
        let row = &mut head[k * w..];
        for j in k + 1..n {
            let u = load(simd, &lu[k * n + j]);
            let at = (j - k - 1) * w;
            axpy(simd, -u, &below[at..at + w], row);
        }
        let inverse = load(simd, &lu[k * n + k]);
        for x in row {
            *x = (inverse * load(simd, x)).into();
        }
    }
}

/// Solves `Bᵀ x = r` in place.
#[inline(always)]
pub(super) fn lu_solve_transpose<S: Simd>(
    simd: S,
    lu: &[Lane],
    n: usize,
    pivots: &[[u8; LANES]],
    r: &mut [Lane],
) {
    for k in 0..n {
        let mut sum = load(simd, &r[k]);
        for i in 0..k {
            sum -= load(simd, &lu[i * n + k]) * load(simd, &r[i]);
        }
        r[k] = (sum * load(simd, &lu[k * n + k])).into();
    }
    for k in (0..n).rev() {
        let mut sum = load(simd, &r[k]);
        for i in k + 1..n {
            sum -= load(simd, &lu[i * n + k]) * load(simd, &r[i]);
        }
        r[k] = sum.into();
    }
    for k in (0..n).rev() {
        for lane in 0..LANES {
            let p = pivots[k][lane] as usize;
            if p != k {
                let kept = r[k][lane];
                r[k][lane] = r[p][lane];
                r[p][lane] = kept;
            }
        }
    }
}
