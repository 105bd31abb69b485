//! Profile likelihood: how far a parameter can go while all others follow.
//!
//! ```text
//! { p_j : N (J(p_j) − J*) ≤ χ²₁(0.95) u },      J(p_j) = min over all other parameters and states
//! ```
//!
//! u is the dispersion of the residuals under the loss (J. T. Kent, Biometrika 69, 1982; the
//! residual variance for squares) times the factor for correlated residuals. The secant method
//! finds the ends on √(N (J − J*)/u), which is linear where the objective is quadratic. It starts
//! from the ends that the Hessian predicts.

use super::error::IdentError;
use super::estimate::once;
use super::outcome::{Callback, Identification, Progress, Run};
use super::settings::{Prepare, Settings};
use crate::ident::Likelihood;
use pid_data::Dataset;
use pid_runtime::dynamics::Hessian;

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

/// Profiles parameters of a finished identification.
///
/// Noise levels stay as they were found. They belong to the residuals of the fit, not to its
/// weights, so one more fit finds the lowest objective.
pub struct Profiler<'a> {
    model: &'a dyn Hessian,
    dataset: &'a Dataset,
    /// Settings of the fits: levels stated, one start.
    settings: Settings,
    found: &'a Identification,
    /// The best run under these settings.
    base: Run,
    /// A difference of sums is divided by this.
    unit: f64,
}

impl<'a> Profiler<'a> {
    /// Prepares an identification with its own `settings`.
    ///
    /// # Errors
    /// As [`super::identify`].
    pub fn new(
        model: &'a dyn Hessian,
        dataset: &'a Dataset,
        settings: &Settings,
        found: &'a Identification,
        callback: &mut Callback<'_>,
    ) -> Result<Self, IdentError> {
        let settings = Settings {
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
        let base = once(
            model,
            dataset,
            &settings,
            &found.best().parameters,
            callback,
        )?;
        Ok(Profiler {
            model,
            dataset,
            settings,
            found,
            unit: found.correlation_factor * found.dispersion / found.windows.1.max(1) as f64,
            base: base.best().clone(),
        })
    }

    /// Cost of holding a parameter at a value while all others follow: `N (J(p_j) − J*) / u`. It is
    /// at most χ²₁(0.95) = 3.84 within the 95 % interval, and χ²₁ distributed at the truth (S. S.
    /// Wilks, Ann. Math. Stat. 9, 1938). `NaN` if no motion was found.
    ///
    /// # Errors
    /// As [`super::identify`]; [`IdentError::NoParameter`] for a position outside of the model or a
    /// parameter that is held.
    pub fn deviance(
        &self,
        parameter: usize,
        value: f64,
        callback: &mut Callback<'_>,
    ) -> Result<f64, IdentError> {
        let settings = self.holding(parameter)?;
        let mut from = self.base.parameters.clone();
        from[parameter] = value;
        self.refit(&settings, &mut from, callback)
    }

    /// The interval of 95 % of a parameter.
    ///
    /// # Errors
    /// As [`Profiler::deviance`].
    pub fn interval(
        &self,
        parameter: usize,
        callback: &mut Callback<'_>,
    ) -> Result<Profile, IdentError> {
        let settings = self.holding(parameter)?;
        let found = self.found;
        let (mut fits, mut stopped) = (0, false);
        let mut distance = |value: f64, from: &mut Vec<f64>| -> Result<f64, IdentError> {
            if stopped {
                return Ok(f64::NAN);
            }
            fits += 1;
            from[parameter] = value;
            let mut news = |progress: &Progress<'_>| {
                let flow = callback(progress);
                stopped |= flow.is_break();
                flow
            };
            Ok(self.refit(&settings, from, &mut news)?.max(0.0).sqrt())
        };
        let value = self.base.parameters[parameter];
        let mut ends = [None, None];
        for (end, side) in ends.iter_mut().zip([-1.0, 1.0]) {
            let bound = match side < 0.0 {
                true => found.lower[parameter],
                false => found.upper[parameter],
            };
            let room = (bound - value).abs();
            let first = self.first_step(parameter, room);
            let mut from = self.base.parameters.clone();
            // Distances from the value and their costs; the cost rises with the distance.
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
            // The bound comes before the level.
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

    /// How far the search of an end goes first, with so much room to the bound.
    fn first_step(&self, parameter: usize, room: f64) -> f64 {
        match self.found.deviations[parameter] {
            Some(d) => QUANTILE * d,
            None if room.is_finite() => 0.05 * room,
            None => 0.05 * self.base.parameters[parameter].abs().max(1.0),
        }
    }

    /// The settings of fits that hold a parameter.
    fn holding(&self, parameter: usize) -> Result<Settings, IdentError> {
        if self.found.fixed.get(parameter).copied().unwrap_or(true) {
            return Err(IdentError::NoParameter {
                position: parameter,
                parameters: self.found.fixed.len(),
            });
        }
        let mut settings = self.settings.clone();
        settings.hold.push(parameter);
        Ok(settings)
    }

    /// The deviance of a fit from a start, which it moves to the fit's end.
    fn refit(
        &self,
        settings: &Settings,
        from: &mut Vec<f64>,
        callback: &mut Callback<'_>,
    ) -> Result<f64, IdentError> {
        let here = once(self.model, self.dataset, settings, from, callback)?;
        let run = here.best();
        if !run.objective.is_finite() {
            return Ok(f64::NAN);
        }
        from.clone_from(&run.parameters);
        Ok((run.objective - self.base.objective) / self.unit)
    }
}
