//! Lost directions as groups of parameters that a person can read.
//!
//! A null vector names a set of parameters of which one combination is lost. The basis a
//! factorization returns mixes the sets; here they are separated:
//! 1. parameters without effect (zero columns);
//! 2. parameters whose effects are proportional: they enter only through one combination
//!    (`iz1 + m1 (sx1² + sy1²)`);
//! 3. among one representative of each of those and the rest, null vectors with as few parameters
//!    as can be found: many bases are reduced to echelon form with different orders of the columns,
//!    and the shortest independent vectors are kept. That choice is the best among the candidates,
//!    because linear independence is a matroid (R. Rado, 1957).

use pid_symbolic::random::Random;

use crate::dense::{self, Matrix};

/// Orders of the columns that are tried.
const ORDERS: usize = 64;
/// Components below this share of the largest (columns scaled to length one) are zero.
const ZERO: f64 = 1e-7;
/// Components that agree with the parameters' values to this share are a common factor.
const FACTOR: f64 = 1e-6;

/// Kind of a loss.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GroupKind {
    /// One parameter without effect.
    NoEffect,
    /// Proportional effects: one combination of all is determined.
    OneCombination,
    /// One direction is lost: as many combinations are determined as there are parameters, less one.
    OneLess,
    /// One direction is lost, a common factor of the parameters.
    CommonFactor,
}

/// Parameters that the motion does not tell apart.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// Its kind.
    pub kind: GroupKind,
    /// The parameters, ascending. One stands for all of a group of proportional ones.
    pub params: Vec<usize>,
    /// For a common factor: parameters that shorter groups let one adjust. They are not part of the
    /// common factor of `params` themselves.
    pub touched: Vec<usize>,
}

impl Group {
    /// Number of combinations of the parameters that the motion determines.
    pub fn combinations(&self) -> usize {
        match self.kind {
            GroupKind::NoEffect => 0,
            GroupKind::OneCombination => 1,
            GroupKind::OneLess | GroupKind::CommonFactor => {
                self.params.len() + self.touched.len() - 1
            }
        }
    }

    /// Number of directions lost.
    pub fn lost(&self) -> usize {
        self.params.len() + self.touched.len() - self.combinations()
    }

    /// The loss in words: "`m1`, `sx1` and `iz1` enter only through one combination".
    pub fn text(&self, name: impl Fn(usize) -> String) -> String {
        let list = |params: &[usize]| {
            let names: Vec<String> = params.iter().map(|&k| format!("`{}`", name(k))).collect();
            match names.as_slice() {
                [one] => one.clone(),
                [head @ .., last] => format!("{} and {last}", head.join(", ")),
                [] => String::new(),
            }
        };
        let names = list(&self.params);
        match self.kind {
            GroupKind::NoEffect => format!("{names} has no effect on the motion"),
            GroupKind::OneCombination => format!("{names} enter only through one combination"),
            GroupKind::OneLess => {
                format!(
                    "{names} enter only through {} combinations",
                    self.params.len() - 1
                )
            }
            GroupKind::CommonFactor if self.touched.is_empty() => {
                format!("{names} are determined up to one common factor")
            }
            GroupKind::CommonFactor => format!(
                "{names} are determined up to one common factor ({} adjusted with it)",
                list(&self.touched)
            ),
        }
    }
}

/// Groups of the columns of `a`, whose null space has the basis `null`; `values` are the
/// parameters' values. Numbers of parameters are column numbers.
pub(super) fn groups(a: &Matrix, null: &[Vec<f64>], values: &[f64]) -> Vec<Group> {
    let n = a.cols();
    let length: Vec<f64> = (0..n).map(|j| dense::norm(a.col(j))).collect();
    let mut groups = Vec::new();
    for j in (0..n).filter(|&j| length[j] == 0.0) {
        groups.push(Group {
            kind: GroupKind::NoEffect,
            params: vec![j],
            touched: Vec::new(),
        });
    }

    // Proportional columns. The last declared stands for all, as inertias follow masses and places.
    let mut representatives: Vec<usize> = Vec::new();
    let mut seen = vec![false; n];
    for j in (0..n).filter(|&j| length[j] > 0.0) {
        if seen[j] {
            continue;
        }
        let class: Vec<usize> = (j..n)
            .filter(|&k| length[k] > 0.0 && !seen[k] && parallel(a, &length, j, k))
            .collect();
        class.iter().for_each(|&k| seen[k] = true);
        representatives.extend(class.last());
        if class.len() > 1 {
            groups.push(Group {
                kind: GroupKind::OneCombination,
                params: class,
                touched: Vec::new(),
            });
        }
    }
    representatives.sort_unstable();

    let lost: usize = groups.iter().map(Group::lost).sum();
    let open = null.len().saturating_sub(lost);
    if open == 0 {
        return groups;
    }
    // The null space of the representatives, columns scaled to length one.
    let reduced = dense::rank(&a.select(&representatives)).null;
    let scaled: Vec<Vec<f64>> = reduced
        .into_iter()
        .map(|vector| {
            vector
                .iter()
                .zip(&representatives)
                .map(|(x, &j)| x * length[j])
                .collect()
        })
        .collect();
    let short = shortest(&scaled, representatives.len());
    let mut covered = vec![false; n];
    for vector in short {
        let support: Vec<usize> = (0..vector.len()).filter(|&k| vector[k] != 0.0).collect();
        let columns: Vec<usize> = support.iter().map(|&k| representatives[k]).collect();
        let own: Vec<(usize, f64)> = support
            .iter()
            .map(|&k| (representatives[k], vector[k] / length[representatives[k]]))
            .filter(|&(j, _)| !covered[j])
            .collect();
        let factor = own.len() >= 4 && common_factor(&own, values);
        let (params, touched) = if factor {
            columns.iter().partition(|&&j| !covered[j])
        } else {
            (columns.clone(), Vec::new())
        };
        columns.iter().for_each(|&j| covered[j] = true);
        groups.push(Group {
            kind: if factor {
                GroupKind::CommonFactor
            } else if columns.len() == 2 {
                GroupKind::OneCombination
            } else {
                GroupKind::OneLess
            },
            params,
            touched,
        });
    }
    groups
}

/// Whether two columns are proportional.
fn parallel(a: &Matrix, length: &[f64], j: usize, k: usize) -> bool {
    let dot: f64 = a.col(j).iter().zip(a.col(k)).map(|(x, y)| x * y).sum();
    let sign = dot.signum();
    let distance: f64 = a
        .col(j)
        .iter()
        .zip(a.col(k))
        .map(|(x, y)| (x / length[j] - sign * y / length[k]).powi(2))
        .sum();
    distance.sqrt() < 1e-9
}

/// Whether the components are the values times one number.
fn common_factor(own: &[(usize, f64)], values: &[f64]) -> bool {
    let mut factors = own.iter().map(|&(j, x)| x / values[j]);
    let Some(first) = factors.next() else {
        return false;
    };
    first.is_finite() && first != 0.0 && factors.all(|f| (f - first).abs() <= FACTOR * first.abs())
}

/// Independent null vectors with few components, shortest first; small components are set to zero.
fn shortest(basis: &[Vec<f64>], n: usize) -> Vec<Vec<f64>> {
    let mut random = Random::new(0x9a0b);
    let mut candidates: Vec<(Vec<usize>, Vec<f64>)> = Vec::new();
    for order in 0..ORDERS {
        let mut columns: Vec<usize> = (0..n).collect();
        match order {
            0 => {}
            1 => columns.reverse(),
            _ => {
                for k in (1..n).rev() {
                    columns.swap(k, (random.bits() % (k as u64 + 1)) as usize);
                }
            }
        }
        for vector in echelon(basis.to_vec(), &columns) {
            let support: Vec<usize> = (0..n).filter(|&k| vector[k] != 0.0).collect();
            if !candidates.iter().any(|(known, _)| *known == support) {
                candidates.push((support, vector));
            }
        }
    }
    candidates.sort_by(|(x, _), (y, _)| (x.len(), x).cmp(&(y.len(), y)));
    let mut matrix = Matrix::zeros(n, candidates.len());
    for (k, (_, vector)) in candidates.iter().enumerate() {
        matrix.col_mut(k).copy_from_slice(vector);
    }
    let mut kept = dense::select(&matrix, 1e-6).independent;
    kept.truncate(basis.len());
    kept.into_iter().map(|k| candidates[k].1.clone()).collect()
}

/// Reduced echelon form, pivots sought in the order of `columns`; a pivot must not be small beside
/// its column's largest component, so that nothing grows.
fn echelon(mut rows: Vec<Vec<f64>>, columns: &[usize]) -> Vec<Vec<f64>> {
    for row in &mut rows {
        normalise(row);
    }
    let mut done = 0;
    for &column in columns {
        if done == rows.len() {
            break;
        }
        let Some(pivot) = (done..rows.len())
            .max_by(|&i, &j| rows[i][column].abs().total_cmp(&rows[j][column].abs()))
            .filter(|&i| rows[i][column].abs() > 1e-5)
        else {
            continue;
        };
        rows.swap(done, pivot);
        let head = rows[done].clone();
        for (i, row) in rows.iter_mut().enumerate() {
            if i != done && row[column] != 0.0 {
                let factor = row[column] / head[column];
                for (x, h) in row.iter_mut().zip(&head) {
                    *x -= factor * h;
                }
                row[column] = 0.0;
                normalise(row);
            }
        }
        done += 1;
    }
    rows
}

/// Largest component 1; small ones zero.
fn normalise(row: &mut [f64]) {
    let largest = row.iter().fold(0.0_f64, |l, x| l.max(x.abs()));
    if largest > 0.0 {
        for x in row {
            *x /= largest;
            if x.abs() < ZERO {
                *x = 0.0;
            }
        }
    }
}
