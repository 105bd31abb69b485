//! Choosing settings by cross validation over the training records.
//!
//! Each training record in turn is left out, the parameters are identified on the others, and the
//! record is predicted by free runs of a stated horizon. The score of a candidate is
//!
//! ```text
//! s = √( mean over left-out records and joints of  (RMS error of q / standard deviation of q)² )
//! ```
//!
//! with the pooled standard deviation of the joint within the training records, so that a joint
//! that is locked in one record does not decide by its noise. Test records play no part. A single
//! training record is cut into three parts of equal length.

use super::{Callback, IdentError, Settings, identify};
use crate::gap::metrics::{FreeRunError, FreeRunSettings, free_run_table};
use pid_data::{Dataset, Experiment, Horizon, Role};
use pid_runtime::dynamics::Hessian;

/// A record that stands alone is cut into this many parts.
const PARTS: usize = 3;

/// A candidate's score.
#[derive(Debug, Clone, PartialEq)]
pub struct CandidateScore {
    /// Its position in the list of candidates.
    pub candidate: usize,
    /// Score over all folds; infinite if a free run of any fold diverged or a fold could not be judged.
    pub score: f64,
    /// Left-out record and its own score.
    pub folds: Vec<(String, f64)>,
}

/// Why a cross validation cannot be done.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CrossValidationError {
    /// A fold cannot be identified.
    #[error(transparent)]
    Identification(#[from] IdentError),
    /// A fold cannot be simulated.
    #[error(transparent)]
    FreeRun(#[from] FreeRunError),
    /// There is nothing to leave out.
    #[error(
        "data set `{dataset}` has {samples} training samples: too few to leave a part of them out\n  help: state the setting instead of having it chosen"
    )]
    TooFew {
        /// The data set.
        dataset: String,
        /// Training samples.
        samples: usize,
    },
}

/// Scores every candidate; free runs are restarted every `judged`. Returns the scores in the order
/// of the candidates, without those that an interruption left out.
///
/// # Errors
/// [`CrossValidationError`].
pub fn cross_validate(
    model: &dyn Hessian,
    dataset: &Dataset,
    candidates: &[Settings],
    judged: Horizon,
    start: Option<&[f64]>,
    callback: &mut Callback<'_>,
) -> Result<Vec<CandidateScore>, CrossValidationError> {
    let folds = folds(dataset)?;
    let spread = spread(&folds[0]);
    let mut stopped = false;
    let mut scores = Vec::new();
    'candidates: for (candidate, settings) in candidates.iter().enumerate() {
        let mut judged_folds = Vec::with_capacity(folds.len());
        let (mut sum, mut count) = (0.0, 0.0);
        for fold in &folds {
            let mut news = |progress: &super::Progress<'_>| {
                let flow = callback(progress);
                stopped |= flow.is_break();
                flow
            };
            let found = identify(model, fold, settings, start, &mut news)?;
            if stopped {
                break 'candidates;
            }
            let p = &found.best().parameters;
            let out = fold.with_role(Role::Test).next();
            let (name, square) = match out {
                Some(e) => (e.name.clone(), score(model, p, fold, e, judged, &spread)?),
                None => continue,
            };
            sum += square;
            count += 1.0;
            judged_folds.push((name, square.sqrt()));
        }
        let mean: f64 = sum / count;
        scores.push(CandidateScore {
            candidate,
            score: mean.sqrt(),
            folds: judged_folds,
        });
    }
    Ok(scores)
}

/// The training records, each left out once (its role turned to test); test records are dropped.
fn folds(dataset: &Dataset) -> Result<Vec<Dataset>, CrossValidationError> {
    let mut train: Vec<Experiment> = dataset.with_role(Role::Train).cloned().collect();
    let samples = train.iter().map(Experiment::len).sum();
    if let [alone] = train.as_slice() {
        let n = alone.len();
        train = (0..PARTS)
            .map(|k| part(alone, k * n / PARTS, (k + 1) * n / PARTS))
            .collect();
    }
    if train.len() < 2 || train.iter().any(|e| e.len() < 10) {
        return Err(CrossValidationError::TooFew {
            dataset: dataset.name.clone(),
            samples,
        });
    }
    let fold = |out: usize| Dataset {
        experiments: train
            .iter()
            .enumerate()
            .map(|(k, e)| Experiment {
                role: if k == out { Role::Test } else { Role::Train },
                ..e.clone()
            })
            .collect(),
        ..dataset.clone()
    };
    Ok((0..train.len()).map(fold).collect())
}

/// Samples `from .. to` as a record of their own.
fn part(e: &Experiment, from: usize, to: usize) -> Experiment {
    let rows = |x: &[f64]| x[from * e.nq..to * e.nq].to_vec();
    Experiment {
        name: format!("{} [{from}..{to}]", e.name),
        t: e.t[from..to].to_vec(),
        q: rows(&e.q),
        v: e.v.as_deref().map(rows),
        u: e.u[from * e.nu()..to * e.nu()].to_vec(),
        tau: e.tau.as_deref().map(rows),
        qref: e.qref.as_deref().map(rows),
        ..e.clone()
    }
}

/// Variance of each joint's position about its mean in each record, pooled over all records of a fold.
fn spread(fold: &Dataset) -> Vec<f64> {
    let joints = fold.experiments.first().map_or(0, |e| e.nq);
    let variance = |j: usize| {
        let (mut sum, mut count) = (0.0, 0.0);
        for e in &fold.experiments {
            let q = e.q.iter().skip(j).step_by(e.nq).filter(|q| q.is_finite());
            let n = q.clone().count() as f64;
            let mean = q.clone().sum::<f64>() / f64::max(n, 1.0);
            sum += q.map(|q| (q - mean).powi(2)).sum::<f64>();
            count += n;
        }
        sum / f64::max(count, 1.0)
    };
    (0..joints).map(variance).collect()
}

/// Mean square over the joints of RMS error over spread.
fn score(
    model: &dyn Hessian,
    p: &[f64],
    dataset: &Dataset,
    experiment: &Experiment,
    judged: Horizon,
    spread: &[f64],
) -> Result<f64, FreeRunError> {
    let alone = Dataset {
        experiments: vec![experiment.clone()],
        ..dataset.clone()
    };
    let table = free_run_table(model, p, &alone, &FreeRunSettings::new(judged))?;
    let Some(found) = table.experiments.first() else {
        return Ok(f64::INFINITY);
    };
    if found.diverged > 0 {
        return Ok(f64::INFINITY);
    }
    let mut sum = 0.0;
    for (joint, variance) in found.joints.iter().zip(spread) {
        match &joint.q {
            Some(error) if *variance > 0.0 => sum += error.rms * error.rms / variance,
            // A joint that never moves gives nothing to predict.
            Some(_) => {}
            None => return Ok(f64::INFINITY),
        }
    }
    Ok(sum / spread.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(name: &str, role: Role, n: usize) -> Experiment {
        Experiment {
            name: name.into(),
            role,
            note: String::new(),
            nq: 1,
            t: (0..n).map(|i| 0.1 * i as f64).collect(),
            q: (0..n).map(|i| i as f64).collect(),
            v: None,
            u: vec![0.0; n],
            tau: None,
            qref: None,
            missing: 0,
            gain_factors: Default::default(),
        }
    }

    fn dataset(experiments: Vec<Experiment>) -> Dataset {
        Dataset {
            name: "d".into(),
            title: String::new(),
            source: String::new(),
            license: String::new(),
            kind: pid_data::Kind::Simulated,
            input_hold: pid_data::InputHold::ZeroOrder,
            joints: Vec::new(),
            experiments,
            warnings: Vec::new(),
        }
    }

    #[test]
    fn every_training_record_is_left_out_once_and_test_records_never_enter() {
        let d = dataset(vec![
            record("a", Role::Train, 20),
            record("t", Role::Test, 20),
            record("b", Role::Train, 20),
        ]);
        let folds = folds(&d).unwrap();
        let out: Vec<Vec<(&str, Role)>> = folds
            .iter()
            .map(|f| {
                f.experiments
                    .iter()
                    .map(|e| (e.name.as_str(), e.role))
                    .collect()
            })
            .collect();
        assert_eq!(
            out,
            [
                [("a", Role::Test), ("b", Role::Train)],
                [("a", Role::Train), ("b", Role::Test)]
            ]
        );
    }

    #[test]
    fn a_single_record_is_cut_into_parts_that_cover_it() {
        let folds = folds(&dataset(vec![record("a", Role::Train, 31)])).unwrap();
        assert_eq!(folds.len(), PARTS);
        let all: Vec<f64> = folds[0]
            .experiments
            .iter()
            .flat_map(|e| e.q.clone())
            .collect();
        assert_eq!(all, record("a", Role::Train, 31).q);
        assert_eq!(folds[1].experiments[1].name, "a [10..20]");
        assert_eq!(folds[1].experiments[1].role, Role::Test);
    }

    #[test]
    fn the_spread_is_pooled_and_takes_no_offset_for_motion() {
        let mut still = record("b", Role::Train, 20);
        still.q.fill(7.0);
        let d = dataset(vec![record("a", Role::Train, 20), still]);
        // 0 … 19 has the variance (20² − 1)/12; half of the samples do not move.
        assert!((spread(&d)[0] - 0.5 * 399.0 / 12.0).abs() < 1e-12);
    }

    #[test]
    fn nothing_to_leave_out_is_said() {
        let error = folds(&dataset(vec![record("a", Role::Train, 12)])).unwrap_err();
        assert!(
            error
                .to_string()
                .starts_with("data set `d` has 12 training samples"),
            "{error}"
        );
    }
}
