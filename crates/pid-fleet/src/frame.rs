//! What is measured of every log, and the sums it is measured from.
//!
//! The residual of the robot's equations is linear in most parameters (`r = Y p + r₀`). Columns of the regressor are
//! the base parameters that the fleet's plan chose, and per drive a constant force and a late input:
//!
//! ```text
//! 0 = Y β + r₀(q, v, a, u) − o_j + d_j (f(du/dt) − f(0)),    o_j, N·m or N; d_j, s
//! ```
//!
//! The states come through one zero-phase filter, the same for all logs, so that its bias is that of the whole fleet.

use nalgebra::{DMatrix, DVector};
use pid_data::signal::SignalError;
use pid_data::{Dataset, Experiment};
use pid_fit::regress::columns::LinearModel;
use pid_fit::regress::record::{Filtering, Record};
use pid_runtime::dynamics::{At, Hessian};
use pid_runtime::term::{REST_ROTATION, REST_TRANSLATION};

/// A joint that is slower than so many transition velocities rests: its friction may be anything.
const REST: f64 = 2.0;
/// Blocks of time that a log is cut into.
const BLOCKS: usize = 12;
/// Fewest samples of a block.
const SHORTEST: usize = 10;

/// A column beside the parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Extra {
    /// A constant force at a joint.
    Offset(usize),
    /// A late input of a joint.
    Delay(usize),
}

/// The columns of a regression.
pub(crate) struct Frame<'m> {
    split: LinearModel<'m>,
    extras: Vec<Extra>,
    cutoff: f64,
    rest: Vec<f64>,
}

/// Sums of one joint over one block: `A = Σ yᵀy`, `b = −Σ yᵀ r₀`, `c = Σ r₀²`, and the drive's.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sums {
    pub(crate) a: DMatrix<f64>,
    pub(crate) b: DVector<f64>,
    pub(crate) c: f64,
    /// Σ of the squared force of the drive.
    pub(crate) drive: f64,
    pub(crate) count: usize,
}

impl Sums {
    pub(crate) fn zero(columns: usize) -> Self {
        Self {
            a: DMatrix::zeros(columns, columns),
            b: DVector::zeros(columns),
            c: 0.0,
            drive: 0.0,
            count: 0,
        }
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.a += &other.a;
        self.b += &other.b;
        self.c += other.c;
        self.drive += other.drive;
        self.count += other.count;
    }

    /// Σ of the squared residual at values of the columns.
    pub(crate) fn residual(&self, x: &DVector<f64>) -> f64 {
        (x.dot(&(&self.a * x)) - 2.0 * x.dot(&self.b) + self.c).max(0.0)
    }
}

/// Sums joint by joint.
pub(crate) type Block = Vec<Sums>;

impl<'m> Frame<'m> {
    /// Parameters at the places `hold` keep their values in `p`; `cutoff` in Hz.
    pub(crate) fn new(
        model: &'m dyn Hessian,
        p: &[f64],
        hold: &[usize],
        extras: &[Extra],
        cutoff: f64,
    ) -> Self {
        let rest = model.joints().iter().map(|j| match j.prismatic {
            true => REST * REST_TRANSLATION,
            false => REST * REST_ROTATION,
        });
        Self {
            split: LinearModel::new(model, p, hold),
            extras: extras.to_vec(),
            cutoff,
            rest: rest.collect(),
        }
    }

    /// Places of the parameters among the columns, in their order.
    pub(crate) fn linear(&self) -> &[usize] {
        self.split.linear()
    }

    /// Number of columns: parameters, then the others.
    pub(crate) fn columns(&self) -> usize {
        self.split.linear().len() + self.extras.len()
    }

    /// The records of a log as sums, block by block.
    ///
    /// # Errors
    /// [`SignalError`]: records that are too short, empty channels, an impossible cut-off.
    pub(crate) fn blocks(&self, log: &Dataset) -> Result<Vec<Block>, SignalError> {
        let mut blocks = Vec::new();
        for experiment in &log.experiments {
            let record = self.record(log, experiment)?;
            blocks.extend(self.of_record(&record));
        }
        Ok(blocks)
    }

    fn record(&self, log: &Dataset, experiment: &Experiment) -> Result<Record, SignalError> {
        let filtering = Filtering {
            cutoff: Some(self.cutoff),
            decimate: Some(1),
        };
        Record::new(experiment, log.input_hold, filtering)
    }

    fn of_record(&self, record: &Record) -> Vec<Block> {
        let kept: Vec<usize> = record.kept().collect();
        let pieces = (kept.len() / SHORTEST).clamp(1, BLOCKS);
        (0..pieces)
            .map(|k| {
                let range = k * kept.len() / pieces..(k + 1) * kept.len() / pieces;
                self.block(record, &kept[range])
            })
            .collect()
    }

    fn block(&self, record: &Record, samples: &[usize]) -> Block {
        let nq = record.nq;
        let model = self.split.model();
        let (parameters, columns) = (self.split.linear().len(), self.columns());
        let mut sums = vec![Sums::zero(columns); nq];
        let mut scratch = vec![0.0; model.jacobian_pattern().nnz()];
        let (mut offset, mut y) = (vec![0.0; nq], vec![0.0; nq * parameters]);
        let p = self.split.complete(&vec![0.0; parameters]);
        let (zero, mut passive) = (vec![0.0; record.nu], vec![0.0; nq]);
        let (mut drive, mut slope) = (vec![0.0; nq], vec![0.0; nq]);
        let mut row = DVector::zeros(columns);
        for &i in samples {
            let own = i * nq..(i + 1) * nq;
            let at = At {
                q: &record.q[own.clone()],
                v: &record.v[own.clone()],
                a: &record.a[own],
                u: &record.u[i * record.nu..(i + 1) * record.nu],
                p: &p,
            };
            self.split.evaluate(&at, &mut offset, &mut y, &mut scratch);
            model.applied_force(&at, &mut drive);
            model.applied_force(&At { u: &zero, ..at }, &mut passive);
            let rate = rate(record, i);
            model.applied_force(&At { u: &rate, ..at }, &mut slope);
            for j in (0..nq).filter(|&j| at.v[j].abs() >= self.rest[j]) {
                row.fill(0.0);
                row.as_mut_slice()[..parameters]
                    .copy_from_slice(&y[j * parameters..(j + 1) * parameters]);
                for (k, extra) in self.extras.iter().enumerate() {
                    row[parameters + k] = match *extra {
                        Extra::Offset(joint) if joint == j => -1.0,
                        Extra::Delay(joint) if joint == j => slope[j] - passive[j],
                        _ => 0.0,
                    };
                }
                let own = &mut sums[j];
                own.a.ger(1.0, &row, &row, 1.0);
                own.b.axpy(-offset[j], &row, 1.0);
                own.c += offset[j] * offset[j];
                own.drive += (drive[j] - passive[j]).powi(2);
                own.count += 1;
            }
        }
        sums
    }
}

/// du/dt at sample `i`, by the neighbours.
fn rate(record: &Record, i: usize) -> Vec<f64> {
    let (before, after) = (i.saturating_sub(1), (i + 1).min(record.t.len() - 1));
    let step = record.t[after] - record.t[before];
    let u = |i: usize, j: usize| record.u[i * record.nu + j];
    (0..record.nu)
        .map(|j| (u(after, j) - u(before, j)) / step)
        .collect()
}

/// Sums over blocks.
pub(crate) fn total<'b>(
    blocks: impl IntoIterator<Item = &'b Block>,
    joints: usize,
    columns: usize,
) -> Block {
    let mut total = vec![Sums::zero(columns); joints];
    for block in blocks {
        for (sum, own) in total.iter_mut().zip(block) {
            sum.add(own);
        }
    }
    total
}
