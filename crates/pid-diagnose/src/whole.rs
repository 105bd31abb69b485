//! Free runs over whole records, in the units of the readings: how far a simulator strays that is never put right.

use pid_data::{Dataset, Role};

use crate::case::{Case, CaseError, Record};
use crate::first;
use crate::gap::{free_run, windows};
use crate::hypothesis::Hypothesis;
use crate::nominal::Nominal;
use crate::predict::Runner;

/// Error of the positions of a joint over a record, rad or m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Strayed {
    /// Root mean square.
    pub rms: f64,
    /// Mean of its size.
    pub mae: f64,
}

/// A free run over a record from its first sample on.
#[derive(Debug, Clone, PartialEq)]
pub struct WholeRun {
    /// The record.
    pub record: String,
    /// Its role.
    pub role: Role,
    /// Errors joint by joint; not finite where the run diverged.
    pub joints: Vec<Strayed>,
}

/// Free runs of a described robot with its effects over all records.
///
/// # Errors
/// As [`Case::new`].
pub fn whole_runs(nominal: Nominal, dataset: &Dataset) -> Result<Vec<WholeRun>, CaseError> {
    let mut case = first::as_described(Case::new(nominal, dataset)?);
    case.nominal.horizon = None;
    let theta = vec![0.0; case.nominal.size()];
    let none = Hypothesis::default();
    let run = |record: &Record| WholeRun {
        record: record.name.clone(),
        role: record.role,
        joints: strayed(&case, record, &none, &theta),
    };
    Ok(case.records.iter().map(run).collect())
}

/// Errors of one record.
fn strayed(case: &Case, record: &Record, none: &Hypothesis, theta: &[f64]) -> Vec<Strayed> {
    let n = case.n();
    let w = windows(case, record, none, theta, &[]);
    let mut runner = Runner::<f64>::new(case, record, none, theta, &[]);
    let mut sums = vec![(0.0, 0.0, 0.0); n];
    for start in w.starts.iter().take(1) {
        let still = &mut |_| (0.0, 0.0);
        let run = free_run(case, &mut runner, record, start, 0, w.length, still);
        for (i, (q, _)) in run.into_iter().enumerate() {
            let (j, read) = (i % n, record.q[i % n][1 + i / n]);
            if read.is_finite() {
                let off = (q - read).abs();
                let (squares, sizes, count) = sums[j];
                sums[j] = (squares + off * off, sizes + off, count + 1.0);
            }
        }
    }
    let of = |(squares, sizes, count): (f64, f64, f64)| Strayed {
        rms: (squares / count).sqrt(),
        mae: sizes / count,
    };
    sums.into_iter().map(of).collect()
}
