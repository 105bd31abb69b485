//! Where in time a force acts: a start for effects that are on within windows.
//!
//! The time since the start of a record, shared by all train records, is cut into bins; in each bin a constant amplitude is
//! estimated from the linearised innovations with the nominal parameters free within their prior,
//!
//! ```text
//! min over (z, f) |ε₀ + J_z z + Σ_b J_b f_b|² + |z / σ|²,      s_b = f_bᵀ Cov(f_b)⁻¹ f_b
//! ```
//!
//! Bins with a significant amplitude, joined where they are neighbours, are the windows to start from; their edges are
//! parameters of the refit.

use nalgebra::{DMatrix, DVector};
use pid_runtime::data::Role;
use rayon::prelude::*;

use crate::case::Case;
use crate::effect::{LANES, Term};
use crate::fit::{Basis, Direction, Fit, PRIOR, linearise};

/// Shortest bin, s.
const SHORTEST: f64 = 0.4;
/// Most bins.
const MOST: usize = 18;
/// Significance of a bin, and its share of the largest.
const SIGNIFICANT: (f64, f64) = (25.0, 0.12);
/// A time after every record, s.
const NEVER: f64 = 2e5;

/// Parameters of a timed effect from which a refit should start; `None` if it is not timed or shows in no bin.
pub fn start(case: &Case, basis: &Basis, fit: &Fit, term: &Term) -> Option<Vec<f64>> {
    let edges = term.effect.edges();
    let amplitudes = term.effect.info().amplitudes;
    let m = amplitudes.len();
    if edges.is_empty() || m == 0 {
        return None;
    }
    let length = case
        .records
        .iter()
        .filter(|r| r.role == Role::Train)
        .map(|r| r.len() as f64 * r.h)
        .fold(0.0, f64::max);
    let count = ((length / SHORTEST) as usize).clamp(1, MOST);
    let bin = length / count as f64;
    let at = |bins: (usize, usize)| {
        let mut e = vec![0.0; term.effect.info().parameters.len()];
        for (i, &k) in edges.iter().enumerate() {
            e[k] = match i {
                0 => bins.0 as f64 * bin,
                1 => bins.1 as f64 * bin,
                _ => NEVER,
            };
        }
        e
    };
    let columns: Vec<Vec<f64>> = basis
        .columns
        .column_iter()
        .map(|c| c.iter().copied().collect())
        .collect();
    let rank = columns.len();
    let own: Vec<Direction<'_>> = columns.iter().map(|c| Direction::Theta(c)).collect();
    let plain = linearise(
        case,
        &fit.hypothesis,
        &fit.point,
        &fit.gains,
        Role::Train,
        &own,
    );
    let per_pass = (LANES / m).max(1);
    let blocks: Vec<DMatrix<f64>> = (0..count.div_ceil(per_pass))
        .into_par_iter()
        .map(|pass| {
            let mut hypothesis = fit.hypothesis.clone();
            let mut point = fit.point.clone();
            let mut lanes = Vec::new();
            for b in pass * per_pass..((pass + 1) * per_pass).min(count) {
                lanes.extend(
                    amplitudes
                        .iter()
                        .map(|a| Direction::Effect(point.e.len() + a)),
                );
                hypothesis.terms.push(term.clone());
                point.e.extend(at((b, b + 1)));
            }
            linearise(case, &hypothesis, &point, &fit.gains, Role::Train, &lanes).j
        })
        .collect();
    let rows = plain.r.len();
    let total = rank + count * m;
    let mut j = DMatrix::zeros(rows, total);
    j.columns_mut(0, rank).copy_from(&plain.j);
    let mut next = rank;
    for b in &blocks {
        if b.nrows() != rows {
            return None;
        }
        j.columns_mut(next, b.ncols()).copy_from(b);
        next += b.ncols();
    }
    let mut h = j.tr_mul(&j);
    let largest = (rank..total).map(|i| h[(i, i)]).fold(0.0, f64::max);
    for i in 0..total {
        h[(i, i)] += if i < rank {
            1.0 / (PRIOR * PRIOR)
        } else {
            1e-9 * largest + 1e-300
        };
    }
    let inverse = h.cholesky()?.inverse();
    let x: DVector<f64> = -(&inverse * j.tr_mul(&plain.r));
    let amplitude = |b: usize| x.rows(rank + b * m, m).into_owned();
    let strength: Vec<f64> = (0..count)
        .map(|b| {
            let k = rank + b * m;
            let covariance = inverse.view((k, k), (m, m)).into_owned();
            covariance
                .cholesky()
                .map_or(0.0, |c| amplitude(b).dot(&c.solve(&amplitude(b))))
        })
        .collect();
    let most = strength.iter().copied().fold(0.0, f64::max);
    let on: Vec<bool> = strength
        .iter()
        .map(|s| *s > SIGNIFICANT.0 && *s > SIGNIFICANT.1 * most)
        .collect();
    let mut windows: Vec<(usize, usize, f64)> = Vec::new();
    for b in 0..count {
        match windows.last_mut() {
            Some(w) if on[b] && w.1 == b => {
                w.1 = b + 1;
                w.2 += strength[b];
            }
            _ if on[b] => windows.push((b, b + 1, strength[b])),
            _ => {}
        }
    }
    if windows.is_empty() || on.iter().all(|x| *x) {
        return None;
    }
    windows.sort_by(|a, b| b.2.total_cmp(&a.2));
    windows.truncate(edges.len() / 2);
    windows.sort_by_key(|w| w.0);
    let mut e = at((0, 0));
    let mut mean = DVector::zeros(m);
    let mut weight = 0.0;
    for (w, pair) in windows.iter().zip(edges.chunks_exact(2)) {
        e[pair[0]] = w.0 as f64 * bin;
        e[pair[1]] = w.1 as f64 * bin;
        for b in w.0..w.1 {
            mean += amplitude(b) * strength[b];
            weight += strength[b];
        }
    }
    for pair in edges.chunks_exact(2).skip(windows.len()) {
        (e[pair[0]], e[pair[1]]) = (NEVER, NEVER);
    }
    for (i, &a) in amplitudes.iter().enumerate() {
        e[a] = mean[i] / weight;
    }
    Some(e)
}
