//! Weighted least squares on the normal equations, with deviations by the delete-a-block jackknife.
//!
//! Weights are one over the residual variance of each joint, settled in a few passes (IDIM-LS). The
//! covariance `(Σ ω_j A_j)⁻¹` of that fit holds for white residuals of a right model. Residuals of
//! real robots are neither white nor those of a right model, so the printed deviations come from
//! leaving out one block of time after another,
//!
//! ```text
//! cov = (B − 1)/B Σ_k (β₍ₖ₎ − β̄)(β₍ₖ₎ − β̄)ᵀ          (H. R. Künsch, Ann. Statist. 17, 1989, for blocks)
//! ```
//!
//! which needs no model of the residual's correlation within a block and no equal variances between blocks.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::regress::base::Base;
use crate::regress::normal::{Normal, Sums};

/// Passes of the weights.
const PASSES: usize = 4;

/// Why a regression cannot be done.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RegressionError {
    /// No samples.
    #[error("no samples are left after filtering\n  help: use longer records, or a higher cut-off")]
    NoSamples,
    /// The model has no linear parameter.
    #[error(
        "`{model}` has no free parameter in which its residual is linear\n  help: use `simtrue identify`"
    )]
    NothingLinear {
        /// The model.
        model: String,
    },
    /// The drives' forces do not enter: zero solves the equations.
    #[error(
        "all terms of the equations are free, so zero solves them\n  help: hold the gain of a drive or the mass of a link"
    )]
    Homogeneous,
    /// Not finite.
    #[error(
        "the normal equations are not finite\n  help: check the records for implausible values"
    )]
    NotFinite,
}

/// How the joints are weighed against each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum JointWeights {
    /// Each by one over its own residual variance.
    #[default]
    Variance,
    /// All alike, by one over the residual variance of all together: the residual of all joints
    /// together is the least.
    Common,
}

/// Prior knowledge of an unknown: a normal distribution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Belief {
    /// Its column.
    pub column: usize,
    /// Mean.
    pub mean: f64,
    /// Standard deviation, positive.
    pub deviation: f64,
}

/// Inputs of a least-squares fit beside its normal equations.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct How {
    /// Weights of the joints.
    pub weights: JointWeights,
    /// Prior knowledge: each counts as one more residual, the deviation its noise.
    pub beliefs: Vec<Belief>,
    /// Standard deviation of the gain of each joint's drive, as a share of it; empty if the gains
    /// are known. A wrong gain scales the force of its drive in all records alike, so no residual
    /// shows it.
    pub gains: Vec<f64>,
}

impl How {
    /// Adds the priors to weighted normal equations.
    pub(crate) fn believe(&self, a: &mut DMatrix<f64>, b: &mut DVector<f64>) {
        for belief in &self.beliefs {
            let precision = belief.deviation.powi(-2);
            a[(belief.column, belief.column)] += precision;
            b[belief.column] += precision * belief.mean;
        }
    }
}

/// Values of the base parameters and how well they are known.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// The combinations.
    pub base: Base,
    /// Their values β.
    pub beta: DVector<f64>,
    /// Their covariance under white residuals of the fitted variances.
    pub white: DMatrix<f64>,
    /// Their covariance by the jackknife, or `white` with fewer than three blocks; plus the
    /// covariance from the gains' deviations.
    pub covariance: DMatrix<f64>,
    /// Weight of each joint: one over its residual variance.
    pub weights: Vec<f64>,
}

impl Solution {
    /// Standard deviation of each β.
    pub fn deviations(&self) -> Vec<f64> {
        (0..self.beta.len())
            .map(|i| self.covariance[(i, i)].max(0.0).sqrt())
            .collect()
    }
}

/// Weighted sum of the joints' normal equations.
pub(crate) fn weighted(sums: &[Sums], weights: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
    let n = sums.first().map_or(0, |s| s.b.len());
    let (mut a, mut b) = (DMatrix::zeros(n, n), DVector::zeros(n));
    for (sum, w) in sums.iter().zip(weights) {
        a += *w * &sum.a;
        b += *w * &sum.b;
    }
    (a, b)
}

/// The base system of all columns: rows and columns of `independent`, scaled to a unit diagonal.
struct Reduced {
    factor: Cholesky<f64, Dyn>,
    scale: Vec<f64>,
}

impl Reduced {
    fn new(a: &DMatrix<f64>, columns: &[usize]) -> Option<Self> {
        let scale: Vec<f64> = columns
            .iter()
            .map(|&i| match a[(i, i)] {
                d if d > 0.0 => d.sqrt().recip(),
                _ => 1.0,
            })
            .collect();
        let n = columns.len();
        let matrix = DMatrix::from_fn(n, n, |i, j| {
            a[(columns[i], columns[j])] * scale[i] * scale[j]
        });
        Some(Self {
            factor: matrix.cholesky()?,
            scale,
        })
    }

    fn solve(&self, b: &DVector<f64>, columns: &[usize]) -> DVector<f64> {
        let right = DVector::from_fn(columns.len(), |i, _| b[columns[i]] * self.scale[i]);
        let mut x = self.factor.solve(&right);
        x.iter_mut().zip(&self.scale).for_each(|(x, s)| *x *= s);
        x
    }

    fn inverse(&self) -> DMatrix<f64> {
        let mut inverse = self.factor.inverse();
        for i in 0..self.scale.len() {
            for j in 0..self.scale.len() {
                inverse[(i, j)] *= self.scale[i] * self.scale[j];
            }
        }
        inverse
    }
}

/// Weighted sum of the joints' normal equations and of the priors.
fn believed(sums: &[Sums], weights: &[f64], how: &How) -> (DMatrix<f64>, DVector<f64>) {
    let (mut a, mut b) = weighted(sums, weights);
    how.believe(&mut a, &mut b);
    (a, b)
}

/// β on given combinations from given sums and weights.
fn beta(base: &Base, sums: &[Sums], weights: &[f64], how: &How) -> Option<DVector<f64>> {
    let (a, b) = believed(sums, weights, how);
    let reduced = Reduced::new(&a, &base.independent)?;
    Some(reduced.solve(&b, &base.independent))
}

/// β as values of all columns: those that depend on others are zero.
pub(crate) fn as_columns(base: &Base, beta: &DVector<f64>, columns: usize) -> DVector<f64> {
    let mut p = DVector::zeros(columns);
    for (&i, value) in base.independent.iter().zip(beta.iter()) {
        p[i] = *value;
    }
    p
}

/// Values without deviations.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// The combinations.
    pub base: Base,
    /// Their values β.
    pub beta: DVector<f64>,
    /// Weight of each joint.
    pub weights: Vec<f64>,
}

impl Estimate {
    /// β as values of all columns: those that depend on others are zero.
    pub fn columns(&self) -> DVector<f64> {
        let columns = self.base.independent.len() + self.base.dependent.len();
        as_columns(&self.base, &self.beta, columns)
    }
}

/// The values alone, from the sums of each joint.
///
/// # Errors
/// [`RegressionError`].
pub fn estimate(total: &[Sums], how: &How) -> Result<Estimate, RegressionError> {
    check(total)?;
    let weigh = |squares: Vec<(f64, f64)>| -> Vec<f64> {
        match how.weights {
            JointWeights::Variance => squares.iter().map(|(s, n)| reciprocal(s / n)).collect(),
            JointWeights::Common => {
                let (s, n) = squares
                    .iter()
                    .fold((0.0, 0.0), |(s, n), x| (s + x.0, n + x.1));
                vec![reciprocal(s / n); squares.len()]
            }
        }
    };
    let mut weights = weigh(total.iter().map(|s| (s.c, s.count as f64)).collect());
    let mut base = Base::of(&believed(total, &weights, how).0);
    let mut value = DVector::zeros(base.rank());
    for pass in 0..PASSES {
        value = beta(&base, total, &weights, how).ok_or(RegressionError::NotFinite)?;
        if pass + 1 < PASSES {
            let columns = base.independent.len() + base.dependent.len();
            let p = as_columns(&base, &value, columns);
            // Each joint takes its share of the unknowns.
            let lost = base.rank() as f64 / total.len() as f64;
            let squares = total
                .iter()
                .map(|s| (s.residual(&p), (s.count as f64 - lost).max(1.0)));
            weights = weigh(squares.collect());
            base = Base::of(&believed(total, &weights, how).0);
        }
    }
    Ok(Estimate {
        base,
        beta: value,
        weights,
    })
}

/// Solves the regression.
///
/// # Errors
/// [`RegressionError`].
pub fn solve(normal: &Normal, how: &How) -> Result<Solution, RegressionError> {
    let total = normal.total(|_| true);
    let Estimate {
        base,
        beta,
        weights,
    } = estimate(&total, how)?;
    let (a, _) = believed(&total, &weights, how);
    let reduced = Reduced::new(&a, &base.independent).ok_or(RegressionError::NotFinite)?;
    let white = reduced.inverse();
    let mut covariance =
        jackknife(normal, &base, &weights, &total, how).unwrap_or_else(|| white.clone());
    for ((sum, weight), deviation) in total.iter().zip(&weights).zip(&how.gains) {
        // Least squares are linear in the forces: exact under given weights.
        let moved = reduced.solve(&(*weight * &sum.driven), &base.independent);
        covariance += deviation.powi(2) * &moved * moved.transpose();
    }
    Ok(Solution {
        base,
        beta,
        white,
        covariance,
        weights,
    })
}

fn check(total: &[Sums]) -> Result<(), RegressionError> {
    if total.iter().all(|s| s.count == 0) {
        return Err(RegressionError::NoSamples);
    }
    if !total
        .iter()
        .all(|s| s.c.is_finite() && s.a.iter().chain(s.b.iter()).all(|x| x.is_finite()))
    {
        return Err(RegressionError::NotFinite);
    }
    if total.iter().all(|s| s.c == 0.0) {
        return Err(RegressionError::Homogeneous);
    }
    Ok(())
}

fn reciprocal(variance: f64) -> f64 {
    if variance > 0.0 && variance.is_finite() {
        variance.recip()
    } else {
        1.0
    }
}

/// Covariance by leaving out one block after another; `None` with fewer than three blocks, or if
/// the remaining blocks do not determine the combinations.
fn jackknife(
    normal: &Normal,
    base: &Base,
    weights: &[f64],
    total: &[Sums],
    how: &How,
) -> Option<DMatrix<f64>> {
    let blocks = normal.blocks.len();
    if blocks < 3 {
        return None;
    }
    let (a, b) = believed(total, weights, how);
    let estimates: Option<Vec<DVector<f64>>> = normal
        .blocks
        .par_iter()
        .map(|block| {
            let (own_a, own_b) = weighted(&normal.joints(block), weights);
            let reduced = Reduced::new(&(&a - own_a), &base.independent)?;
            Some(reduced.solve(&(&b - own_b), &base.independent))
        })
        .collect();
    Some(scatter(&estimates?, (blocks - 1) as f64 / blocks as f64))
}

/// `factor Σ (x − x̄)(x − x̄)ᵀ`.
pub(crate) fn scatter(estimates: &[DVector<f64>], factor: f64) -> DMatrix<f64> {
    let n = estimates[0].len();
    let mut mean = DVector::zeros(n);
    estimates.iter().for_each(|e| mean += e);
    mean /= estimates.len() as f64;
    let mut out = DMatrix::zeros(n, n);
    for e in estimates {
        let d = e - &mean;
        out += factor * &d * d.transpose();
    }
    out
}

/// Quantiles 2.5 % and 97.5 % of each β over blocks drawn with replacement, record by record
/// (stratified block bootstrap).
///
/// Draws whose blocks do not determine the combinations are left out; `None` if fewer than half are left.
pub fn bootstrap(
    normal: &Normal,
    solution: &Solution,
    how: &How,
    draws: usize,
    seed: u64,
) -> Option<Vec<(f64, f64)>> {
    let mut by_record: Vec<Vec<usize>> = vec![Vec::new(); normal.records.len()];
    for (i, block) in normal.blocks.iter().enumerate() {
        by_record[block.record].push(i);
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let positions: Vec<Vec<usize>> = (0..draws)
        .map(|_| {
            by_record
                .iter()
                .filter(|r| !r.is_empty())
                .flat_map(|r| {
                    (0..r.len())
                        .map(|_| r[random.random_range(0..r.len())])
                        .collect::<Vec<_>>()
                })
                .collect()
        })
        .collect();
    let estimates: Vec<DVector<f64>> = positions
        .par_iter()
        .filter_map(|at| {
            let sums = normal.resampled(at).total(|_| true);
            beta(&solution.base, &sums, &solution.weights, how)
        })
        .collect();
    if estimates.len() * 2 < draws.max(1) {
        return None;
    }
    Some(
        (0..solution.beta.len())
            .map(|i| {
                let mut values: Vec<f64> = estimates.iter().map(|e| e[i]).collect();
                values.sort_by(f64::total_cmp);
                let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
                (at(0.025), at(0.975))
            })
            .collect(),
    )
}

/// β of each record by itself on the combinations of the whole, with deviations; `None` where a
/// record alone does not determine them.
pub fn per_record(normal: &Normal, solution: &Solution) -> Vec<Option<Agreement>> {
    let alone = How::default();
    (0..normal.records.len())
        .map(|record| {
            let own = normal.of_record(record);
            let total = own.total(|_| true);
            let value = beta(&solution.base, &total, &solution.weights, &alone)?;
            let covariance = jackknife(&own, &solution.base, &solution.weights, &total, &alone)?;
            let deviations = (0..value.len())
                .map(|i| covariance[(i, i)].max(0.0).sqrt())
                .collect();
            Some(Agreement {
                beta: value.iter().copied().collect(),
                deviations,
            })
        })
        .collect()
}

/// Values from one record alone.
#[derive(Debug, Clone, PartialEq)]
pub struct Agreement {
    /// β.
    pub beta: Vec<f64>,
    /// Standard deviations.
    pub deviations: Vec<f64>,
}

/// RMS residual of each joint, and the same over the RMS of the drive's force (`None` where the
/// drive does not act), at values of all linear parameters.
pub fn residuals(
    normal: &Normal,
    p: &DVector<f64>,
    choice: impl Fn(&crate::regress::normal::Block) -> bool,
) -> Vec<(f64, Option<f64>)> {
    normal
        .total(choice)
        .iter()
        .map(|s| {
            let square = s.residual(p);
            let rms = (square / s.count.max(1) as f64).sqrt();
            (rms, (s.drive > 0.0).then(|| (square / s.drive).sqrt()))
        })
        .collect()
}

/// The residual of all joints together over the drives' forces together.
pub fn overall(
    normal: &Normal,
    p: &DVector<f64>,
    choice: impl Fn(&crate::regress::normal::Block) -> bool,
) -> Option<f64> {
    let total = normal.total(choice);
    let (square, drive) = total
        .iter()
        .fold((0.0, 0.0), |(s, d), j| (s + j.residual(p), d + j.drive));
    (drive > 0.0).then(|| (square / drive).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::regress::columns::LinearModel;
    use crate::regress::record::{Filtering, Record};
    use pid_data::{Experiment, InputHold, Role};
    use pid_models::Emps;
    use pid_runtime::dynamics::Dynamics;

    /// A motion of a known carriage with white force noise; `correlated` smooths the noise over time.
    fn record(seed: u64, noise: f64, correlated: f64) -> Record {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let n = 4000;
        let (mut t, mut q, mut u) = (Vec::new(), Vec::new(), Vec::new());
        let mut e = 0.0;
        for i in 0..n {
            let time = 1e-3 * i as f64;
            let (w1, w2) = (3.0, 7.1);
            let x = 0.1 * (w1 * time).sin() + 0.05 * (w2 * time).cos();
            let v = 0.1 * w1 * (w1 * time).cos() - 0.05 * w2 * (w2 * time).sin();
            let a = -0.1 * w1 * w1 * (w1 * time).sin() - 0.05 * w2 * w2 * (w2 * time).cos();
            // The mean of three uniform numbers is close enough to normal.
            let white: f64 = (0..3).map(|_| random.random_range(-1.0..1.0)).sum();
            e = correlated * e + (1.0 - correlated * correlated).sqrt() * white;
            t.push(time);
            q.push(x);
            u.push(90.0 * a + 200.0 * v + 20.0 * (50.0 * v).tanh() - 3.0 + noise * e);
        }
        let experiment = Experiment {
            name: "made".into(),
            role: Role::Train,
            note: String::new(),
            nq: 1,
            t,
            q,
            v: None,
            u,
            tau: None,
            qref: None,
            missing: 0,
            gain_factors: Default::default(),
        };
        let filtering = Filtering {
            cutoff: Some(60.0),
            decimate: None,
        };
        Record::new(&experiment, InputHold::Linear, filtering).unwrap()
    }

    fn split() -> LinearModel<'static> {
        let p: Vec<f64> = Emps
            .params()
            .iter()
            .map(|i| {
                if i.name.starts_with("sharp") {
                    50.0
                } else {
                    i.nominal
                }
            })
            .collect();
        LinearModel::new(&Emps, &p, &[])
    }

    #[test]
    fn the_known_carriage_is_found() {
        let model = split();
        let normal = Normal::new(&model, &[record(1, 0.0, 0.0)], None);
        let solution = solve(&normal, &How::default()).unwrap();
        assert_eq!(solution.base.rank(), 4);
        for (value, truth) in solution.beta.iter().zip([90.0, 200.0, 20.0, -3.0]) {
            assert!((value / truth - 1.0).abs() < 5e-3, "{value} {truth}");
        }
    }

    #[test]
    fn deviations_cover_the_scatter_of_repeated_records() {
        // Under correlated noise the deviations for white residuals are far too small, those of the
        // jackknife are not.
        let model = split();
        let runs: Vec<(f64, f64, f64)> = (0..60)
            .map(|seed| {
                let normal = Normal::new(&model, &[record(100 + seed, 4.0, 0.97)], None);
                let s = solve(&normal, &How::default()).unwrap();
                (s.beta[0], s.deviations()[0], s.white[(0, 0)].sqrt())
            })
            .collect();
        let mean = runs.iter().map(|r| r.0).sum::<f64>() / runs.len() as f64;
        let scatter = (runs.iter().map(|r| (r.0 - mean).powi(2)).sum::<f64>()
            / (runs.len() - 1) as f64)
            .sqrt();
        let typical = |f: fn(&(f64, f64, f64)) -> f64| {
            (runs.iter().map(|r| f(r).powi(2)).sum::<f64>() / runs.len() as f64).sqrt()
        };
        let jackknife = typical(|r| r.1);
        assert!(
            (jackknife / scatter - 1.0).abs() < 0.35,
            "{jackknife} {scatter}"
        );
        assert!(typical(|r| r.2) < 0.6 * scatter);
    }

    #[test]
    fn bootstrap_and_jackknife_agree() {
        let normal = Normal::new(&split(), &[record(7, 4.0, 0.5), record(8, 4.0, 0.5)], None);
        let solution = solve(&normal, &How::default()).unwrap();
        let quantiles = bootstrap(&normal, &solution, &How::default(), 400, 3).unwrap();
        for ((low, high), deviation) in quantiles.iter().zip(solution.deviations()) {
            let half = 0.5 * (high - low);
            assert!(
                half > 1.96 * deviation / 1.7 && half < 1.96 * deviation * 1.7,
                "{half} {deviation}"
            );
        }
    }

    #[test]
    fn nothing_to_solve_is_said() {
        let normal = Normal::new(&split(), &[], None);
        assert_eq!(
            solve(&normal, &How::default()).unwrap_err(),
            RegressionError::NoSamples
        );
    }
}
