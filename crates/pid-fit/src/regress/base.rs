//! Base parameters from data: the combinations of parameters that the normal equations determine,
//! and their names.
//!
//! With A scaled to a unit diagonal, a Cholesky factorization with complete pivoting takes the
//! columns one by one. Columns whose remainder (1 − R² on the columns taken before) falls below
//! 1e-10 are linear combinations of the others, `W_d = W_i K`, and only `β = p_i + K p_d` can be
//! determined (M. Gautier, J. Robotic Systems 8, 1991, by QR).

use nalgebra::{DMatrix, DVector};

/// A column with a smaller remainder depends on those taken before.
const DEPENDENT: f64 = 1e-10;
/// A coefficient of K below this share of a column's length is rounding.
const NEGLIGIBLE: f64 = 1e-5;

/// The combinations that the data determine.
#[derive(Debug, Clone, PartialEq)]
pub struct Base {
    /// Columns that stand for their combination, in ascending order.
    pub independent: Vec<usize>,
    /// Columns that depend on them, in ascending order, zero columns included.
    pub dependent: Vec<usize>,
    /// K: `independent` × `dependent`.
    pub k: DMatrix<f64>,
}

impl Base {
    /// Of normal equations A.
    pub fn of(a: &DMatrix<f64>) -> Self {
        let n = a.nrows();
        let length: Vec<f64> = (0..n).map(|i| a[(i, i)].max(0.0).sqrt()).collect();
        let longest = length.iter().copied().fold(0.0, f64::max);
        let present: Vec<usize> = (0..n).filter(|&i| length[i] > 1e-12 * longest).collect();
        let scaled = |i: usize, j: usize| a[(i, j)] / (length[i] * length[j]);
        // Pivoted Cholesky on the correlations.
        let m = present.len();
        let mut rest = DMatrix::from_fn(m, m, |i, j| scaled(present[i], present[j]));
        let mut taken: Vec<usize> = Vec::new();
        let mut open: Vec<usize> = (0..m).collect();
        while let Some((place, &pivot)) = open.iter().enumerate().max_by(|a, b| {
            rest[(*a.1, *a.1)]
                .total_cmp(&rest[(*b.1, *b.1)])
                .then(b.1.cmp(a.1))
        }) {
            let d = rest[(pivot, pivot)];
            if d <= DEPENDENT {
                break;
            }
            open.remove(place);
            for &i in &open {
                let factor = rest[(i, pivot)] / d;
                for &j in open.iter().filter(|&&j| j <= i) {
                    rest[(i, j)] -= factor * rest[(pivot, j)];
                    rest[(j, i)] = rest[(i, j)];
                }
            }
            taken.push(pivot);
        }
        let mut independent: Vec<usize> = taken.iter().map(|&i| present[i]).collect();
        independent.sort_unstable();
        let dependent: Vec<usize> = (0..n).filter(|i| !independent.contains(i)).collect();
        let mut k = DMatrix::zeros(independent.len(), dependent.len());
        let gram = DMatrix::from_fn(independent.len(), independent.len(), |i, j| {
            scaled(independent[i], independent[j])
        });
        if let Some(factor) = gram.cholesky() {
            for (column, &d) in dependent
                .iter()
                .enumerate()
                .filter(|(_, d)| present.contains(d))
            {
                let right = DVector::from_fn(independent.len(), |i, _| scaled(independent[i], d));
                let solution = factor.solve(&right);
                for (i, x) in solution.iter().enumerate() {
                    if x.abs() > NEGLIGIBLE {
                        k[(i, column)] = x * length[d] / length[independent[i]];
                    }
                }
            }
        }
        Self {
            independent,
            dependent,
            k,
        }
    }

    /// Number of combinations.
    pub fn rank(&self) -> usize {
        self.independent.len()
    }

    /// β of all parameters.
    pub fn combine(&self, p: &DVector<f64>) -> DVector<f64> {
        DVector::from_fn(self.rank(), |i, _| {
            let rest: f64 = self
                .dependent
                .iter()
                .enumerate()
                .map(|(c, &d)| self.k[(i, c)] * p[d])
                .sum();
            p[self.independent[i]] + rest
        })
    }

    /// C with `β = C p`.
    pub fn matrix(&self) -> DMatrix<f64> {
        let n = self.independent.len() + self.dependent.len();
        let mut c = DMatrix::zeros(self.rank(), n);
        for (i, &column) in self.independent.iter().enumerate() {
            c[(i, column)] = 1.0;
            for (k, &d) in self.dependent.iter().enumerate() {
                c[(i, d)] = self.k[(i, k)];
            }
        }
        c
    }

    /// The parameters with these β that lie nearest to `near`, distances measured in `scale`.
    pub fn nearest(&self, beta: &DVector<f64>, near: &DVector<f64>, scale: &[f64]) -> DVector<f64> {
        let c = self.matrix();
        let gap = beta - self.combine(near);
        let weighted =
            DMatrix::from_fn(c.nrows(), c.ncols(), |i, j| c[(i, j)] * scale[j] * scale[j]);
        match (&weighted * c.transpose()).cholesky() {
            Some(factor) => near + weighted.transpose() * factor.solve(&gap),
            None => near.clone(),
        }
    }

    /// β_i in words: `link2_izz + 0.613 link3_mx`.
    pub fn formula(&self, i: usize, names: &[&str]) -> String {
        let mut text = names[self.independent[i]].to_owned();
        for (column, &d) in self.dependent.iter().enumerate() {
            let k = self.k[(i, column)];
            if k == 0.0 {
                continue;
            }
            text.push_str(if k < 0.0 { " - " } else { " + " });
            if (k.abs() - 1.0).abs() > 1e-6 {
                text.push_str(&format!("{} ", rounded(k.abs())));
            }
            text.push_str(names[d]);
        }
        text
    }

    /// Whether a combination is one parameter by itself.
    pub fn single(&self, i: usize) -> bool {
        self.k.row(i).iter().all(|&k| k == 0.0)
    }
}

/// Four significant digits without trailing zeros.
fn rounded(x: f64) -> String {
    let digits = (3 - x.abs().log10().floor() as i32).clamp(0, 9) as usize;
    let text = format!("{x:.digits$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four columns over 50 samples: x, y, 2x − y, 0.
    fn gram() -> DMatrix<f64> {
        let w = DMatrix::from_fn(50, 4, |i, j| {
            let (x, y) = ((0.3 * i as f64).sin(), (0.7 * i as f64 + 1.0).cos());
            [x, y, 2.0 * x - y, 0.0][j]
        });
        w.transpose() * w
    }

    #[test]
    fn combinations_are_found_and_named() {
        let base = Base::of(&gram());
        assert_eq!(base.rank(), 2);
        assert!(base.dependent.contains(&3));
        // Whichever columns stand for the combinations, Y p depends on β alone.
        let p = DVector::from_vec(vec![1.0, -2.0, 0.5, 9.0]);
        let shifted = &p + 3.0 * DVector::from_vec(vec![2.0, -1.0, -1.0, 4.0]);
        assert!((base.combine(&p) - base.combine(&shifted)).norm() < 1e-9);
        let names = ["a", "b", "c", "d"];
        let words: Vec<String> = (0..2).map(|i| base.formula(i, &names)).collect();
        assert!(words.iter().all(|w| !w.contains('d')), "{words:?}");
        assert!(words.iter().any(|w| w.contains(['+', '-'])), "{words:?}");
    }

    #[test]
    fn the_nearest_parameters_have_the_combinations() {
        let base = Base::of(&gram());
        let beta = DVector::from_vec(vec![0.4, -1.1]);
        let near = DVector::from_vec(vec![1.0, 2.0, 3.0, 4.0]);
        let p = base.nearest(&beta, &near, &[1.0, 2.0, 0.5, 1.0]);
        assert!((base.combine(&p) - &beta).norm() < 1e-9);
        assert_eq!(p[3], 4.0, "what does not enter stays");
        // No other point with the same β is nearer: the step is orthogonal to the null direction
        // (2, −1, −1, ·) in the scale.
        let step = &p - &near;
        let product = step[0] * 2.0 - step[1] / 4.0 - step[2] / 0.25;
        assert!(product.abs() < 1e-9, "{product}");
    }

    #[test]
    fn numbers_are_written_short() {
        assert_eq!(rounded(0.6127), "0.6127");
        assert_eq!(rounded(2.0), "2");
        assert_eq!(rounded(1200.0), "1200");
        assert_eq!(rounded(0.037540), "0.03754");
    }
}
