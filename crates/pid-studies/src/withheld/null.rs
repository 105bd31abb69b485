//! What statistics of the verdict are where nothing is missing: quantiles over the cases of a study
//! whose cause is none, beside the limits of `Criteria::default()` and the share of these cases
//! beyond each limit.
//!
//! ```text
//! pid-studies withheld --seed 91201 --cases 300 --joints 3 --out STUDY
//! pid-studies null STUDY [STUDY …]
//! ```

use std::path::Path;

use pid_diagnose::criteria::Criteria;
use pid_diagnose::diagnosis::Diagnosis;
use pid_withheld::Truth;

use crate::Failure;

/// A statistic of a diagnosis and the limit it is judged by.
struct Statistic {
    name: &'static str,
    limit: f64,
    of: fn(&Diagnosis) -> f64,
}

fn statistics(criteria: &Criteria) -> Vec<Statistic> {
    let statistic = |name, limit, of| Statistic { name, limit, of };
    vec![
        statistic("gap over floor (near)", criteria.near, |d| {
            d.gap_before / d.gap_floor
        }),
        statistic(
            "mean squared innovation (nominal_misfit)",
            criteria.nominal_misfit,
            |d| d.misfit.0,
        ),
        statistic(
            "largest burst, 7 s at 500 Hz (allowance)",
            criteria.allowance * criteria.burst(20.0, 175.0),
            |d| d.residue.burst,
        ),
        statistic(
            "memory (allowance)",
            criteria.allowance * criteria.memory(10.0),
            |d| d.residue.memory,
        ),
        statistic("correlation (correlation)", criteria.correlation, |d| {
            d.residue.correlation
        }),
        statistic("test over train (unseen)", criteria.unseen, |d| {
            d.residue.unseen
        }),
        statistic(
            "gain of the best candidate (margin)",
            criteria.margin(),
            |d| d.ranking.first().map_or(f64::NAN, |r| r.score),
        ),
    ]
}

/// Diagnoses of the cases of a study in which nothing is missing.
fn of_nothing(study: &Path) -> Result<Vec<Diagnosis>, Failure> {
    let mut out = Vec::new();
    for entry in std::fs::read_dir(study.join("truth"))? {
        let path = entry?.path();
        let truth: Truth = serde_json::from_str(&std::fs::read_to_string(&path)?)?;
        let result = study
            .join("results")
            .join(path.file_name().unwrap_or_default());
        if truth.causes.is_empty() && result.exists() {
            out.push(serde_json::from_str(&std::fs::read_to_string(&result)?)?);
        }
    }
    Ok(out)
}

/// Prints a line for each statistic; `words`: folders of studies.
///
/// # Errors
/// A folder that cannot be read, or no case without a cause in any.
pub fn run(words: &[String]) -> Result<(), Failure> {
    let mut all = Vec::new();
    for study in words {
        all.extend(of_nothing(study.as_ref())?);
    }
    if all.is_empty() {
        let mend = "no case without a cause; give folders of `pid-studies withheld --out FOLDER`";
        return Err(mend.into());
    }
    println!("{} cases in which nothing is missing", all.len());
    for s in statistics(&Criteria::default()) {
        let mut x: Vec<f64> = all.iter().map(s.of).filter(|x| x.is_finite()).collect();
        x.sort_by(f64::total_cmp);
        let at = |share: f64| x[((x.len() - 1) as f64 * share).round() as usize];
        if x.is_empty() {
            continue;
        }
        let beyond = x.iter().filter(|x| **x > s.limit).count();
        println!(
            "{:42} median {:9.3}  95 % {:9.3}  largest {:9.3}  limit {:9.3}  beyond {} of {}",
            s.name,
            at(0.5),
            at(0.95),
            at(1.0),
            s.limit,
            beyond,
            x.len()
        );
    }
    Ok(())
}
