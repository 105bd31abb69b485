//! Residual forces over records: of fitted values through their normal equations, of any given
//! values through the same filters.

use nalgebra::DVector;
use pid_runtime::dynamics::{At, Hessian};
use rayon::prelude::*;

use crate::regress::normal::{Block, Normal, residuals_at};
use crate::regress::record::Record;
use crate::regress::solution;

/// Residual force of the joints over some records.
#[derive(Debug, Clone, PartialEq)]
pub struct Errors {
    /// Name of the record, or of the role for all of them together.
    pub records: String,
    /// RMS of the residual of each joint, N·m or N.
    pub rms: Vec<f64>,
    /// The same over the RMS of the drive's force; `None` where the drive does not act.
    pub relative: Vec<Option<f64>>,
    /// All joints together.
    pub overall: Option<f64>,
}

/// Name of the row of all training records.
const TRAIN: &str = "train (all)";
/// Name of the row of all test records.
const TEST: &str = "test (all)";

/// Residuals of the fitted rows of all training records together, then of each test record and of
/// all of them.
pub(crate) fn fitted(train: &Normal, test: &Normal, p: &DVector<f64>) -> Vec<Errors> {
    let row = |normal: &Normal, records: &str, record: Option<usize>| {
        let choice = |b: &Block| record.is_none_or(|r| b.record == r);
        let (rms, relative) = solution::residuals(normal, p, choice).into_iter().unzip();
        Errors {
            records: records.to_owned(),
            rms,
            relative,
            overall: solution::overall(normal, p, choice),
        }
    };
    let mut all = vec![row(train, TRAIN, None)];
    if !test.blocks.is_empty() {
        all.extend(
            test.records
                .iter()
                .enumerate()
                .map(|(i, name)| row(test, name, Some(i))),
        );
        all.push(row(test, TEST, None));
    }
    all
}

/// Squares of the residual and of the drive's force, and samples, per joint.
type Squares = Vec<(f64, f64, usize)>;

/// The same rows for given parameters of the model, whether the residual is linear in them or not.
/// As in the fit, rows of training records slower than `rest` are left out.
pub fn given(
    model: &dyn Hessian,
    p: &[f64],
    train: &[Record],
    test: &[Record],
    rest: &[f64],
) -> Vec<Errors> {
    let squares = |records: &[Record], rest: Option<&[f64]>| -> Vec<Squares> {
        records
            .par_iter()
            .map(|record| one(model, p, record, rest))
            .collect()
    };
    let sum = |list: &[Squares]| -> Squares {
        (0..rest.len())
            .map(|j| {
                list.iter().fold((0.0, 0.0, 0), |(r, d, n), s| {
                    (r + s[j].0, d + s[j].1, n + s[j].2)
                })
            })
            .collect()
    };
    let mut all = vec![row(TRAIN, &sum(&squares(train, Some(rest))))];
    if !test.is_empty() {
        let each = squares(test, None);
        all.extend(test.iter().zip(&each).map(|(r, s)| row(&r.name, s)));
        all.push(row(TEST, &sum(&each)));
    }
    all
}

fn row(records: &str, squares: &Squares) -> Errors {
    let share = |r: f64, d: f64| (d > 0.0).then(|| (r / d).sqrt());
    let (r, d) = squares
        .iter()
        .fold((0.0, 0.0), |(r, d), s| (r + s.0, d + s.1));
    Errors {
        records: records.to_owned(),
        rms: squares
            .iter()
            .map(|s| (s.0 / s.2.max(1) as f64).sqrt())
            .collect(),
        relative: squares.iter().map(|s| share(s.0, s.1)).collect(),
        overall: share(r, d),
    }
}

fn one(model: &dyn Hessian, p: &[f64], record: &Record, rest: Option<&[f64]>) -> Squares {
    let nq = record.nq;
    let residual = residuals_at(model, record, p);
    // The drive's force is the part that the input adds.
    let mut force = vec![0.0; record.t.len() * nq];
    let (mut idle, mut passive) = (vec![0.0; record.nu], vec![0.0; nq]);
    for (i, row) in force.chunks_exact_mut(nq).enumerate() {
        let at = record.at(i, p);
        model.applied_force(&at, row);
        record.idle(i, &mut idle);
        model.applied_force(&At { u: &idle, ..at }, &mut passive);
        row.iter_mut().zip(&passive).for_each(|(f, p)| *f -= p);
    }
    let force = record.parallel(force, nq);
    let mut out = vec![(0.0, 0.0, 0); nq];
    for (k, i) in record.kept().enumerate() {
        for j in 0..nq {
            if rest.is_none_or(|rest| record.v[i * nq + j].abs() >= rest[j]) {
                out[j].0 += residual[k * nq + j].powi(2);
                out[j].1 += force[i * nq + j].powi(2);
                out[j].2 += 1;
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::regress::columns::LinearModel;
    use crate::regress::record::Filtering;
    use crate::synthetic::{Recipe, records};
    use pid_models::Emps;
    use pid_runtime::dynamics::Dynamics;

    #[test]
    fn both_ways_give_the_same_residuals() {
        let p: Vec<f64> = Emps.params().iter().map(|i| i.nominal).collect();
        let recipe = Recipe {
            records: 1,
            seconds: 3.0,
            step: 1e-3,
            amplitude: vec![80.0],
            highest: 3.0,
            start: vec![0.0],
            noise: vec![1e-6, f64::INFINITY],
            outliers: (0.0, 1.0),
        };
        let dataset = records(&Emps, &p, &recipe, 4).expect("simulates");
        let filtering = Filtering {
            cutoff: Some(40.0),
            decimate: None,
        };
        let made = Record::of(&dataset, filtering, &[], |_| true).expect("filters");
        let split = LinearModel::new(&Emps, &p, &[]);
        let rest = [2e-3];
        let normal = Normal::new(&split, &made, Some(&rest));
        let judged = Normal::new(&split, &made, None);
        let linear = DVector::from_iterator(
            split.linear().len(),
            split.linear().iter().map(|&j| 0.9 * p[j]),
        );
        let by_sums = fitted(&normal, &judged, &linear);
        let all = split.complete(linear.as_slice());
        let directly = given(&Emps, &all, &made, &made, &rest);
        assert_eq!(by_sums.len(), directly.len());
        for (a, b) in by_sums.iter().zip(&directly) {
            assert_eq!(a.records, b.records);
            for (x, y) in [
                (a.rms[0], b.rms[0]),
                (a.overall.unwrap(), b.overall.unwrap()),
            ] {
                assert!((x / y - 1.0).abs() < 1e-6, "{x} {y}");
            }
        }
    }
}
