//! Chooses the filter by left-out training records.
//!
//! A residual that is filtered harder is smaller, whatever the parameters, so comparing shares
//! after each candidate's own filter would choose the lowest cut-off. Each candidate therefore only
//! *fits* with its filter. Its values are judged on the left-out record through one filter for all,
//! at twice the band that holds 99 % of the power of every joint's velocity: above it there is
//! noise that no parameter explains. Test records play no part.

use pid_data::signal::SignalError;
use pid_data::{Dataset, Role};
use rayon::prelude::*;

use crate::regress::columns::LinearModel;
use crate::regress::normal::Normal;
use crate::regress::record::{Filtering, Record};
use crate::regress::solution::{self, How};
use crate::regress::unknowns::Unknowns;

/// Ratio between neighbouring candidates.
const RATIO: f64 = std::f64::consts::SQRT_2;
/// Lowest and highest candidate, as multiples of the common cut-off and of the one that the noise suggests.
const ENDS: (f64, f64) = (0.5, 2.0);
/// Share of a joint's velocity power that the band of the motion holds.
const POWER: f64 = 0.99;
/// The common cut-off, as a multiple of that band.
const ABOVE: f64 = 2.0;
/// Lowest band that is looked at, as a share of the cut-off that the noise suggests.
const LOWEST: f64 = 1e-3;
/// Highest candidate, as a share of the sampling rate.
const HIGHEST: f64 = 0.4;
/// Folds of a record that stands alone.
const FOLDS: usize = 4;

/// A candidate and its score.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Cut-off of the states' filter, Hz.
    pub cutoff: f64,
    /// Mean share of the drives' force left on left-out training records, judged through the common
    /// filter; infinite where a fold could not be solved.
    pub left_out: f64,
}

/// The outcome.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// The chosen filter.
    pub filtering: Filtering,
    /// All candidates, in rising order of the cut-off.
    pub candidates: Vec<Candidate>,
    /// Cut-off through which all were judged, Hz.
    pub judged_at: f64,
}

/// Chooses the cut-off; the decimation follows `decimate`, or the cut-off.
///
/// # Errors
/// [`SignalError`] for records that cannot be filtered.
pub fn choose(
    model: &LinearModel<'_>,
    unknowns: &Unknowns,
    dataset: &Dataset,
    rest: &[f64],
    decimate: Option<usize>,
    how: &How,
) -> Result<Choice, SignalError> {
    let own = Filtering {
        cutoff: None,
        decimate: None,
    };
    let train = |filtering| {
        Record::of(dataset, filtering, model.memories(), |e| {
            e.role == Role::Train
        })
    };
    let common = train(own)?;
    let mut cutoffs: Vec<f64> = common.iter().map(|r| r.cutoff).collect();
    cutoffs.sort_by(f64::total_cmp);
    let middle = cutoffs.get(cutoffs.len() / 2).copied().unwrap_or(1.0);
    let rate = dataset
        .with_role(Role::Train)
        .map(|e| 1.0 / e.sample_time().max(f64::MIN_POSITIVE))
        .fold(f64::INFINITY, f64::min);
    let stated = |cutoff| Filtering {
        cutoff: Some(cutoff),
        decimate: None,
    };
    let whole = power(&common);
    let mut band = LOWEST * middle;
    while band * RATIO < middle {
        let held = train(stated(band)).map(|records| power(&records));
        let holds = |held: Vec<f64>| held.iter().zip(&whole).all(|(h, w)| *h >= POWER * w);
        if held.is_ok_and(holds) {
            break;
        }
        band *= RATIO;
    }
    let judged_at = (ABOVE * band).min(middle);
    let sums = |records: &[Record]| {
        let normal = Normal::new(model, records, Some(rest));
        if unknowns.plain() {
            return normal;
        }
        let places = records.iter().enumerate();
        let places = places.map(|(r, record)| unknowns.place(&record.name, Some(r)));
        normal.placed(unknowns.infos().len(), places.collect())
    };
    let judge = sums(&train(stated(judged_at))?);
    let highest = (ENDS.1 * middle).min(HIGHEST * rate);
    let candidates: Vec<Candidate> = (0..)
        .map(|k| ENDS.0 * judged_at * RATIO.powi(k))
        .take_while(|c| *c <= highest)
        .map(|cutoff| {
            let filtering = Filtering {
                cutoff: Some(cutoff),
                decimate,
            };
            let left_out = match train(filtering) {
                Ok(records) => left_out(&sums(&records), &judge, unknowns, how),
                Err(_) => f64::INFINITY,
            };
            Candidate { cutoff, left_out }
        })
        .collect();
    let best = candidates
        .iter()
        .min_by(|a, b| a.left_out.total_cmp(&b.left_out))
        .filter(|c| c.left_out.is_finite());
    Ok(Choice {
        filtering: Filtering {
            cutoff: best.map(|c| c.cutoff),
            decimate,
        },
        judged_at,
        candidates,
    })
}

/// Power of each joint's velocity over all records.
fn power(records: &[Record]) -> Vec<f64> {
    let nq = records.first().map_or(0, |r| r.nq);
    (0..nq)
        .map(|j| {
            let own = records
                .iter()
                .flat_map(|r| r.v.iter().skip(j).step_by(nq.max(1)));
            own.map(|v| v * v).sum()
        })
        .collect()
}

/// Blocks of each fold: one record, or a quarter of a single one.
pub(crate) fn folds(normal: &Normal) -> Vec<Vec<usize>> {
    let blocks = normal.blocks.len();
    match normal.records.len() {
        1 => (0..FOLDS)
            .map(|f| (f * blocks / FOLDS..(f + 1) * blocks / FOLDS).collect())
            .collect(),
        records => (0..records)
            .map(|r| {
                (0..blocks)
                    .filter(|&b| normal.blocks[b].record == r)
                    .collect()
            })
            .collect(),
    }
}

fn left_out(fit: &Normal, judge: &Normal, unknowns: &Unknowns, how: &How) -> f64 {
    let shares: Option<Vec<f64>> = folds(fit)
        .into_par_iter()
        .zip(folds(judge))
        .enumerate()
        .map(|(record, (out, judged))| {
            let rest: Vec<usize> = (0..fit.blocks.len()).filter(|b| !out.contains(b)).collect();
            let total = fit.resampled(&rest).total(|_| true);
            let p = solution::estimate(&total, how).ok()?.columns();
            let p = unknowns.left_out(p, record);
            solution::overall(&judge.resampled(&judged), &p, |_| true)
        })
        .collect();
    match shares {
        Some(shares) if !shares.is_empty() => shares.iter().sum::<f64>() / shares.len() as f64,
        _ => f64::INFINITY,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Recipe, records};
    use pid_models::Emps;
    use pid_runtime::dynamics::Dynamics;

    /// Positions with noise: too low a cut-off loses the motion, too high a one lets noise into the
    /// regressor.
    #[test]
    fn the_choice_recovers_the_inertia_better_than_extremes() {
        let truth: Vec<f64> = Emps.params().iter().map(|i| i.nominal).collect();
        let recipe = Recipe {
            records: 4,
            seconds: 6.0,
            step: 2e-3,
            amplitude: vec![150.0],
            highest: 4.0,
            start: vec![0.0],
            noise: vec![2e-5, f64::INFINITY],
            outliers: (0.0, 1.0),
        };
        let dataset = records(&Emps, &truth, &recipe, 3).expect("simulates");
        let model = LinearModel::new(&Emps, &truth, &[]);
        let rest = [2e-3];
        let unknowns = Unknowns::new(&model, &truth, &[], None, &[]).expect("plain");
        let choice =
            choose(&model, &unknowns, &dataset, &rest, None, &How::default()).expect("filters");
        let error = |cutoff: f64| {
            let filtering = Filtering {
                cutoff: Some(cutoff),
                decimate: None,
            };
            let records = Record::of(&dataset, filtering, &[], |_| true).expect("filters");
            let normal = Normal::new(&model, &records, Some(&rest));
            let total = normal.total(|_| true);
            let p = solution::estimate(&total, &How::default())
                .expect("solvable")
                .columns();
            (p[0] / truth[0] - 1.0).abs()
        };
        let chosen = error(choice.filtering.cutoff.expect("a candidate can be solved"));
        let (low, high) = (
            choice.candidates[0],
            choice.candidates[choice.candidates.len() - 1],
        );
        assert!(chosen < 0.03, "{chosen}: {choice:?}");
        assert!(chosen < error(low.cutoff), "{choice:?}");
        assert!(chosen <= error(high.cutoff) + 5e-3, "{choice:?}");
    }
}
