//! Where the parameters of an effect start besides the starts of its own.

use rayon::prelude::*;

use super::tuned;
use crate::effect::Term;
use crate::fit::{Fit, fit_free_runs};
use crate::search::candidates::has_state;
use crate::search::measure::measured;
use crate::search::settings::Settings;
use crate::search::spread::Spread;
use crate::search::stand::Stand;

/// Deviation of a parameter, as a share of its value, from which it counts as open: a choice on the case of
/// docs/experiments.md, where the gap is told to 0.03 and the rest to 0.23 to 0.5.
const OPEN: f64 = 0.1;
/// Starts that are followed, those from which free runs leave least: three keep the cost to some seconds.
const FOLLOWED: usize = 3;

/// Parameters of a term in the fits of which it is the last.
pub(super) fn last_of(fits: &[Fit], term: &Term) -> Vec<Vec<f64>> {
    let own = fits.iter().filter(|fit| {
        let last = fit.hypothesis.terms.last();
        last.is_some_and(|last| last.label() == term.label())
    });
    let size = term.effect.info().parameters.len();
    own.map(|fit| fit.point.e[fit.point.e.len() - size..].to_vec())
        .collect()
}

/// Where the open parameters of the `i`-th effect of a stand lead when they begin again, if the effect has
/// states and free runs leave less there.
///
/// Levels follow what a model leaves. A far too soft contact leaves much, and under its levels no step leads
/// to the stiff one. What is told of the effect stays, the rest begins at the effect's own starts. Parameters
/// go to predictions, to free runs and to predictions again, under new levels each time.
pub(super) fn begun_again(
    now: Stand,
    i: usize,
    part: f64,
    settings: &Settings,
    sensors: &[(f64, f64)],
) -> Stand {
    if !has_state(&now.fit.hypothesis.terms[i]) || settings.watch.stopped() {
        return now;
    }
    let ended = starts(&now, i, settings)
        .into_par_iter()
        .map(|start| {
            let first = tuned(&now.case, &start, part, settings, sensors);
            match fit_free_runs(&first.case, &first.directions, &first.fit) {
                Some(free) => tuned(&first.case, &free, part, settings, sensors),
                None => first,
            }
        })
        .min_by(|a, b| a.gap.total.total_cmp(&b.gap.total));
    match ended {
        Some(ended) if ended.gap.total < now.gap.total => ended,
        _ => now,
    }
}

/// The fit of a stand with the open parameters of its `i`-th effect at the effect's own starts; none where all
/// or none of them are open.
fn starts(now: &Stand, i: usize, settings: &Settings) -> Vec<Fit> {
    let Some(spread) = Spread::of_predictions(&now.case, &settings.criteria, &now.fit) else {
        return Vec::new();
    };
    let hypothesis = &now.fit.hypothesis;
    let (term, at) = (&hypothesis.terms[i], hypothesis.offsets().0[i]);
    let count = term.effect.info().parameters.len();
    let size = now.fit.point.theta.len();
    let own = &now.fit.point.e[at..at + count];
    let open: Vec<bool> = (0..count)
        .map(|k| spread.deviation(size + at + k) > OPEN * own[k].abs())
        .collect();
    if open.iter().all(|open| *open) {
        return Vec::new();
    }
    let mut mixed: Vec<Vec<f64>> = Vec::new();
    for start in now.case.starts(term) {
        let of = |k: usize| if open[k] { start[k] } else { own[k] };
        let start: Vec<f64> = (0..count).map(of).collect();
        if start != own && !mixed.contains(&start) {
            mixed.push(start);
        }
    }
    let mut fits: Vec<(f64, Fit)> = mixed
        .into_par_iter()
        .map(|start| {
            let mut fit = now.fit.clone();
            fit.point.e[at..at + count].copy_from_slice(&start);
            (measured(&now.case, &fit).total, fit)
        })
        .collect();
    fits.sort_by(|a, b| a.0.total_cmp(&b.0));
    fits.truncate(FOLLOWED);
    fits.into_iter().map(|(_, fit)| fit).collect()
}

#[cfg(test)]
mod tests {
    use super::super::readings;
    use super::*;
    use crate::bench::{SIZE, named, pendulum};
    use crate::fit::{Effort, Point, basis, fit};
    use crate::levels::WHOLE;

    /// The gap of a play stays, its far too soft contact begins again.
    #[test]
    fn a_contact_that_ended_too_soft_begins_again() {
        let play = named(&["backlash"]);
        let truth = [0.06, 0.0013, 0.0006, 0.0];
        let mut case = pendulum(&play, &truth, 8.0, &|_| {});
        case.nominal.horizon = Some(1.0);
        let (settings, sensors) = (Settings::default(), readings(&case));
        let from = |e: &[f64]| {
            let at = Point {
                theta: vec![0.0; SIZE],
                e: e.to_vec(),
            };
            let directions = basis(&case);
            let fit = fit(&case, &directions, &play, at, Effort::full(0));
            Stand {
                gap: measured(&case, &fit),
                case: case.clone(),
                directions,
                fit,
            }
        };
        let (soft, right) = (from(&[0.06, 0.0018, 0.018, 3e-5]), from(&truth));
        assert!(soft.gap.total > 2.0 * right.gap.total, "{:?}", soft.gap);
        let starts = starts(&soft, 0, &settings);
        assert!((1..=FOLLOWED).contains(&starts.len()));
        for start in &starts {
            assert_eq!(start.point.e[0], 0.06);
        }
        let left = soft.gap.total;
        let again = begun_again(soft, 0, WHOLE, &settings, &sensors);
        assert!(again.gap.total < 0.5 * left, "{:?} {left}", again.gap);
        for (own, truth) in again.fit.point.e.iter().zip(truth).take(3) {
            assert!((own / truth - 1.0).abs() < 0.1, "{own} for {truth}");
        }
        // From the truth on nothing gets worse.
        let left = right.gap.total;
        let stays = begun_again(right, 0, WHOLE, &settings, &sensors);
        assert!(stays.gap.total <= left, "{:?} {left}", stays.gap);
    }
}
