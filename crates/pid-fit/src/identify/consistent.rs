//! Physical consistency of an identification: the fit once more with its links in log-Cholesky coordinates.

use pid_data::Dataset;
use pid_fit::ident::{self, Callback, Identification, Prepare, Settings};
use pid_fit::inertia::log_cholesky::LogCholesky;
use pid_fit::inertia::poses::indefinite_share;
use pid_runtime::dynamics::Hessian;

use crate::error::CliError;

/// Random poses in which the mass matrix is checked, and their seed.
const POSES: usize = 10_000;
const SEED: u64 = 0;

/// Fits again from the end of the unconstrained fit; its values are those of the model's own
/// parameters. The sentence states the cost of the constraint.
pub(crate) fn refit(
    model: &dyn Hessian,
    dataset: &Dataset,
    settings: &Settings,
    free: &Identification,
    callback: &mut Callback<'_>,
) -> Result<(Identification, String), CliError> {
    let wrapped = LogCholesky::new(model, &settings.hold).ok_or(CliError::NoLinks)?;
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
    let mut found = ident::identify(&wrapped, dataset, &settings, Some(&start), callback)?;
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
    let share = |p: &[f64]| 100.0 * indefinite_share(model, p, POSES, SEED);
    let links: Vec<&str> = wrapped.links().collect();
    let mut sentence = format!(
        "Physical consistency: {} in log-Cholesky coordinates; J = {:.6e}, {:.6e} without. Random poses with an indefinite mass matrix: {:.2} % of {POSES}, {:.2} % without.",
        links.join(", "),
        found.best().objective,
        free.best().objective,
        share(&p),
        share(unconstrained)
    );
    if lost > 0 {
        sentence.push_str(&format!(
            " {lost} priors of these links' parameters have no form in coordinates and were left out."
        ));
    }
    Ok((found, sentence))
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
