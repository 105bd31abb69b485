//! Cases whose cause is known are diagnosed blind, then the causes are opened.
//!
//! A case and its cause are laid out by [`pid_withheld`], its diagnosis is `results/ID.json` beside
//! them. What is there already is not made again, so that an interrupted study goes on where it
//! stopped.

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use pid_diagnose::case::Case;
use pid_diagnose::diagnosis::Diagnosis;
use pid_diagnose::search::{Settings, diagnose};
use pid_withheld::{Study, folder, lay_out, read};
use rayon::prelude::*;

use super::score::Outcome;
use crate::{Failure, write};

/// Makes the `i`-th case of a plan below `out`, diagnoses it and opens the cause. The diagnosis is kept below
/// `results`.
///
/// # Errors
/// If a file cannot be written, or one of an earlier run cannot be read.
pub(super) fn diagnose_one<S: Study>(
    plan: &S,
    i: usize,
    settings: &Settings,
    out: &Path,
    results: &Path,
) -> Result<Outcome<S::Truth>, Failure> {
    let id = plan.id(i);
    let here = lay_out(plan, i, out)?;
    let file = format!("{id}.json");
    let kept = results.join(&file);
    if read::<Diagnosis>(&kept)?.is_none() {
        let case = Case::read(&here).map_err(|error| format!("case {id}: {error}"))?;
        write(&kept, &diagnose(&case, settings).to_json())?;
    }
    let gone = |path: &Path| format!("{}: is gone", path.display());
    let truth = out.join("truth").join(&file);
    Ok(Outcome {
        truth: read(&truth)?.ok_or_else(|| gone(&truth))?,
        // Made or kept, the diagnosis is the one of the file.
        diagnosis: read(&kept)?.ok_or_else(|| gone(&kept))?,
        id,
    })
}

/// Makes the cases of a plan that are `wanted`, diagnoses them and opens the causes; `progress` is told
/// how many are done, of how many.
///
/// # Errors
/// If a file cannot be written, or one of an earlier run cannot be read.
pub fn diagnose_some<S: Study>(
    plan: &S,
    wanted: &[usize],
    settings: &Settings,
    out: &Path,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Vec<Outcome<S::Truth>>, Failure> {
    let results = folder(out.join("results"))?;
    let done = AtomicUsize::new(0);
    let mut outcomes = wanted
        .par_iter()
        .map(|&i| {
            let outcome = diagnose_one(plan, i, settings, out, &results)?;
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, wanted.len());
            Ok(outcome)
        })
        .collect::<Result<Vec<_>, Failure>>()?;
    outcomes.sort_by(|a, b| a.id.cmp(&b.id));
    Ok(outcomes)
}

/// The same for all cases of a plan.
///
/// # Errors
/// As those of [`diagnose_some`].
pub fn diagnose_all<S: Study>(
    plan: &S,
    settings: &Settings,
    out: &Path,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Vec<Outcome<S::Truth>>, Failure> {
    let all: Vec<usize> = (0..plan.cases()).collect();
    diagnose_some(plan, &all, settings, out, progress)
}
