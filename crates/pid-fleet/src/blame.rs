//! What the matter is with a unit: which single quantity, or which cause that moves several, explains its shift best.
//!
//! A shift `d` of the quantities, with covariance V, under a cause that moves them along `g` by an unknown amount: the
//! best amount is `gᵀV⁻¹d / gᵀV⁻¹g`, and `(gᵀV⁻¹d)² / gᵀV⁻¹g` of `dᵀV⁻¹d` is explained.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use serde::{Deserialize, Serialize};

use crate::plan::Plan;

/// Shifts beyond so many deviations count as that many in correlations.
const CUT: f64 = 2.5;
/// A rival that explains at least this share of what the best one does is named too.
const RIVAL: f64 = 0.9;
/// Rivals that are named at most.
const RIVALS: usize = 3;
/// What explains less than this share explains nothing, and a residual that stands out speaks for itself.
const EXPLAINS: f64 = 0.5;
/// A residual stands out beyond so many deviations.
const STANDS_OUT: f64 = 5.0;

/// What may be the matter with a unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Suspect {
    /// Name of a quantity or a cause.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// By how much it differs.
    pub amount: f64,
    /// Deviation of that.
    pub deviation: f64,
    /// Share of the unit's shift that it explains, 0 to 1.
    pub explains: f64,
}

/// Correlation of the quantities in healthy units.
pub(crate) struct Correlation(DMatrix<f64>);

impl Correlation {
    /// From rows of shifts in deviations; few rows count little.
    pub(crate) fn of(rows: &[Vec<f64>], quantities: usize) -> Self {
        let cut = |x: f64| x.clamp(-CUT, CUT);
        let mut sum = DMatrix::zeros(quantities, quantities);
        for row in rows {
            let z = DVector::from_iterator(quantities, row.iter().map(|x| cut(*x)));
            sum.ger(1.0, &z, &z, 1.0);
        }
        let share = rows.len() as f64 / (rows.len() + quantities) as f64;
        Self(DMatrix::from_fn(quantities, quantities, |i, j| {
            let size = (sum[(i, i)] * sum[(j, j)]).sqrt();
            match (i == j, size > 0.0) {
                (true, _) => 1.0,
                (false, true) => share * sum[(i, j)] / size,
                (false, false) => 0.0,
            }
        }))
    }

    /// Factor of the covariance with these deviations on the diagonal.
    fn factor(&self) -> Option<Cholesky<f64, Dyn>> {
        self.0.clone().cholesky()
    }
}

/// The residual that grows most, if it stands out.
fn residual<'p>(plan: &'p Plan, shift: &DVector<f64>) -> Option<&'p String> {
    let of_residuals = plan.quantities.iter().zip(shift.iter());
    of_residuals
        .filter(|(q, z)| plan.is_residual(&q.name) && **z > STANDS_OUT)
        .max_by(|a, b| a.1.total_cmp(b.1))
        .map(|(q, _)| &q.name)
}

/// What explains a shift, best first: those that explain nearly as much as the best. Where nothing explains half of it
/// and a residual grows, that residual comes first: the unit has something without a name.
pub(crate) fn suspects(
    plan: &Plan,
    correlation: &Correlation,
    shift: &[f64],
    deviations: &[f64],
) -> Vec<Suspect> {
    let Some(factor) = correlation.factor() else {
        return Vec::new();
    };
    let n = shift.len();
    let scaled = |x: &[f64]| DVector::from_fn(n, |i, _| x[i] / deviations[i]);
    let d = scaled(shift);
    let solved = factor.solve(&d);
    let whole = d.dot(&solved);
    let judge = |name: &str, unit: &str, moves: &[f64]| {
        let g = scaled(moves);
        let precision = g.dot(&factor.solve(&g));
        let projection = g.dot(&solved);
        (precision > 0.0 && whole > 0.0).then(|| Suspect {
            name: name.to_owned(),
            unit: unit.to_owned(),
            amount: projection / precision,
            deviation: precision.sqrt().recip(),
            explains: projection * projection / precision / whole,
        })
    };
    let singles = plan.quantities.iter().enumerate().map(|(k, quantity)| {
        let mut along = vec![0.0; n];
        along[k] = 1.0;
        judge(&quantity.name, &quantity.unit, &along)
    });
    let causes = plan.causes.iter();
    let causes = causes.map(|cause| judge(&cause.name, &cause.unit, &cause.moves));
    let mut all: Vec<Suspect> = singles.chain(causes).flatten().collect();
    // Less than the usual residual is nothing that is the matter.
    let less = |s: &Suspect| s.amount < 0.0 && plan.is_residual(&s.name);
    all.retain(|s| !less(s));
    all.sort_by(|a, b| b.explains.total_cmp(&a.explains));
    let best = all.first().map_or(0.0, |s| s.explains);
    let unnamed = residual(plan, &d).filter(|_| best < EXPLAINS);
    if let Some(name) = unnamed
        && let Some(at) = all.iter().position(|s| s.name == *name)
    {
        let first = all.remove(at);
        all.insert(0, first);
    }
    all.retain(|s| Some(&s.name) == unnamed || s.explains >= RIVAL * best);
    all.truncate(RIVALS);
    all
}
