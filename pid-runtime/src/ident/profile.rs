//! Profile likelihood: how far a parameter can go while all others follow.
//!
//! ```text
//! { p_j : N (J(p_j) − J*) ≤ χ²₁(0.95) u },      J(p_j) = min over all other parameters and states
//! ```
//!
//! With noise levels the objective J is −2 log of the density over N and u the factor for correlated residuals; without them u
//! is the residual variance of the weighted objective times that factor. The ends are found by the secant method on
//! √(N (J − J*)/u), which is linear where the objective is quadratic, from the ends that the Hessian foretells.

use super::{Callback, IdentError, Identification, Prepare, Settings, once};
use crate::data::Dataset;
use crate::dynamics::Hessian;
use crate::ident::Likelihood;

/// √χ²₁(0.95).
const QUANTILE: f64 = 1.959_963_984_540_054;
/// Most fits per end.
const FITS: usize = 12;
/// Error of an end, relative to its distance.
const CLOSE: f64 = 1e-2;

/// An interval of 95 % by profile likelihood.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Profile {
    /// Lower end; `None` if it is the parameter's bound.
    pub lower: Option<f64>,
    /// Upper end.
    pub upper: Option<f64>,
    /// Fits it took.
    pub fits: usize,
}

/// Profiles one parameter of a finished identification; noise levels stay as they were found.
///
/// # Errors
/// As [`super::identify`]; [`IdentError::NoParameter`] for a position outside of the model or a parameter that is held.
pub fn profile(
    model: &dyn Hessian,
    dataset: &Dataset,
    settings: &Settings,
    found: &Identification,
    parameter: usize,
    callback: &mut Callback<'_>,
) -> Result<Profile, IdentError> {
    let best = found.best();
    if found.fixed.get(parameter).copied().unwrap_or(true) {
        return Err(IdentError::NoParameter {
            position: parameter,
            parameters: found.fixed.len(),
        });
    }
    let samples = found.windows.1.max(1) as f64;
    let unit = match &settings.likelihood {
        Some(_) => found.correlation_factor,
        None => found.correlation_factor * best.objective,
    };
    let mut settings = Settings {
        starts: 1,
        prepare: Prepare::Motion,
        likelihood: settings.likelihood.as_ref().map(|l| Likelihood {
            noise: match l.noise.as_slice() {
                [] => found.noise.clone(),
                noise => noise
                    .iter()
                    .zip(&found.noise)
                    .map(|(a, b)| a.or(*b))
                    .collect(),
            },
            ..l.clone()
        }),
        sandwich: false,
        ..settings.clone()
    };
    settings.hold.push(parameter);
    let (mut fits, mut stopped) = (0, false);
    let mut distance = |value: f64, from: &mut Vec<f64>| -> Result<f64, IdentError> {
        if stopped {
            return Ok(f64::NAN);
        }
        fits += 1;
        from[parameter] = value;
        let mut news = |progress: &super::Progress<'_>| {
            let flow = callback(progress);
            stopped |= flow.is_break();
            flow
        };
        let here = once(model, dataset, &settings, from, &mut news)?;
        let run = here.best();
        if !run.objective.is_finite() {
            return Ok(f64::NAN);
        }
        from.clone_from(&run.parameters);
        Ok((samples * (run.objective - best.objective).max(0.0) / unit).sqrt())
    };
    let value = best.parameters[parameter];
    let mut ends = [None, None];
    for (end, side) in ends.iter_mut().zip([-1.0, 1.0]) {
        let bound = match side < 0.0 {
            true => found.lower[parameter],
            false => found.upper[parameter],
        };
        let room = (bound - value).abs();
        let first = found.deviations[parameter].map_or_else(
            || {
                0.05 * if room.is_finite() {
                    room
                } else {
                    value.abs().max(1.0)
                }
            },
            |d| QUANTILE * d,
        );
        let mut from = best.parameters.clone();
        // Distances from the value and what they cost; the cost rises with the distance.
        let (mut low, mut high) = ((0.0, 0.0), None::<(f64, f64)>);
        let mut step = first.min(room);
        for _ in 0..FITS {
            let cost = distance(value + side * step, &mut from)?;
            if cost.is_nan() {
                break;
            }
            if (cost / QUANTILE - 1.0).abs() < CLOSE {
                *end = Some(value + side * step);
                break;
            }
            if cost > QUANTILE {
                high = Some((step, cost));
            } else {
                low = (step, cost);
                if step >= room {
                    break;
                }
            }
            step = match high {
                Some(high) => {
                    let share = (QUANTILE - low.1) / (high.1 - low.1);
                    low.0 + share.clamp(0.1, 0.9) * (high.0 - low.0)
                }
                None if low.1 > 0.2 => low.0 * (1.05 * QUANTILE / low.1).clamp(1.1, 4.0),
                None => 4.0 * low.0,
            }
            .min(room);
            *end = Some(value + side * step);
        }
        // At the bound before the level was reached.
        if high.is_none() && low.0 >= room {
            *end = None;
        }
    }
    Ok(Profile {
        lower: ends[0],
        upper: ends[1],
        fits,
    })
}
