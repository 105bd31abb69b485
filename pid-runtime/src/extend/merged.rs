//! Patterns of a model with the entries of its terms.

use super::term::Term;
use crate::dynamics::{Dims, Pattern};
use crate::term::ARGUMENTS;

/// Share of a term in an entry of a derivative: which part of φ's derivatives, and where it goes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Share {
    pub(super) slot: usize,
    pub(super) part: Part,
}

/// A part of the derivatives of φ.
#[derive(Debug, Clone, Copy)]
pub(super) enum Part {
    /// φ.
    Value,
    /// c ∂φ/∂x_i.
    Scaled(usize),
    /// ∂φ/∂x_i.
    Gradient(usize),
    /// c ∂²φ/∂x_i∂x_j.
    Curvature(usize, usize),
}

/// The model's pattern with the terms' entries merged in.
pub(super) struct Merged {
    pub(super) rows: Vec<u32>,
    pub(super) cols: Vec<u32>,
    /// Slot of each entry of the model, increasing.
    pub(super) inner: Vec<usize>,
    /// Shares of each term.
    pub(super) shares: Vec<Vec<Share>>,
}

impl Merged {
    /// `own`: places of the model's entries.
    pub(super) fn new(own: Vec<(u32, u32)>, entries: &[Vec<((u32, u32), Part)>]) -> Self {
        let mut all = own.clone();
        all.extend(entries.iter().flatten().map(|(place, _)| *place));
        all.sort_unstable();
        all.dedup();
        let slot = |place: &(u32, u32)| {
            all.binary_search(place)
                .expect("invariant: every place was put in above")
        };
        Self {
            inner: own.iter().map(slot).collect(),
            shares: entries
                .iter()
                .map(|term| {
                    term.iter()
                        .map(|(place, part)| Share {
                            slot: slot(place),
                            part: *part,
                        })
                        .collect()
                })
                .collect(),
            rows: all.iter().map(|p| p.0).collect(),
            cols: all.iter().map(|p| p.1).collect(),
        }
    }

    /// All entries.
    pub(super) fn pattern(&self) -> Pattern<'_> {
        Pattern {
            rows: &self.rows,
            cols: &self.cols,
        }
    }

    /// Moves the model's values, written at the front, to their slots; zero elsewhere.
    pub(super) fn spread(&self, values: &mut [f64]) {
        let total = self.rows.len();
        let mut end = total;
        for (i, &slot) in self.inner.iter().enumerate().rev() {
            let value = values[i];
            values[slot + 1..end].fill(0.0);
            values[slot] = value;
            end = slot;
        }
        values[..end].fill(0.0);
    }
}

/// Entries of a term in ∂r/∂z.
pub(super) fn jacobian_entries(term: &Term, dims: Dims) -> Vec<((u32, u32), Part)> {
    let mut entries = Vec::new();
    let depends = term.law.depends();
    for &row in &term.joints {
        entries.push((pair(row, dims.p() + term.coefficient), Part::Value));
        for i in (0..ARGUMENTS).filter(|&i| depends[i]) {
            for z in term.places(i, dims) {
                entries.push((pair(row, z), Part::Scaled(i)));
            }
        }
    }
    entries
}

/// Entries of a term in the lower triangle of ∂²(λᵀr)/∂z².
pub(super) fn hessian_entries(term: &Term, dims: Dims) -> Vec<((u32, u32), Part)> {
    let mut entries = Vec::new();
    let depends = term.law.depends();
    let used: Vec<(usize, usize)> = (0..ARGUMENTS)
        .filter(|&i| depends[i])
        .flat_map(|i| term.places(i, dims).into_iter().map(move |z| (i, z)))
        .collect();
    let c = dims.p() + term.coefficient;
    for &(i, z) in &used {
        entries.push((pair(c.max(z), c.min(z)), Part::Gradient(i)));
        if term.law.linear() {
            continue;
        }
        for &(j, y) in used.iter().filter(|(_, y)| *y <= z) {
            entries.push((pair(z, y), Part::Curvature(i, j)));
        }
    }
    entries
}

fn pair(row: usize, col: usize) -> (u32, u32) {
    (row as u32, col as u32)
}
