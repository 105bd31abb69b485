//! Small dense systems, in place.

/// Cholesky factorization of a packed lower triangle (row by row, `m[i (i+1)/2 + j]`), in place: M = L Lᵀ.
///
/// # Errors
/// Row and value of the first pivot that is not above `n ε max M_ii`; a NaN is one of those.
pub(super) fn cholesky(m: &mut [f64], n: usize) -> Result<(), (usize, f64)> {
    let largest = (0..n)
        .map(|i| m[i * (i + 1) / 2 + i].abs())
        .fold(0.0, f64::max);
    let floor = n as f64 * f64::EPSILON * largest;
    for i in 0..n {
        let row = i * (i + 1) / 2;
        for j in 0..=i {
            let other = j * (j + 1) / 2;
            let dot: f64 = (0..j).map(|k| m[row + k] * m[other + k]).sum();
            let rest = m[row + j] - dot;
            if j < i {
                m[row + j] = rest / m[other + j];
            } else if rest > floor {
                m[row + j] = rest.sqrt();
            } else {
                return Err((i, rest));
            }
        }
    }
    Ok(())
}

/// Solves L Lᵀ x = b in place.
pub(super) fn cholesky_solve(l: &[f64], n: usize, x: &mut [f64]) {
    for i in 0..n {
        let row = i * (i + 1) / 2;
        let dot: f64 = (0..i).map(|k| l[row + k] * x[k]).sum();
        x[i] = (x[i] - dot) / l[row + i];
    }
    for i in (0..n).rev() {
        let dot: f64 = (i + 1..n).map(|k| l[k * (k + 1) / 2 + i] * x[k]).sum();
        x[i] = (x[i] - dot) / l[i * (i + 1) / 2 + i];
    }
}

/// Solves A x = b by elimination with row pivoting; `a` (n × n, row by row) is destroyed, `b` becomes x.
/// `None` if a pivot is zero or not finite.
pub(super) fn solve(a: &mut [f64], n: usize, b: &mut [f64]) -> Option<()> {
    for k in 0..n {
        let pivot = (k..n).max_by(|i, j| a[i * n + k].abs().total_cmp(&a[j * n + k].abs()))?;
        let value = a[pivot * n + k];
        if value == 0.0 || !value.is_finite() {
            return None;
        }
        if pivot != k {
            for j in k..n {
                a.swap(k * n + j, pivot * n + j);
            }
            b.swap(k, pivot);
        }
        for i in k + 1..n {
            let factor = a[i * n + k] / value;
            if factor != 0.0 {
                for j in k + 1..n {
                    a[i * n + j] -= factor * a[k * n + j];
                }
                b[i] -= factor * b[k];
            }
        }
    }
    for k in (0..n).rev() {
        let dot: f64 = (k + 1..n).map(|j| a[k * n + j] * b[j]).sum();
        b[k] = (b[k] - dot) / a[k * n + k];
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn solutions_satisfy_their_equations(
            n in 1_usize..8,
            entries in prop::collection::vec(-1.0_f64..1.0, 64),
            rhs in prop::collection::vec(-1.0_f64..1.0, 8),
        ) {
            // M = B Bᵀ + I is positive definite.
            let b = |i: usize, j: usize| entries[i * 8 + j];
            let m = |i: usize, j: usize| {
                (0..n).map(|k| b(i, k) * b(j, k)).sum::<f64>() + f64::from(u8::from(i == j))
            };
            let mut packed: Vec<f64> = (0..n).flat_map(|i| (0..=i).map(move |j| (i, j))).map(|(i, j)| m(i, j)).collect();
            let mut x = rhs[..n].to_vec();
            cholesky(&mut packed, n).unwrap();
            cholesky_solve(&packed, n, &mut x);
            for (i, right) in rhs.iter().enumerate().take(n) {
                let left: f64 = (0..n).map(|j| m(i, j) * x[j]).sum();
                prop_assert!((left - right).abs() < 1e-12);
            }
            // A general matrix far enough from singular.
            let g = |i: usize, j: usize| b(i, j) + if (i + 1) % n == j { 9.0 } else { 0.0 };
            let mut a: Vec<f64> = (0..n * n).map(|k| g(k / n, k % n)).collect();
            let mut x = rhs[..n].to_vec();
            solve(&mut a, n, &mut x).unwrap();
            for (i, right) in rhs.iter().enumerate().take(n) {
                let left: f64 = (0..n).map(|j| g(i, j) * x[j]).sum();
                prop_assert!((left - right).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn singular_matrices_are_noticed() {
        assert_eq!(cholesky(&mut [1.0, 1.0, 1.0], 2), Err((1, 0.0)));
        assert_eq!(cholesky(&mut [-2.0], 1), Err((0, -2.0)));
        assert!(cholesky(&mut [f64::NAN], 1).is_err());
        assert!(solve(&mut [1.0, 2.0, 2.0, 4.0], 2, &mut [1.0, 1.0]).is_none());
    }
}
