//! Bodies of positive density after a fit: the fit once more with its links in log-Cholesky
//! coordinates.

use pid_data::Dataset;
use pid_runtime::dynamics::Hessian;

use super::request::{Consistency, IdentifyError, News, Tell};
use crate::ident::{self, Identification, Prepare, Settings};
use crate::inertia::log_cholesky::LogCholesky;
use crate::inertia::poses::indefinite_share;

/// Random poses in which the mass matrix is checked, and their seed.
const POSES: usize = 10_000;
const SEED: u64 = 0;

/// Fits again from the end of the unconstrained fit; its values are those of the model's own
/// parameters.
pub(super) fn refit(
    model: &dyn Hessian,
    dataset: &Dataset,
    settings: &Settings,
    free: &Identification,
    tell: &Tell<'_>,
) -> Result<(Identification, Consistency), IdentifyError> {
    let wrapped = LogCholesky::new(model, &settings.hold).ok_or(IdentifyError::NoLinks)?;
    let unconstrained = &free.best().parameters;
    let mut settings = Settings {
        starts: 1,
        prepare: Prepare::Motion,
        ..settings.clone()
    };
    let mut lost = 0;
    if let Some(likelihood) = &mut settings.likelihood {
        let before = likelihood.priors.len();
        likelihood.priors.retain(|p| !wrapped.replaces(p.parameter));
        lost = before - likelihood.priors.len();
    }
    let start = wrapped.enter(unconstrained);
    let mut found = ident::identify(&wrapped, dataset, &settings, Some(&start), &mut |i| {
        tell(&News::Consistent(i))
    })?;
    let x = found.best().parameters.clone();
    let p = wrapped.leave(&x);
    let slopes: Vec<Vec<(usize, f64)>> = (0..p.len()).map(|j| wrapped.slope(&x, j)).collect();
    let coordinates = found.deviations.clone();
    found.deviations = slopes
        .iter()
        .map(|slope| deviation(slope, &coordinates, &found))
        .collect();
    // Directions in coordinates are directions in parameters to first order.
    found.open = found
        .open
        .iter()
        .map(|direction| {
            let along = |k: usize| direction.iter().find(|d| d.0 == k).map_or(0.0, |d| d.1);
            let mut moved: Vec<(usize, f64)> = slopes
                .iter()
                .enumerate()
                .map(|(j, slope)| (j, slope.iter().map(|(k, s)| s * along(*k)).sum()))
                .collect();
            let most = moved.iter().fold(0.0_f64, |m, d| m.max(d.1.abs()));
            moved.retain(|d| d.1.abs() > 0.05 * most);
            moved
                .iter_mut()
                .for_each(|d| d.1 /= most.max(f64::MIN_POSITIVE));
            moved
        })
        .collect();
    found.covariance = None;
    (found.lower, found.upper) = (free.lower.clone(), free.upper.clone());
    let best = found.best;
    found.runs[best].parameters.clone_from(&p);
    found.runs[best].start.clone_from(unconstrained);
    let share = |p: &[f64]| indefinite_share(model, p, POSES, SEED);
    let cost = Consistency {
        links: wrapped.links().map(str::to_owned).collect(),
        objective: (found.best().objective, free.best().objective),
        indefinite: (share(&p), share(unconstrained)),
        poses: POSES,
        lost_priors: lost,
    };
    Ok((found, cost))
}

/// Deviations from the coordinates' covariance, if all coordinates that matter are determined.
fn deviation(
    slope: &[(usize, f64)],
    coordinates: &[Option<f64>],
    found: &Identification,
) -> Option<f64> {
    let used: Vec<&(usize, f64)> = slope.iter().filter(|s| s.1 != 0.0).collect();
    if let [(k, s)] = used[..] {
        return coordinates[*k].map(|d| d * s.abs());
    }
    let covariance = found.covariance.as_ref()?;
    let n = covariance.free.len();
    let places: Vec<(usize, f64)> = used
        .iter()
        .map(|(k, s)| {
            coordinates[*k]?;
            Some((covariance.free.iter().position(|f| f == k)?, *s))
        })
        .collect::<Option<_>>()?;
    let variance: f64 = places
        .iter()
        .flat_map(|(i, a)| {
            let row = &covariance.values[i * n..(i + 1) * n];
            places.iter().map(move |(k, b)| a * b * row[*k])
        })
        .sum();
    Some(variance.max(0.0).sqrt())
}
