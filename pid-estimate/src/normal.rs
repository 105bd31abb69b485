//! Normal equations of the inverse dynamics, per block of time and per joint.
//!
//! For each block and joint: `A = Σ yᵀy`, `b = −Σ yᵀ r₀`, `c = Σ r₀²` over the kept samples, `y` the joint's row of the filtered
//! regressor. Weights of joints, subsets of records, folds and bootstrap samples are sums of these; no further pass is needed.

use nalgebra::{DMatrix, DVector};
use pid_runtime::dynamics::At;
use rayon::prelude::*;

use crate::columns::LinearModel;
use crate::record::Record;

/// Blocks a record is cut into.
const BLOCKS: usize = 12;
/// Fewest kept samples of a block.
const SHORTEST: usize = 20;

/// Sums of one joint over one block.
#[derive(Debug, Clone, PartialEq)]
pub struct Sums {
    /// Σ yᵀy.
    pub a: DMatrix<f64>,
    /// −Σ yᵀ r₀.
    pub b: DVector<f64>,
    /// Σ r₀².
    pub c: f64,
    /// Σ of the squared force of the drive.
    pub drive: f64,
    /// Samples.
    pub count: usize,
}

impl Sums {
    fn zero(n: usize) -> Self {
        Self {
            a: DMatrix::zeros(n, n),
            b: DVector::zeros(n),
            c: 0.0,
            drive: 0.0,
            count: 0,
        }
    }

    fn add(&mut self, other: &Self) {
        self.a += &other.a;
        self.b += &other.b;
        self.c += other.c;
        self.drive += other.drive;
        self.count += other.count;
    }

    /// Σ of the squared residual at values of the linear parameters.
    pub fn residual(&self, p: &DVector<f64>) -> f64 {
        (p.dot(&(&self.a * p)) - 2.0 * p.dot(&self.b) + self.c).max(0.0)
    }
}

/// Sums of all joints over a stretch of time of one record.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// Position of the record.
    pub record: usize,
    /// One per joint.
    pub joints: Vec<Sums>,
}

/// Blocks of several records.
#[derive(Debug, Clone, PartialEq)]
pub struct Normal {
    /// The blocks, in order of records and time.
    pub blocks: Vec<Block>,
    /// Names of the records.
    pub records: Vec<String>,
    nq: usize,
    columns: usize,
}

impl Normal {
    /// Passes the records through the model once. Rows of a joint that is slower than `rest` (one value per joint) are left
    /// out: sticking friction may be anything within its band there.
    pub fn new(model: &LinearModel<'_>, records: &[Record], rest: Option<&[f64]>) -> Self {
        let columns = model.linear().len();
        let nq = model.model().dims().nq;
        let blocks = records
            .par_iter()
            .enumerate()
            .flat_map_iter(|(index, record)| blocks(model, record, index, rest))
            .collect();
        Self {
            blocks,
            records: records.iter().map(|r| r.name.clone()).collect(),
            nq,
            columns,
        }
    }

    /// Number of linear parameters.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Number of joints.
    pub fn nq(&self) -> usize {
        self.nq
    }

    /// Number of kept samples, of the joint with the most of them.
    pub fn samples(&self) -> usize {
        self.blocks
            .iter()
            .map(|b| b.joints.iter().map(|j| j.count).max().unwrap_or(0))
            .sum()
    }

    /// Sums over the blocks that a choice takes, per joint.
    pub fn total(&self, choice: impl Fn(&Block) -> bool) -> Vec<Sums> {
        let mut total = vec![Sums::zero(self.columns); self.nq];
        for block in self.blocks.iter().filter(|b| choice(b)) {
            for (sum, joint) in total.iter_mut().zip(&block.joints) {
                sum.add(joint);
            }
        }
        total
    }

    /// The blocks of one record.
    pub fn of_record(&self, record: usize) -> Self {
        Self {
            blocks: self
                .blocks
                .iter()
                .filter(|b| b.record == record)
                .cloned()
                .collect(),
            ..self.clone_frame()
        }
    }

    /// All blocks but those of one record.
    pub fn without_record(&self, record: usize) -> Self {
        Self {
            blocks: self
                .blocks
                .iter()
                .filter(|b| b.record != record)
                .cloned()
                .collect(),
            ..self.clone_frame()
        }
    }

    /// The blocks at these positions, repeated as often as they occur.
    pub fn resampled(&self, positions: &[usize]) -> Self {
        Self {
            blocks: positions.iter().map(|&i| self.blocks[i].clone()).collect(),
            ..self.clone_frame()
        }
    }

    fn clone_frame(&self) -> Self {
        Self {
            blocks: Vec::new(),
            records: self.records.clone(),
            nq: self.nq,
            columns: self.columns,
        }
    }
}

/// The blocks of one record.
fn blocks(
    model: &LinearModel<'_>,
    record: &Record,
    index: usize,
    rest: Option<&[f64]>,
) -> Vec<Block> {
    let moving: Vec<bool> = record
        .kept()
        .flat_map(|i| (0..record.nq).map(move |j| (i, j)))
        .map(|(i, j)| rest.is_none_or(|rest| record.v[i * record.nq + j].abs() >= rest[j]))
        .collect();
    let rows = filtered(model, record);
    let nq = record.nq;
    let columns = model.linear().len();
    let width = nq * (columns + 2);
    let count = rows.len() / width.max(1);
    let pieces = (count / SHORTEST).clamp(1, BLOCKS);
    (0..pieces)
        .map(|piece| {
            let range = piece * count / pieces..(piece + 1) * count / pieces;
            let samples = &rows[range.start * width..range.end * width];
            let joints = (0..nq)
                .map(|j| {
                    let used = moving[range.start * nq..range.end * nq]
                        .iter()
                        .skip(j)
                        .step_by(nq);
                    sums(samples, used, (nq, columns), j)
                })
                .collect();
            Block {
                record: index,
                joints,
            }
        })
        .collect()
}

fn sums<'a>(
    samples: &[f64],
    moving: impl Iterator<Item = &'a bool>,
    (nq, columns): (usize, usize),
    joint: usize,
) -> Sums {
    let width = nq * (columns + 2);
    let mut out = Sums::zero(columns);
    // Columns that this joint's row has at all: the others stay zero.
    let used: Vec<usize> = (0..columns)
        .filter(|k| {
            samples
                .chunks_exact(width)
                .any(|row| row[2 * nq + joint * columns + k] != 0.0)
        })
        .collect();
    for (row, _) in samples.chunks_exact(width).zip(moving).filter(|(_, m)| **m) {
        let (offset, drive) = (row[joint], row[nq + joint]);
        let y = &row[2 * nq + joint * columns..][..columns];
        for (place, &k) in used.iter().enumerate() {
            out.b[k] -= y[k] * offset;
            for &l in &used[..=place] {
                out.a[(k, l)] += y[k] * y[l];
            }
        }
        out.c += offset * offset;
        out.drive += drive * drive;
        out.count += 1;
    }
    out.a.fill_upper_triangle_with_lower_triangle();
    out
}

/// Per kept sample: r₀ (nq), force of the drive (nq), Y (nq × columns), all through the decimation filter.
pub(crate) fn filtered(model: &LinearModel<'_>, record: &Record) -> Vec<f64> {
    filtered_at(model, record, &record.q, &record.v, &record.a)
}

/// As [`filtered`], for other states than those of the record.
pub(crate) fn filtered_at(
    model: &LinearModel<'_>,
    record: &Record,
    q: &[f64],
    v: &[f64],
    a: &[f64],
) -> Vec<f64> {
    let dims = model.model().dims();
    let (nq, columns) = (dims.nq, model.linear().len());
    let width = nq * (columns + 2);
    let mut rows = vec![0.0; record.t.len() * width];
    let mut scratch = vec![0.0; model.model().jacobian_pattern().nnz()];
    let (idle, held) = (vec![0.0; dims.nu], model.complete(&vec![0.0; columns]));
    let mut passive = vec![0.0; nq];
    for (i, row) in rows.chunks_exact_mut(width).enumerate() {
        let at = At {
            q: &q[i * nq..(i + 1) * nq],
            v: &v[i * nq..(i + 1) * nq],
            a: &a[i * nq..(i + 1) * nq],
            u: &record.u[i * nq..(i + 1) * nq],
            p: &held,
        };
        let (front, y) = row.split_at_mut(2 * nq);
        let (offset, drive) = front.split_at_mut(nq);
        model.evaluate(&at, offset, y, &mut scratch);
        model.model().applied_force(&at, drive);
        model
            .model()
            .applied_force(&At { u: &idle, ..at }, &mut passive);
        drive.iter_mut().zip(&passive).for_each(|(d, p)| *d -= p);
    }
    let rows = record.parallel(rows, width);
    let mut kept = Vec::with_capacity(record.kept().count() * width);
    for i in record.kept() {
        kept.extend_from_slice(&rows[i * width..(i + 1) * width]);
    }
    kept
}
