//! Instrumental variables. Noise in the records that the loop feeds back biases least squares;
//! instruments that share none of it do not.
//!
//! ```text
//! β = (Σ_j ω_j Z_jᵀ Y_j)⁻¹ Σ_j ω_j Z_jᵀ (−r₀_j)
//! ```
//!
//! Y is the regressor at the measured motion. The instruments Z are the regressor at a motion of
//! the *model*: the declared closed loop follows the same commands with the last β, simulated
//! without noise, and passes the same filters. A few rounds settle it (IDIM-IV; A. Janot, P.-O.
//! Vandanjon, M. Gautier, IEEE Trans. Control Syst. Technol. 22, 2014).

use crate::integrate::{self, Drive, SimulateError};
use nalgebra::{DMatrix, DVector};
use pid_data::signal::{SignalError, state_from_data};
use pid_data::{Dataset, Experiment, Role};
use pid_runtime::dynamics::Hessian;
use rayon::prelude::*;

use crate::regress::base::Base;
use crate::regress::columns::LinearModel;
use crate::regress::normal::filtered_at;
use crate::regress::record::Record;
use crate::regress::solution::{Solution, scatter};
use crate::wrap::controllers::{ControlError, Controllers};
use pid_runtime::control::ClosedLoop;
use pid_runtime::extend::Extended;

/// Most rounds.
const ROUNDS: usize = 10;
/// Change of β relative to its deviation at which the rounds end.
const SETTLED: f64 = 1e-2;
/// Blocks a record is cut into, for the jackknife.
const BLOCKS: usize = 12;

/// Why instruments cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InstrumentError {
    /// The controllers do not fit.
    #[error(transparent)]
    Control(#[from] ControlError),
    /// The closed loop cannot be simulated.
    #[error(
        "the closed loop of record `{record}` cannot be simulated with the last estimate: {error}\n  help: check gains, limits and the sign of the input in the controller's file"
    )]
    Simulate {
        /// The record.
        record: String,
        /// Why.
        error: SimulateError,
    },
    /// The simulated motion cannot be filtered.
    #[error(transparent)]
    Signal(#[from] SignalError),
    /// The instruments do not span the combinations.
    #[error(
        "the simulated motions do not excite the combinations that the measured ones do\n  help: check the controller's file; compare the closed loop with the records by `simtrue simulate --controller`"
    )]
    Singular,
}

/// Outcome of the rounds.
#[derive(Debug, Clone, PartialEq)]
pub struct Rounds {
    /// Rounds taken.
    pub rounds: usize,
    /// Whether β settled.
    pub settled: bool,
    /// RMS difference between simulated and measured positions over all records and joints,
    /// relative to their spread, in the last round. Instruments are only as good as the model
    /// follows the records.
    pub distance: f64,
}

/// Cross products of one block: Z_jᵀ Y_j and −Z_jᵀ r₀_j, weighted and summed over the joints.
struct Cross {
    a: DMatrix<f64>,
    b: DVector<f64>,
}

/// Replaces β and its covariance in a least-squares solution by those of instrumental variables.
///
/// `full` makes all parameters of β; rows slower than `rest` are left out as in the regression.
///
/// # Errors
/// [`InstrumentError`].
pub fn refine(
    model: &LinearModel<'_>,
    dataset: &Dataset,
    records: &[Record],
    rest: &[f64],
    controllers: &Controllers,
    full: &dyn Fn(&DVector<f64>) -> Vec<f64>,
    solution: &mut Solution,
) -> Result<Rounds, InstrumentError> {
    let closed = controllers.close(dataset.clone())?;
    let plain = Extended::new(model.model(), &[]).map_err(|_| InstrumentError::Singular)?;
    let with_loop = ClosedLoop::new(Box::new(plain)).map_err(ControlError::from)?;
    let experiments: Vec<&Experiment> = closed
        .experiments
        .iter()
        .filter(|e| e.role == Role::Train)
        .collect();
    let mut out = Rounds {
        rounds: 0,
        settled: false,
        distance: f64::NAN,
    };
    while out.rounds < ROUNDS && !out.settled {
        out.rounds += 1;
        let p = full(&solution.beta);
        let motions: Vec<(Vec<Cross>, f64)> = records
            .par_iter()
            .zip(&experiments)
            .map(|(record, experiment)| {
                let simulated = simulate(&with_loop, &p, &closed, experiment)?;
                let distance = distance(&simulated, experiment);
                let state = state_from_data(&simulated, Some(record.cutoff))?;
                let z = filtered_at(model, record, &state.q, &state.v, &state.a);
                let y = filtered_at(model, record, &record.q, &record.v, &record.a);
                let weights = &solution.weights;
                Ok((
                    blocks(model, record, (&z, &y), rest, weights, &solution.base),
                    distance,
                ))
            })
            .collect::<Result<_, InstrumentError>>()?;
        out.distance =
            (motions.iter().map(|(_, d)| d * d).sum::<f64>() / motions.len().max(1) as f64).sqrt();
        let blocks: Vec<Cross> = motions.into_iter().flat_map(|(b, _)| b).collect();
        let (beta, covariance) = solve(&blocks).ok_or(InstrumentError::Singular)?;
        let change = (0..beta.len())
            .map(|i| {
                let deviation = covariance[(i, i)].max(0.0).sqrt();
                (beta[i] - solution.beta[i]).abs() / deviation.max(f64::MIN_POSITIVE)
            })
            .fold(0.0_f64, f64::max);
        out.settled = change < SETTLED;
        solution.beta = beta;
        solution.covariance = covariance;
    }
    Ok(out)
}

/// The experiment along the simulated closed loop; the velocity at the start is zero where none was
/// read.
fn simulate(
    model: &ClosedLoop<'_>,
    p: &[f64],
    dataset: &Dataset,
    experiment: &Experiment,
) -> Result<Experiment, InstrumentError> {
    let nq = experiment.nq;
    let estimate = state_from_data(experiment, None)?;
    let drive = Drive {
        t: &experiment.t,
        u: &experiment.u,
        hold: dataset.input_hold,
    };
    let settings = integrate::Settings {
        rtol: 1e-6,
        atol: 1e-8,
        ..integrate::Settings::default()
    };
    let model: &dyn Hessian = model;
    let (q0, v0) = (&estimate.q[..nq], &estimate.v[..nq]);
    let motion = integrate::simulate(model, p, q0, v0, &drive, settings).map_err(|error| {
        InstrumentError::Simulate {
            record: experiment.name.clone(),
            error,
        }
    })?;
    Ok(Experiment {
        q: motion.q,
        v: Some(motion.v),
        ..experiment.clone()
    })
}

fn distance(simulated: &Experiment, measured: &Experiment) -> f64 {
    let nq = measured.nq;
    let (mut sum, mut count) = (0.0, 0.0);
    for j in 0..nq {
        let pairs: Vec<(f64, f64)> = (0..measured.len())
            .map(|k| (simulated.q[k * nq + j], measured.q[k * nq + j]))
            .filter(|(_, m)| m.is_finite())
            .collect();
        let n = pairs.len().max(1) as f64;
        let mean = pairs.iter().map(|p| p.1).sum::<f64>() / n;
        let spread: f64 = pairs.iter().map(|p| (p.1 - mean).powi(2)).sum();
        let error: f64 = pairs.iter().map(|p| (p.0 - p.1).powi(2)).sum();
        if spread > 0.0 {
            sum += error / spread;
            count += 1.0;
        }
    }
    f64::sqrt(sum / f64::max(count, 1.0))
}

fn blocks(
    model: &LinearModel<'_>,
    record: &Record,
    (z, y): (&[f64], &[f64]),
    rest: &[f64],
    weights: &[f64],
    base: &Base,
) -> Vec<Cross> {
    let (nq, columns) = (record.nq, model.linear().len());
    let width = nq * (columns + 2);
    let kept: Vec<usize> = record.kept().collect();
    let n = base.rank();
    let pieces = (kept.len() / 20).clamp(1, BLOCKS);
    (0..pieces)
        .map(|piece| {
            let mut cross = Cross {
                a: DMatrix::zeros(n, n),
                b: DVector::zeros(n),
            };
            for row in piece * kept.len() / pieces..(piece + 1) * kept.len() / pieces {
                for j in 0..nq {
                    // The measured velocity decides about rest, as in the regression; its noise at
                    // rest is far below the limit.
                    if record.v[kept[row] * nq + j].abs() < rest[j] {
                        continue;
                    }
                    let at = row * width + 2 * nq + j * columns;
                    let (zr, yr) = (&z[at..at + columns], &y[at..at + columns]);
                    let offset = y[row * width + j];
                    for (i, &ci) in base.independent.iter().enumerate() {
                        let zi = weights[j] * zr[ci];
                        if zi == 0.0 {
                            continue;
                        }
                        cross.b[i] -= zi * offset;
                        for (k, &ck) in base.independent.iter().enumerate() {
                            cross.a[(i, k)] += zi * yr[ck];
                        }
                    }
                }
            }
            cross
        })
        .collect()
}

/// β, and its covariance by leaving out one block after another.
fn solve(blocks: &[Cross]) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let n = blocks.first()?.b.len();
    let (mut a, mut b) = (DMatrix::zeros(n, n), DVector::zeros(n));
    for block in blocks {
        a += &block.a;
        b += &block.b;
    }
    // Rows and columns to unit diagonal: parameters differ by orders of magnitude.
    let scale = DVector::from_fn(n, |i, _| match a[(i, i)].abs() {
        d if d > 0.0 => d.sqrt().recip(),
        _ => 1.0,
    });
    let scaled = |a: &DMatrix<f64>, b: &DVector<f64>| -> Option<DVector<f64>> {
        let matrix = DMatrix::from_fn(n, n, |i, k| a[(i, k)] * scale[i] * scale[k]);
        let right = b.component_mul(&scale);
        let x = matrix.lu().solve(&right)?.component_mul(&scale);
        x.iter().all(|x| x.is_finite()).then_some(x)
    };
    let beta = scaled(&a, &b)?;
    let without: Vec<DVector<f64>> = blocks
        .iter()
        .map(|block| scaled(&(&a - &block.a), &(&b - &block.b)))
        .collect::<Option<_>>()?;
    let count = blocks.len() as f64;
    Some((beta, scatter(&without, (count - 1.0) / count)))
}
