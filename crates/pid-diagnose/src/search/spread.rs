//! How far parameters may be from the truth.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use pid_data::Role;

use super::measure::misfit;
use crate::case::{Case, Record, Velocity};
use crate::criteria::Criteria;
use crate::effect::Term;
use crate::effects::by_id;
use crate::fit::{Basis, Fit, Linear, PRIOR, Quadratic, free_runs};
use crate::predict::rows;

/// The law that makes commands late.
const LATE: &str = "input_delay";

/// Covariances of (θ, e) at a fit.
///
/// Of the scatter of readings there are several; the largest counts. What the clock leaves open
/// comes beside.
pub(super) struct Spread {
    /// From the curvature, widened where the misfit is larger than the noise.
    pub(super) curved: DMatrix<f64>,
    /// From the scores of blocks of time.
    pub(super) blocks: DMatrix<f64>,
    /// From the scores of windows, where parameters were fitted to free runs.
    free: Option<DMatrix<f64>>,
    /// From the moment within its period at which a command acts.
    clock: DMatrix<f64>,
}

impl Spread {
    /// Covariances at a fit, with derivatives of its own.
    ///
    /// A log with uneven stamps has not the clock of the loop: it does not say when within its period
    /// a command acts, nor when a reading was taken. The lateness δ of each joint's commands has the
    /// deviation h/√12 of a moment anywhere within a period h; parameters follow it ("consider"
    /// covariance: S. F. Schmidt, Advances in Control Systems 3, 1966):
    ///
    /// ```text
    /// K (h²/12) Kᵀ,   K = H⁻¹ Jᵀ ∂ε/∂δ
    /// ```
    pub(super) fn new(case: &Case, criteria: &Criteria, fit: &Fit) -> Option<Self> {
        let basis = &every_direction(case);
        let train = case.records.iter().filter(|r| r.role == Role::Train);
        let open = |r: &Record| if r.uneven { r.h } else { 0.0 };
        let h = train.map(open).fold(0.0, f64::max);
        let free = free_run_spread(case, basis, fit);
        if h == 0.0 {
            let own = fit.linearised(case, basis);
            let (predicted, _) = Self::predicted(case, criteria, fit, (basis, &own))?;
            return Some(Self { free, ..predicted });
        }
        let (own, clocks) = linearised(case, basis, fit);
        let (predicted, inverse) = Self::predicted(case, criteria, fit, (basis, &own))?;
        let moved = inverse * widened(basis, fit.point.e.len()) * own.j.tr_mul(&clocks);
        let (size, (starts, _)) = (case.nominal.size(), fit.hypothesis.offsets());
        let mut clock = &moved * moved.transpose();
        // What takes a late reading of the velocity up takes up its moment too, whole.
        for (term, at) in fit.hypothesis.terms.iter().zip(starts) {
            let own = &fit.point.e[at..];
            if term.effect.plain().velocity_lag(own).is_some() {
                clock[(size + at, size + at)] += 1.0;
            }
        }
        Some(Self {
            free,
            clock: clock * (h * h / 12.0),
            ..predicted
        })
    }

    /// What the scatter of predictions alone leaves.
    ///
    /// Borrowed derivatives would make parameters that only a tolerance separates look well
    /// determined; so would the directions of the fit, which leave out what the nominal structure
    /// does not show: a common scale of all forces is nothing to see without the effect, and beside
    /// it all that tolerances leave of its size.
    pub(super) fn of_predictions(case: &Case, criteria: &Criteria, fit: &Fit) -> Option<Self> {
        let basis = &every_direction(case);
        let own = fit.linearised(case, basis);
        Self::predicted(case, criteria, fit, (basis, &own)).map(|(predicted, _)| predicted)
    }

    /// The same with innovations and their derivatives along a basis; and the inverse curvature.
    fn predicted(
        case: &Case,
        criteria: &Criteria,
        fit: &Fit,
        (basis, own): (&Basis, &Linear),
    ) -> Option<(Self, DMatrix<f64>)> {
        let inverse = inverse(Quadratic::new(basis, own, &fit.point).h)?;
        let (blocks, size) = (blocks(case, criteria, own.r.len()), case.nominal.size());
        let wide = widened(basis, fit.point.e.len());
        let predicted = Self {
            blocks: sandwich(&inverse, (&wide, size), own, &blocks),
            curved: &inverse * (misfit(fit).max(1.0) * criteria.shared),
            free: None,
            clock: DMatrix::zeros(inverse.nrows(), inverse.ncols()),
        };
        Some((predicted, inverse))
    }

    /// A variance: the largest of those of readings, and that of the clock.
    pub(super) fn variance(&self, of: impl Fn(&DMatrix<f64>) -> f64) -> f64 {
        let free = self.free.as_ref().map_or(0.0, &of);
        of(&self.curved).max(of(&self.blocks)).max(free) + of(&self.clock)
    }

    /// Standard deviation of the `i`-th of (θ, e).
    pub(super) fn deviation(&self, i: usize) -> f64 {
        self.variance(|c| c[(i, i)]).max(0.0).sqrt()
    }
}

/// All deviations that have a tolerance.
fn every_direction(case: &Case) -> Basis {
    let free: Vec<usize> = (0..case.nominal.size())
        .filter(|&i| case.nominal.values[i].half_width > 0.0)
        .collect();
    let mut columns = DMatrix::zeros(case.nominal.size(), free.len());
    for (c, &i) in free.iter().enumerate() {
        columns[(i, c)] = 1.0;
    }
    Basis { columns }
}

/// Innovations of a fit with their derivatives along a basis and in its parameters, and those in the lateness of
/// each joint's commands: in the one that is fitted, or in one that is zero.
fn linearised(case: &Case, basis: &Basis, fit: &Fit) -> (Linear, DMatrix<f64>) {
    let rank = basis.columns.ncols();
    let (starts, _) = fit.hypothesis.offsets();
    let fitted = |joint: usize| {
        let mut terms = fit.hypothesis.terms.iter().zip(&starts);
        let own = terms.find(|(t, _)| t.joint == joint && t.effect.info().id == LATE);
        own.map(|(_, at)| *at)
    };
    let law = by_id(LATE);
    let prompt = (0..case.n()).filter(|j| fitted(*j).is_none());
    let added: Vec<Term> = prompt
        .filter_map(|joint| {
            let effect = law.clone()?;
            Some(Term { effect, joint })
        })
        .collect();
    // Before all others: these act on what comes late.
    let count = added.len();
    let mut late = fit.clone();
    late.hypothesis.terms.splice(0..0, added);
    late.point.e.splice(0..0, vec![0.0; count]);
    let Linear { r, j } = late.linearised(case, basis);
    let later = (0..case.n()).filter_map(fitted).map(|at| count + at);
    let clocks: Vec<usize> = (0..count).chain(later).map(|at| rank + at).collect();
    let own: Vec<usize> = (0..rank)
        .chain(rank + count..rank + late.point.e.len())
        .collect();
    let clocks = j.select_columns(&clocks);
    let j = j.select_columns(&own);
    (Linear { r, j }, clocks)
}

/// Inverse of a curvature; a parameter without influence has 1.
fn inverse(mut h: DMatrix<f64>) -> Option<DMatrix<f64>> {
    for i in 0..h.nrows() {
        if h[(i, i)] <= 0.0 {
            h[(i, i)] = 1.0;
        }
    }
    Some(h.cholesky()?.inverse())
}

/// The columns of a basis among all deviations, and the parameters of the effects beside them.
fn widened(basis: &Basis, ne: usize) -> DMatrix<f64> {
    let (size, rank) = basis.columns.shape();
    let mut wide = DMatrix::zeros(size + ne, rank + ne);
    wide.view_mut((0, 0), (size, rank))
        .copy_from(&basis.columns);
    for i in 0..ne {
        wide[(size + i, rank + i)] = 1.0;
    }
    wide
}

/// Rows of blocks of time of the train records.
fn blocks(case: &Case, criteria: &Criteria, all: usize) -> Vec<Range<usize>> {
    let channels: usize = (0..case.n())
        .map(|j| 1 + usize::from(case.velocity[j] == Velocity::Measured))
        .sum();
    let (mut out, mut at) = (Vec::new(), 0);
    for record in case.records.iter().filter(|r| r.role == Role::Train) {
        let end = (at + rows(record) * channels).min(all);
        let block = ((criteria.block / record.h) as usize).max(1) * channels;
        while at < end {
            let next = (at + block).min(end);
            out.push(at..next);
            at = next;
        }
    }
    out
}

/// Covariance from the scores of blocks of rows ("sandwich": P. J. Huber, 5th Berkeley Symposium, 1967; blocks of
/// dependent rows: K.-Y. Liang, S. L. Zeger, Biometrika 73, 1986),
///
/// ```text
/// H⁻¹ (Σ_b (s_b − s̄)(s_b − s̄)ᵀ + P) H⁻¹
/// ```
///
/// with `s_b = Σ_{k∈b} J_kᵀ ε_k` and P the curvature of the prior.
fn sandwich(
    inverse: &DMatrix<f64>,
    (wide, size): (&DMatrix<f64>, usize),
    lin: &Linear,
    blocks: &[Range<usize>],
) -> DMatrix<f64> {
    let score = |rows: &Range<usize>| {
        let (at, count) = (rows.start, rows.len());
        lin.j.rows(at, count).transpose() * lin.r.rows(at, count)
    };
    let scores: Vec<DVector<f64>> = blocks.iter().map(score).collect();
    let (count, own) = (scores.len() as f64, wide.ncols());
    let mean = scores.iter().fold(DVector::zeros(own), |a, s| a + s) / count.max(1.0);
    let mut meat = DMatrix::zeros(own, own);
    for s in &scores {
        let d = s - &mean;
        meat.ger(1.0, &d, &d, 1.0);
    }
    meat *= count / (count - 1.0).max(1.0);
    let mut middle = wide * meat * wide.transpose();
    // The effects' parameters come last and have no prior.
    for i in 0..size {
        middle[(i, i)] += 1.0 / (PRIOR * PRIOR);
    }
    inverse * middle * inverse
}

/// Covariance of parameters that were fitted to free runs, from the scores of their windows; `None` for others.
fn free_run_spread(case: &Case, basis: &Basis, fit: &Fit) -> Option<DMatrix<f64>> {
    if !fit.to_free_runs {
        return None;
    }
    let (lin, windows) = free_runs(case, basis, fit);
    let inverse = inverse(Quadratic::new(basis, &lin, &fit.point).h)?;
    let wide = widened(basis, fit.point.e.len());
    Some(sandwich(
        &inverse,
        (&wide, case.nominal.size()),
        &lin,
        &windows,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, named, pendulum};
    use crate::fit::{Effort, Point, basis, fit};

    /// Deviation of the first parameter of an effect at its truth.
    fn deviation(id: &str, e: &[f64], (uneven, free): (bool, bool)) -> (Spread, f64) {
        let effect = named(&[id]);
        let mut case = pendulum(&effect, e, 6.0, &|_| {});
        case.records.iter_mut().for_each(|r| r.uneven = uneven);
        let at = Point {
            theta: vec![0.0; SIZE],
            e: e.to_vec(),
        };
        let mut own = fit(&case, &basis(&case), &effect, at, Effort::full(4));
        own.to_free_runs = free;
        let spread = Spread::new(&case, &Criteria::default(), &own).expect("a covariance");
        let deviation = spread.deviation(SIZE);
        (spread, deviation)
    }

    #[test]
    fn with_a_clock_of_its_own_a_log_tells_a_delay_to_a_part_of_a_sample() {
        // Samples are 2 ms apart.
        let part = 2e-3 / 12.0_f64.sqrt();
        let (_, own) = deviation("input_delay", &[0.006], (true, false));
        assert!((part..1.2 * part).contains(&own), "{own} of {part}");
        let (_, own) = deviation("input_delay", &[0.006], (false, false));
        assert!(own < 0.2 * part, "{own} of {part}");
        let (_, own) = deviation("velocity_filter_lag", &[0.01], (true, false));
        assert!((part..1.2 * part).contains(&own), "{own} of {part}");
        // A late reading of the only joint is the same as a late command.
        let (_, own) = deviation("sensor_delay", &[0.006], (true, false));
        assert!((0.8 * part..1.5 * part).contains(&own), "{own} of {part}");
    }

    #[test]
    fn what_is_fitted_to_free_runs_scatters_as_they_do() {
        let (predicted, _) = deviation("quadratic_drag", &[0.05], (false, false));
        let (run, own) = deviation("quadratic_drag", &[0.05], (false, true));
        assert!(predicted.free.is_none());
        let free = run.free.expect("of free runs")[(SIZE, SIZE)].sqrt();
        assert!(free > 0.0 && own >= free, "{own} {free}");
        // Predictions use all that the readings tell.
        assert!(
            free > 0.8 * predicted.curved[(SIZE, SIZE)].sqrt() / Criteria::default().shared.sqrt()
        );
    }
}
