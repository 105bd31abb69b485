//! Sparse LDLᵀ of a symmetric matrix given by summed triplets, with its inertia.
//!
//! A thin layer over faer's simplicial LDLᵀ (AMD ordering): symbolic once, numeric per call, D read
//! off the factor because faer reports no inertia. There is no pivoting: callers regularise zero
//! diagonals and refine.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::simplicial::SymbolicSimplicialCholesky;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side, Spec};

/// Numbers of positive, negative and (numerically) zero pivots.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Inertia {
    /// Positive pivots.
    pub positive: usize,
    /// Negative pivots.
    pub negative: usize,
    /// Pivots that are zero or not finite.
    pub zero: usize,
}

/// A sparse symmetric matrix with a fixed pattern and its LDLᵀ factors.
pub struct SparseLdl {
    n: usize,
    col_ptr: Vec<usize>,
    row_idx: Vec<usize>,
    /// Position in `values` of each triplet.
    slot: Vec<u32>,
    values: Vec<f64>,
    symbolic: SymbolicCholesky<usize>,
    factor: Vec<f64>,
    memory: MemBuffer,
    rows: Vec<f64>,
}

impl SparseLdl {
    /// Analyses the pattern of the lower triangle (`row ≥ col`); repeated triplets are summed.
    /// Every diagonal entry is stored.
    pub fn new(n: usize, triplets: &[(u32, u32)]) -> Self {
        let mut entries: Vec<(u32, u32)> = triplets.iter().map(|&(r, c)| (c, r)).collect();
        debug_assert!(
            entries.iter().all(|&(c, r)| r >= c && (r as usize) < n),
            "lower triangle"
        );
        entries.extend((0..n as u32).map(|i| (i, i)));
        entries.sort_unstable();
        entries.dedup();
        let mut col_ptr = vec![0usize; n + 1];
        for &(c, _) in &entries {
            col_ptr[c as usize + 1] += 1;
        }
        for j in 0..n {
            col_ptr[j + 1] += col_ptr[j];
        }
        let row_idx: Vec<usize> = entries.iter().map(|&(_, r)| r as usize).collect();
        let slot = triplets
            .iter()
            .map(|&(r, c)| {
                let column = &row_idx[col_ptr[c as usize]..col_ptr[c as usize + 1]];
                let at = column.binary_search(&(r as usize)).unwrap_or(0);
                (col_ptr[c as usize] + at) as u32
            })
            .collect();
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &col_ptr, None, &row_idx);
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SIMPLICIAL,
            ..Default::default()
        };
        // Fails only when an index type overflows or memory runs out, neither of which a usize
        // pattern of this size meets.
        let symbolic =
            factorize_symbolic_cholesky(pattern, Side::Lower, SymmetricOrdering::Amd, params)
                .expect("symbolic factorization of a valid pattern");
        let factor = vec![0.0; symbolic.len_val()];
        let numeric = symbolic
            .factorize_numeric_ldlt_scratch::<f64>(Par::Seq, Spec::default())
            .or(symbolic.solve_in_place_scratch::<f64>(1, Par::Seq));
        let values = vec![0.0; row_idx.len()];
        Self {
            n,
            col_ptr,
            row_idx,
            slot,
            values,
            symbolic,
            factor,
            memory: MemBuffer::new(numeric),
            rows: Vec::new(),
        }
    }

    /// Dimension.
    pub fn n(&self) -> usize {
        self.n
    }

    /// Sets all values to zero.
    pub fn clear(&mut self) {
        self.values.fill(0.0);
    }

    /// Adds to the entry of triplet `k` of the constructor's list.
    pub fn add(&mut self, k: usize, value: f64) {
        self.values[self.slot[k] as usize] += value;
    }

    /// Adds to a diagonal entry (the first entry of its column).
    pub fn add_diagonal(&mut self, i: usize, value: f64) {
        self.values[self.col_ptr[i]] += value;
    }

    fn simplicial(&self) -> &SymbolicSimplicialCholesky<usize> {
        match self.symbolic.raw() {
            SymbolicCholeskyRaw::Simplicial(s) => s,
            SymbolicCholeskyRaw::Supernodal(_) => unreachable!("simplicial was forced"),
        }
    }

    /// Factorises the current values and counts the signs of D.
    pub fn factorise(&mut self) -> Inertia {
        let pattern = SymbolicSparseColMatRef::new_checked(
            self.n,
            self.n,
            &self.col_ptr,
            None,
            &self.row_idx,
        );
        let matrix = SparseColMatRef::new(pattern, &self.values);
        let done = self.symbolic.factorize_numeric_ldlt(
            &mut self.factor,
            matrix,
            Side::Lower,
            LdltRegularization::default(),
            Par::Seq,
            MemStack::new(&mut self.memory),
            Spec::default(),
        );
        if done.is_err() {
            return Inertia {
                zero: self.n,
                ..Inertia::default()
            };
        }
        let mut inertia = Inertia::default();
        let col_ptr = self.simplicial().col_ptr();
        for &start in &col_ptr[..self.n] {
            match self.factor[start] {
                d if d > 0.0 && d.is_finite() => inertia.positive += 1,
                d if d < 0.0 && d.is_finite() => inertia.negative += 1,
                _ => inertia.zero += 1,
            }
        }
        inertia
    }

    /// Solves in place for `columns` right-hand sides stored one after another.
    pub fn solve(&mut self, rhs: &mut [f64], columns: usize) {
        let scratch = self
            .symbolic
            .solve_in_place_scratch::<f64>(columns, Par::Seq);
        let ldlt =
            faer::sparse::linalg::cholesky::LdltRef::new(&self.symbolic, self.factor.as_slice());
        let x = MatMut::from_column_major_slice_mut(rhs, self.n, columns);
        if columns == 1 {
            ldlt.solve_in_place_with_conj(Conj::No, x, Par::Seq, MemStack::new(&mut self.memory));
        } else {
            let mut memory = MemBuffer::new(scratch);
            ldlt.solve_in_place_with_conj(Conj::No, x, Par::Seq, MemStack::new(&mut memory));
        }
    }

    /// Solves in place for `width` right-hand sides stored row by row (n × width): every entry of
    /// the factor meets a contiguous row.
    pub fn solve_rows(&mut self, rhs: &mut [f64], width: usize) {
        let n = self.n;
        self.rows.clear();
        self.rows.resize(n * width, 0.0);
        // faer orders the matrix by a permutation with x_new[i] = x[forward[i]].
        let permutation = self.symbolic.perm();
        let place = |i: usize| permutation.map_or(i, |p| p.arrays().0[i]);
        let x = &mut self.rows;
        for i in 0..n {
            let from = place(i) * width;
            x[i * width..(i + 1) * width].copy_from_slice(&rhs[from..from + width]);
        }
        let SymbolicCholeskyRaw::Simplicial(pattern) = self.symbolic.raw() else {
            unreachable!("simplicial was forced")
        };
        let (col_ptr, row_idx) = (pattern.col_ptr(), pattern.row_idx());
        for j in 0..n {
            let (above, below) = x.split_at_mut((j + 1) * width);
            let row = &above[j * width..];
            for k in col_ptr[j] + 1..col_ptr[j + 1] {
                let at = (row_idx[k] - j - 1) * width;
                let l = self.factor[k];
                for (b, a) in below[at..at + width].iter_mut().zip(row) {
                    *b -= l * a;
                }
            }
        }
        for j in (0..n).rev() {
            let (above, below) = x.split_at_mut((j + 1) * width);
            let row = &mut above[j * width..];
            let inverse = 1.0 / self.factor[col_ptr[j]];
            row.iter_mut().for_each(|x| *x *= inverse);
            for k in col_ptr[j] + 1..col_ptr[j + 1] {
                let at = (row_idx[k] - j - 1) * width;
                let l = self.factor[k];
                for (a, b) in row.iter_mut().zip(&below[at..at + width]) {
                    *a -= l * b;
                }
            }
        }
        for i in 0..n {
            let to = place(i) * width;
            rhs[to..to + width].copy_from_slice(&x[i * width..(i + 1) * width]);
        }
    }

    /// `Y += A X` for X stored row by row, n × width.
    pub fn multiply_add_rows(&self, x: &[f64], y: &mut [f64], width: usize) {
        let row = |i: usize| i * width..(i + 1) * width;
        for c in 0..self.n {
            for k in self.col_ptr[c]..self.col_ptr[c + 1] {
                let (r, a) = (self.row_idx[k], self.values[k]);
                for (y, x) in y[row(r)].iter_mut().zip(&x[row(c)]) {
                    *y += a * x;
                }
                if r != c {
                    for (y, x) in y[row(c)].iter_mut().zip(&x[row(r)]) {
                        *y += a * x;
                    }
                }
            }
        }
    }

    /// `y += A x` with the current values.
    pub fn multiply_add(&self, x: &[f64], y: &mut [f64]) {
        for c in 0..self.n {
            for k in self.col_ptr[c]..self.col_ptr[c + 1] {
                let (r, a) = (self.row_idx[k], self.values[k]);
                y[r] += a * x[c];
                if r != c {
                    y[c] += a * x[r];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_solve_and_inertia_of_a_saddle_point() {
        // [4 1 1; 1 3 1; 1 1 -0.1], eigenvalues two positive and one negative; the triplet (0,0) is
        // given in two parts.
        let triplets = [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2), (0, 0)];
        let mut ldl = SparseLdl::new(3, &triplets);
        for (k, v) in [3.0, 1.0, 3.0, 1.0, 1.0, -0.1, 1.0].into_iter().enumerate() {
            ldl.add(k, v);
        }
        assert_eq!(
            ldl.factorise(),
            Inertia {
                positive: 2,
                negative: 1,
                zero: 0
            }
        );
        let x = [1.0, -2.0, 0.5, 3.0, 0.0, -1.0];
        let mut rhs = [0.0; 6];
        ldl.multiply_add(&x[..3], &mut rhs[..3]);
        ldl.multiply_add(&x[3..], &mut rhs[3..]);
        ldl.solve(&mut rhs, 2);
        for (a, b) in x.iter().zip(&rhs) {
            assert!((a - b).abs() < 1e-14, "{a} {b}");
        }
    }

    #[test]
    fn right_hand_sides_by_rows_give_what_columns_give() {
        // A ring with two chords, so that the ordering moves something and the factor fills.
        let n = 9;
        let mut triplets: Vec<(u32, u32)> = (1..n as u32).map(|i| (i, i - 1)).collect();
        triplets.extend([(8, 0), (6, 2), (7, 1)]);
        let mut ldl = SparseLdl::new(n, &triplets);
        for k in 0..triplets.len() {
            ldl.add(k, 0.3 + 0.1 * k as f64);
        }
        for i in 0..n {
            ldl.add_diagonal(i, if i % 3 == 0 { -4.0 } else { 5.0 });
        }
        ldl.factorise();
        let width = 3;
        let x: Vec<f64> = (0..n * width).map(|k| (k as f64).sin()).collect();
        let mut rows = vec![0.0; n * width];
        ldl.multiply_add_rows(&x, &mut rows, width);
        for c in 0..width {
            let column: Vec<f64> = x.iter().skip(c).step_by(width).copied().collect();
            let mut product = vec![0.0; n];
            ldl.multiply_add(&column, &mut product);
            for i in 0..n {
                assert!((rows[i * width + c] - product[i]).abs() < 1e-14);
            }
        }
        ldl.solve_rows(&mut rows, width);
        for (a, b) in x.iter().zip(&rows) {
            assert!((a - b).abs() < 1e-13, "{a} {b}");
        }
    }
}
