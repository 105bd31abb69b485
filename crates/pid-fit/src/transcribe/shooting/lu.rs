//! Small dense LU factorization with row pivoting, for several right-hand sides and for the transpose.

/// Factors `a` (n × n, row by row) in place; `false` if a pivot is zero or not finite.
pub(super) fn factor(a: &mut [f64], n: usize, pivots: &mut [usize]) -> bool {
    for k in 0..n {
        let (mut best, mut row) = (a[k * n + k].abs(), k);
        for i in k + 1..n {
            if a[i * n + k].abs() > best {
                (best, row) = (a[i * n + k].abs(), i);
            }
        }
        if best == 0.0 || !best.is_finite() {
            return false;
        }
        pivots[k] = row;
        if row != k {
            for j in 0..n {
                a.swap(k * n + j, row * n + j);
            }
        }
        let inverse = 1.0 / a[k * n + k];
        for i in k + 1..n {
            let l = a[i * n + k] * inverse;
            a[i * n + k] = l;
            if l != 0.0 {
                for j in k + 1..n {
                    a[i * n + j] -= l * a[k * n + j];
                }
            }
        }
    }
    true
}

/// `row_i −= factor · row_k` of rows of length `w`.
fn eliminate(r: &mut [f64], w: usize, i: usize, k: usize, factor: f64) {
    if factor == 0.0 {
        return;
    }
    let (low, high) = (i.min(k), i.max(k));
    let (head, tail) = r.split_at_mut(high * w);
    let (low, high) = (&mut head[low * w..(low + 1) * w], &mut tail[..w]);
    let (target, source) = if i < k { (low, &*high) } else { (high, &*low) };
    for (t, s) in target.iter_mut().zip(source) {
        *t -= factor * s;
    }
}

/// Solves `A X = R` in place for the n rows of R, each of length `w`.
pub(super) fn solve(lu: &[f64], n: usize, pivots: &[usize], r: &mut [f64], w: usize) {
    for (k, &p) in pivots.iter().enumerate().take(n) {
        if p != k {
            let (a, b) = r.split_at_mut(p * w);
            a[k * w..(k + 1) * w].swap_with_slice(&mut b[..w]);
        }
    }
    for k in 0..n {
        for i in k + 1..n {
            eliminate(r, w, i, k, lu[i * n + k]);
        }
    }
    for k in (0..n).rev() {
        for j in k + 1..n {
            eliminate(r, w, k, j, lu[k * n + j]);
        }
        let inverse = 1.0 / lu[k * n + k];
        r[k * w..(k + 1) * w].iter_mut().for_each(|v| *v *= inverse);
    }
}

/// Solves `Aᵀ x = r` in place.
pub(super) fn solve_transpose(lu: &[f64], n: usize, pivots: &[usize], r: &mut [f64]) {
    for k in 0..n {
        for i in 0..k {
            r[k] -= lu[i * n + k] * r[i];
        }
        r[k] /= lu[k * n + k];
    }
    for k in (0..n).rev() {
        for i in k + 1..n {
            r[k] -= lu[i * n + k] * r[i];
        }
    }
    for k in (0..n).rev() {
        r.swap(k, pivots[k]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_solves_satisfy_their_equations() {
        let n = 5;
        // Zeros on the diagonal of a matrix that is not singular: the rows have to be exchanged.
        let entry = |i: usize, j: usize| {
            if i == j {
                0.0
            } else {
                (1 + (3 * i + 5 * j) % 7) as f64
            }
        };
        let a: Vec<f64> = (0..n * n).map(|k| entry(k / n, k % n)).collect();
        let mut lu = a.clone();
        let mut pivots = vec![0; n];
        assert!(factor(&mut lu, n, &mut pivots));
        let rhs: Vec<f64> = (0..2 * n).map(|k| (k as f64).sin()).collect();
        let mut x = rhs.clone();
        solve(&lu, n, &pivots, &mut x, 2);
        for i in 0..n {
            for c in 0..2 {
                let left: f64 = (0..n).map(|j| a[i * n + j] * x[2 * j + c]).sum();
                assert!((left - rhs[2 * i + c]).abs() < 1e-12);
            }
        }
        let mut y = rhs[..n].to_vec();
        solve_transpose(&lu, n, &pivots, &mut y);
        for j in 0..n {
            let left: f64 = (0..n).map(|i| a[i * n + j] * y[i]).sum();
            assert!((left - rhs[j]).abs() < 1e-12);
        }
        assert!(!factor(&mut [1.0, 2.0, 2.0, 4.0], 2, &mut [0, 0]));
    }
}
