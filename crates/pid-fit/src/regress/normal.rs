//! Normal equations of the inverse dynamics, per block of time and per joint.
//!
//! For each block and joint: `A = Σ w yᵀy`, `b = −Σ w yᵀ r₀`, `c = Σ w r₀²` over the kept samples,
//! `y` the joint's row of the filtered regressor, w the samples' weights (1 unless a robust loss
//! sets them). Weights of joints, subsets of records, folds and bootstrap samples are sums of
//! these; no further pass is needed.
//!
//! Records may differ in some unknowns (an offset of each, a payload in some). The sums stay those
//! of the model's columns, and a [`Placement`] per record says which unknowns a column stands for.
//! The sums are spread over the unknowns when they are added up.

use std::borrow::Cow;

use nalgebra::{DMatrix, DVector};
use pid_runtime::dynamics::{At, Hessian};
use rayon::prelude::*;

use crate::regress::columns::LinearModel;
use crate::regress::record::Record;

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
    /// Σ yᵀf with the force f of the drive: the part of b that its gain scales.
    pub driven: DVector<f64>,
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
            driven: DVector::zeros(n),
            c: 0.0,
            drive: 0.0,
            count: 0,
        }
    }

    fn add(&mut self, other: &Self) {
        self.a += &other.a;
        self.b += &other.b;
        self.driven += &other.driven;
        self.c += other.c;
        self.drive += other.drive;
        self.count += other.count;
    }

    /// The same sums for other unknowns.
    fn spread(&self, place: &Placement, unknowns: usize) -> Self {
        let mut out = Self {
            c: self.c,
            drive: self.drive,
            count: self.count,
            ..Self::zero(unknowns)
        };
        for (k, own) in place.iter().enumerate() {
            for &(i, f) in own {
                out.b[i] += f * self.b[k];
                out.driven[i] += f * self.driven[k];
                for (l, others) in place.iter().enumerate() {
                    let value = f * self.a[(l, k)];
                    if value != 0.0 {
                        for &(j, g) in others {
                            out.a[(j, i)] += g * value;
                        }
                    }
                }
            }
        }
        out
    }

    /// The sums of some of the columns, in this order.
    pub fn select(&self, columns: &[usize]) -> Self {
        Self {
            a: self.a.select_columns(columns).select_rows(columns),
            b: self.b.select_rows(columns),
            driven: self.driven.select_rows(columns),
            c: self.c,
            drive: self.drive,
            count: self.count,
        }
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

/// The unknowns that each column of the model is the sum of, with factors: `p_k = Σ f x_i`.
pub type Placement = Vec<Vec<(usize, f64)>>;

/// Blocks of several records.
#[derive(Debug, Clone, PartialEq)]
pub struct Normal {
    /// The blocks, in order of records and time.
    pub blocks: Vec<Block>,
    /// Names of the records.
    pub records: Vec<String>,
    nq: usize,
    /// Number of the model's columns, and of the unknowns.
    columns: (usize, usize),
    /// One per record; empty where the columns are the unknowns.
    places: Vec<Placement>,
}

impl Normal {
    /// Passes the records through the model once. Rows of a joint that is slower than `rest` (one
    /// value per joint) are left out, since sticking friction may be anything within its band
    /// there.
    pub fn new(model: &LinearModel<'_>, records: &[Record], rest: Option<&[f64]>) -> Self {
        Self::weighted(model, records, rest, &[])
    }

    /// As [`Self::new`] with a weight for every kept sample and joint of each record (row by row);
    /// 1 where there is no list.
    pub fn weighted(
        model: &LinearModel<'_>,
        records: &[Record],
        rest: Option<&[f64]>,
        weights: &[Vec<f64>],
    ) -> Self {
        let blocks = records
            .par_iter()
            .enumerate()
            .flat_map_iter(|(index, record)| blocks(model, record, index, rest, weights.get(index)))
            .collect();
        Self {
            blocks,
            records: records.iter().map(|r| r.name.clone()).collect(),
            nq: model.model().dims().nq,
            columns: (model.columns(), model.columns()),
            places: Vec::new(),
        }
    }

    /// The same sums for other unknowns: one placement of the columns per record.
    pub fn placed(self, unknowns: usize, places: Vec<Placement>) -> Self {
        Self {
            columns: (self.columns.0, unknowns),
            places,
            ..self
        }
    }

    /// Number of unknowns.
    pub fn columns(&self) -> usize {
        self.columns.1
    }

    /// Sums of a block in the unknowns.
    pub fn joints<'a>(&self, block: &'a Block) -> Cow<'a, [Sums]> {
        match self.places.get(block.record) {
            None => Cow::Borrowed(&block.joints),
            Some(place) => Cow::Owned(
                block
                    .joints
                    .iter()
                    .map(|s| s.spread(place, self.columns.1))
                    .collect(),
            ),
        }
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
        let add = |total: &mut [Sums], joints: &[Sums]| {
            for (sum, joint) in total.iter_mut().zip(joints) {
                sum.add(joint);
            }
        };
        let mut total = vec![Sums::zero(self.columns.1); self.nq];
        if self.places.is_empty() {
            for block in self.blocks.iter().filter(|b| choice(b)) {
                add(&mut total, &block.joints);
            }
            return total;
        }
        for (record, place) in self.places.iter().enumerate() {
            let mut own = vec![Sums::zero(self.columns.0); self.nq];
            for block in self
                .blocks
                .iter()
                .filter(|b| b.record == record && choice(b))
            {
                add(&mut own, &block.joints);
            }
            let own: Vec<Sums> = own
                .iter()
                .map(|s| s.spread(place, self.columns.1))
                .collect();
            add(&mut total, &own);
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
            places: self.places.clone(),
        }
    }
}

/// The blocks of one record.
fn blocks(
    model: &LinearModel<'_>,
    record: &Record,
    index: usize,
    rest: Option<&[f64]>,
    weights: Option<&Vec<f64>>,
) -> Vec<Block> {
    let moving: Vec<bool> = record
        .kept()
        .flat_map(|i| (0..record.nq).map(move |j| (i, j)))
        .map(|(i, j)| rest.is_none_or(|rest| record.v[i * record.nq + j].abs() >= rest[j]))
        .collect();
    let rows = filtered(model, record);
    let nq = record.nq;
    let columns = model.columns();
    let width = nq * (columns + 2);
    let count = rows.len() / width.max(1);
    let pieces = (count / SHORTEST).clamp(1, BLOCKS);
    (0..pieces)
        .map(|piece| {
            let range = piece * count / pieces..(piece + 1) * count / pieces;
            let samples = &rows[range.start * width..range.end * width];
            let joints = (0..nq)
                .map(|j| {
                    let weight = |i: usize| {
                        let at = (range.start + i) * nq + j;
                        match moving[at] {
                            true => weights.map_or(1.0, |w| w[at]),
                            false => 0.0,
                        }
                    };
                    sums(samples, weight, (nq, columns), j)
                })
                .collect();
            Block {
                record: index,
                joints,
            }
        })
        .collect()
}

fn sums(
    samples: &[f64],
    weight: impl Fn(usize) -> f64,
    (nq, columns): (usize, usize),
    joint: usize,
) -> Sums {
    let width = nq * (columns + 2);
    let mut out = Sums::zero(columns);
    // Only columns that this joint's row has; the others stay zero.
    let used: Vec<usize> = (0..columns)
        .filter(|k| {
            samples
                .chunks_exact(width)
                .any(|row| row[2 * nq + joint * columns + k] != 0.0)
        })
        .collect();
    let kept: Vec<(&[f64], f64)> = samples
        .chunks_exact(width)
        .enumerate()
        .map(|(i, row)| (row, weight(i)))
        .filter(|(_, w)| *w > 0.0)
        .collect();
    let entry = |row: &[f64], k: usize| row[2 * nq + joint * columns + k];
    // Columns of the transposed regressor are samples; the product is left to the matrix library.
    let yt = DMatrix::from_fn(used.len(), kept.len(), |k, i| {
        kept[i].1.sqrt() * entry(kept[i].0, used[k])
    });
    let column = |at: usize| DVector::from_fn(kept.len(), |i, _| kept[i].1.sqrt() * kept[i].0[at]);
    let (offset, drive) = (column(joint), column(nq + joint));
    let (a, b, driven) = (&yt * yt.transpose(), &yt * &offset, &yt * &drive);
    for (i, &k) in used.iter().enumerate() {
        out.b[k] = -b[i];
        out.driven[k] = driven[i];
        for (j, &l) in used.iter().enumerate() {
            out.a[(k, l)] = a[(i, j)];
        }
    }
    out.c = offset.norm_squared();
    out.drive = drive.norm_squared();
    out.count = kept.len();
    out
}

/// Residuals of the kept samples and all joints (row by row) at values of the model's linear parameters.
pub(crate) fn residuals(model: &LinearModel<'_>, record: &Record, linear: &[f64]) -> Vec<f64> {
    residuals_at(model.model(), record, &model.complete(linear))
}

/// As [`residuals`] at all parameters of a model.
pub(crate) fn residuals_at(model: &dyn Hessian, record: &Record, p: &[f64]) -> Vec<f64> {
    let nq = record.nq;
    let mut r = vec![0.0; record.t.len() * nq];
    for (i, row) in r.chunks_exact_mut(nq).enumerate() {
        let at = record.at(i, p);
        model.residual(&at, row);
    }
    let r = record.parallel(r, nq);
    record
        .kept()
        .flat_map(|i| r[i * nq..(i + 1) * nq].to_vec())
        .collect()
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
    let (nq, columns) = (dims.nq, model.columns());
    let width = nq * (columns + 2);
    let mut rows = vec![0.0; record.t.len() * width];
    let mut scratch = vec![0.0; model.model().jacobian_pattern().nnz()];
    let (mut idle, held) = (
        vec![0.0; record.nu],
        model.complete(&vec![0.0; model.linear().len()]),
    );
    let mut passive = vec![0.0; nq];
    for (i, row) in rows.chunks_exact_mut(width).enumerate() {
        let at = At {
            q: &q[i * nq..(i + 1) * nq],
            v: &v[i * nq..(i + 1) * nq],
            a: &a[i * nq..(i + 1) * nq],
            u: record.inputs(i),
            p: &held,
        };
        let (front, y) = row.split_at_mut(2 * nq);
        let (offset, drive) = front.split_at_mut(nq);
        model.evaluate(&at, offset, y, &mut scratch);
        model.model().applied_force(&at, drive);
        record.idle(i, &mut idle);
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
