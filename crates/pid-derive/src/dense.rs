//! Rank decisions on small dense matrices.
//!
//! The matrices here are samples of exact derivatives: a singular value is either of the size of
//! the problem or a rounding error, and the rank is where the gap lies. These are plain loops on
//! one buffer, since they run inside a procedural macro, which users build without optimisation.

/// A dense matrix, column by column.
#[derive(Debug, Clone, PartialEq)]
pub struct Matrix {
    rows: usize,
    cols: usize,
    data: Vec<f64>,
}

impl Matrix {
    /// Zeros.
    pub fn zeros(rows: usize, cols: usize) -> Self {
        Self {
            rows,
            cols,
            data: vec![0.0; rows * cols],
        }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    pub fn cols(&self) -> usize {
        self.cols
    }

    /// A column.
    pub fn col(&self, j: usize) -> &[f64] {
        &self.data[j * self.rows..(j + 1) * self.rows]
    }

    /// A column, to be written.
    pub fn col_mut(&mut self, j: usize) -> &mut [f64] {
        &mut self.data[j * self.rows..(j + 1) * self.rows]
    }

    /// The columns with these numbers.
    pub fn select(&self, cols: &[usize]) -> Self {
        let mut selected = Self::zeros(self.rows, cols.len());
        for (k, &j) in cols.iter().enumerate() {
            selected.col_mut(k).copy_from_slice(self.col(j));
        }
        selected
    }

    /// Two different columns, the second to be written.
    fn two(&mut self, i: usize, j: usize) -> (&[f64], &mut [f64]) {
        debug_assert!(i < j);
        let (head, tail) = self.data.split_at_mut(j * self.rows);
        (
            &head[i * self.rows..(i + 1) * self.rows],
            &mut tail[..self.rows],
        )
    }

    fn swap(&mut self, i: usize, j: usize) {
        if i != j {
            let (i, j) = (i.min(j), i.max(j));
            let rows = self.rows;
            let (head, tail) = self.data.split_at_mut(j * rows);
            head[i * rows..(i + 1) * rows].swap_with_slice(&mut tail[..rows]);
        }
    }
}

impl std::ops::Index<(usize, usize)> for Matrix {
    type Output = f64;
    fn index(&self, (i, j): (usize, usize)) -> &f64 {
        &self.data[j * self.rows + i]
    }
}

impl std::ops::IndexMut<(usize, usize)> for Matrix {
    fn index_mut(&mut self, (i, j): (usize, usize)) -> &mut f64 {
        &mut self.data[j * self.rows + i]
    }
}

/// Euclidean norm.
pub fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Rank of a matrix, the gap behind it, and the null space.
#[derive(Debug, Clone, PartialEq)]
pub struct Rank {
    /// The rank.
    pub rank: usize,
    /// Smallest pivot kept and largest dropped, relative to the largest; 1 and 0 where there is none.
    pub gap: (f64, f64),
    /// A basis of the null space: one vector per lost direction, in the order of the columns.
    pub null: Vec<Vec<f64>>,
}

/// Pivots that are dropped lie below this share of the largest.
const SMALL: f64 = 1e-8;
/// Pivots below this count as equal: they are rounding errors.
const FLOOR: f64 = 1e-16;

/// Rank and null space by a Householder QR factorization with column pivoting (P. Businger, G. H.
/// Golub, 1965) of the matrix with its columns scaled to length one. The rank is where consecutive
/// pivots have their widest gap, below a share of 1e-8 of the largest. Columns of zeros are
/// directions lost.
pub fn rank(a: &Matrix) -> Rank {
    let n = a.cols();
    let scale: Vec<f64> = (0..n).map(|j| norm(a.col(j))).collect();
    let mut scaled = a.clone();
    for j in 0..n {
        if scale[j] > 0.0 {
            scaled.col_mut(j).iter_mut().for_each(|x| *x /= scale[j]);
        }
    }
    let factors = Factors::of(scaled);
    let (rank, gap) = factors.widest_gap();
    let null = (rank..n).map(|dropped| factors.null(rank, dropped, &scale));
    Rank {
        rank,
        gap,
        null: null.collect(),
    }
}

/// R of a factorization with pivoting, its pivots, and which column of the matrix each of its columns is.
struct Factors {
    r: Matrix,
    pivots: Vec<f64>,
    order: Vec<usize>,
}

impl Factors {
    /// Factors `r` in its own place.
    fn of(mut r: Matrix) -> Self {
        let (m, n) = (r.rows(), r.cols());
        let mut order: Vec<usize> = (0..n).collect();
        let mut pivots = vec![0.0; n];
        for (k, pivot) in pivots.iter_mut().enumerate().take(m.min(n)) {
            let lengths = (k..n).map(|j| (j, norm(&r.col(j)[k..])));
            let longer = |best: (usize, f64), next: (usize, f64)| match next.1 > best.1 {
                true => next,
                false => best,
            };
            let (best, length) = lengths.fold((k, -1.0), longer);
            r.swap(k, best);
            order.swap(k, best);
            *pivot = length;
            if length == 0.0 {
                break;
            }
            // The reflection that takes the column to −sign(x₀) ‖x‖ e₀.
            let head = r[(k, k)];
            let alpha = if head > 0.0 { -length } else { length };
            r[(k, k)] = head - alpha;
            let square = 2.0 * (length * length - alpha * head);
            for j in k + 1..n {
                let (v, x) = r.two(k, j);
                let (v, x) = (&v[k..], &mut x[k..]);
                let dot: f64 = v.iter().zip(x.iter()).map(|(v, x)| v * x).sum();
                let factor = 2.0 * dot / square;
                for (x, v) in x.iter_mut().zip(v) {
                    *x -= factor * v;
                }
            }
            r[(k, k)] = alpha;
        }
        Factors { r, pivots, order }
    }

    /// A pivot relative to the largest.
    fn relative(&self, k: usize) -> f64 {
        let largest = self.pivots.first().copied().unwrap_or(0.0);
        match largest > 0.0 {
            true => self.pivots[k] / largest,
            false => 0.0,
        }
    }

    /// The rank, by the widest gap among those with a small lower edge, and the pivots beside that gap. Full
    /// rank needs no gap.
    fn widest_gap(&self) -> (usize, (f64, f64)) {
        let n = self.pivots.len();
        let relative = |k: usize| self.relative(k);
        let mut rank = n;
        if n > 0 && self.pivots[0] == 0.0 {
            rank = 0;
        } else if (0..n).any(|k| relative(k) <= SMALL) {
            let mut widest = 0.0;
            for k in 1..n {
                if relative(k) <= SMALL {
                    let ratio = relative(k - 1).max(FLOOR) / relative(k).max(FLOOR);
                    if ratio > widest {
                        (widest, rank) = (ratio, k);
                    }
                }
            }
        }
        let kept = if rank > 0 { relative(rank - 1) } else { 1.0 };
        let lost = if rank < n { relative(rank) } else { 0.0 };
        (rank, (kept, lost))
    }

    /// The null vector of a dropped column, by the columns of the matrix: R₁₁ x = −R₁₂ e.
    fn null(&self, rank: usize, dropped: usize, scale: &[f64]) -> Vec<f64> {
        let r = &self.r;
        let mut x = vec![0.0; rank];
        for i in (0..rank).rev() {
            let mut sum = -r[(i, dropped)];
            for j in i + 1..rank {
                sum -= r[(i, j)] * x[j];
            }
            x[i] = sum / r[(i, i)];
        }
        let mut vector = vec![0.0; scale.len()];
        let unscaled = |j: usize, x: f64| if scale[j] > 0.0 { x / scale[j] } else { x };
        for (at, x) in self.order.iter().zip(x) {
            vector[*at] = unscaled(*at, x);
        }
        let own = self.order[dropped];
        vector[own] = unscaled(own, 1.0);
        vector
    }
}

/// Columns taken in their order, each kept if it is independent of those kept before it.
#[derive(Debug, Clone, PartialEq)]
pub struct Selection {
    /// Columns kept.
    pub independent: Vec<usize>,
    /// Columns left out, each with its coefficients by the columns kept before it, in the order of
    /// `independent`.
    pub dependent: Vec<(usize, Vec<f64>)>,
    /// Smallest share of a kept column, and largest of a dropped one, that is not spanned by the
    /// columns before.
    pub gap: (f64, f64),
}

/// Selects columns in their order by Gram-Schmidt, orthogonalised twice (L. Giraud et al., 2005). A
/// column is dropped if less than `tolerance` of its length is left.
pub fn select(a: &Matrix, tolerance: f64) -> Selection {
    let m = a.rows();
    let mut basis: Vec<Vec<f64>> = Vec::new();
    // Upper triangle by kept column: its components along the basis, and the length left.
    let mut triangle: Vec<Vec<f64>> = Vec::new();
    let mut selection = Selection {
        independent: Vec::new(),
        dependent: Vec::new(),
        gap: (1.0, 0.0),
    };
    for j in 0..a.cols() {
        let mut rest = a.col(j).to_vec();
        let length = norm(&rest);
        let mut components = vec![0.0; basis.len()];
        for _ in 0..2 {
            for (component, direction) in components.iter_mut().zip(&basis) {
                let dot: f64 = rest.iter().zip(direction).map(|(x, d)| x * d).sum();
                *component += dot;
                for (x, d) in rest.iter_mut().zip(direction) {
                    *x -= dot * d;
                }
            }
        }
        let left = norm(&rest);
        let share = if length > 0.0 { left / length } else { 0.0 };
        if share > tolerance && basis.len() < m {
            selection.gap.0 = selection.gap.0.min(share);
            rest.iter_mut().for_each(|x| *x /= left);
            components.push(left);
            basis.push(rest);
            triangle.push(components);
            selection.independent.push(j);
        } else {
            selection.gap.1 = selection.gap.1.max(share);
            for i in (0..components.len()).rev() {
                components[i] /= triangle[i][i];
                let x = components[i];
                for k in 0..i {
                    components[k] -= triangle[i][k] * x;
                }
            }
            selection.dependent.push((j, components));
        }
    }
    selection
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(rows: &[&[f64]]) -> Matrix {
        let mut a = Matrix::zeros(rows.len(), rows[0].len());
        for (i, row) in rows.iter().enumerate() {
            for (j, &x) in row.iter().enumerate() {
                a[(i, j)] = x;
            }
        }
        a
    }

    /// Columns of very different lengths; the third is the sum of the first two, the fourth is zero.
    fn deficient() -> Matrix {
        of(&[
            &[1.0e6, 2.0e-6, 1.0e6 + 2.0e-6, 0.0, 3.0],
            &[0.5e6, -1.0e-6, 0.5e6 - 1.0e-6, 0.0, 1.0],
            &[-2.0e6, 4.0e-6, -2.0e6 + 4.0e-6, 0.0, 0.0],
            &[3.0e6, 1.0e-6, 3.0e6 + 1.0e-6, 0.0, -2.0],
        ])
    }

    #[test]
    fn rank_and_null_space_of_a_badly_scaled_matrix() {
        let a = of(&[
            &[1.0e6, 2.0, 1.0e6 + 2.0, 0.0, 3.0],
            &[0.5e6, -1.0, 0.5e6 - 1.0, 0.0, 1.0],
            &[-2.0e6, 4.0, -2.0e6 + 4.0, 0.0, 0.0],
            &[3.0e6, 1.0, 3.0e6 + 1.0, 0.0, -2.0],
        ]);
        let found = rank(&a);
        assert_eq!((found.rank, found.null.len()), (3, 2));
        assert!(found.gap.0 > 1e-8 && found.gap.1 < 1e-14, "{:?}", found.gap);
        for vector in &found.null {
            for i in 0..a.rows() {
                let terms = (0..a.cols()).map(|j| a[(i, j)] * vector[j]);
                let size: f64 = terms.clone().map(f64::abs).sum();
                assert!(terms.sum::<f64>().abs() <= 1e-12 * size.max(1e-300));
            }
        }
    }

    #[test]
    fn full_rank_and_nothing_at_all() {
        let found = rank(&of(&[&[1.0, 2.0], &[3.0, -1.0], &[0.0, 1e-3]]));
        assert_eq!((found.rank, found.null.len()), (2, 0));
        let found = rank(&Matrix::zeros(3, 2));
        assert_eq!((found.rank, found.null.len()), (0, 2));
        assert_eq!(rank(&Matrix::zeros(0, 0)).rank, 0);
    }

    #[test]
    fn selection_keeps_the_first_and_expresses_the_others() {
        let a = deficient().select(&[4, 0, 3, 2]);
        let b = of(&[
            &[1.0, 0.0, 2.0, 1.0],
            &[1.0, 1.0, 5.0, 0.0],
            &[0.0, 1.0, 3.0, 0.0],
        ]);
        // 2 · first + 3 · second.
        let found = select(&b, 1e-9);
        assert_eq!(found.independent, [0, 1, 3]);
        assert_eq!(found.dependent.len(), 1);
        let (column, coefficients) = &found.dependent[0];
        assert_eq!(*column, 2);
        assert!((coefficients[0] - 2.0).abs() < 1e-14 && (coefficients[1] - 3.0).abs() < 1e-14);
        // A column of zeros is dropped.
        assert!(
            select(&a, 1e-9)
                .dependent
                .iter()
                .any(|(column, _)| *column == 2)
        );
    }
}
