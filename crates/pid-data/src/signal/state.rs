//! Positions, velocities and accelerations of an experiment.

use super::{
    Butterworth, FilterError, Interpolation, central_differences, choose_cutoff, column,
    fill_missing, map_columns, resample, uniform_times,
};
use crate::{Experiment, InputHold};

/// Order of the low-pass filter.
const ORDER: usize = 4;
/// A record is unevenly sampled if a step differs from the median by more than this share.
const UNEVEN: f64 = 0.01;

/// Why a state cannot be estimated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SignalError {
    /// The filter cannot be made.
    #[error("experiment `{experiment}`: {error}")]
    Filter {
        /// The experiment.
        experiment: String,
        /// The fault of the filter.
        error: FilterError,
    },
    /// Too few samples for accelerations.
    #[error(
        "experiment `{experiment}` has {samples} samples; accelerations need at least 5\n  help: use a longer record"
    )]
    TooShort {
        /// The experiment.
        experiment: String,
        /// Its samples.
        samples: usize,
    },
    /// A channel without a single value.
    #[error(
        "experiment `{experiment}`: all cells of `{channel}` are empty\n  help: remove the experiment, or record the channel"
    )]
    NoValues {
        /// The experiment.
        experiment: String,
        /// The channel, `q2`.
        channel: String,
    },
}

/// States at the samples of an experiment; shapes N × nq, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct StateEstimate {
    /// Positions, rad or m.
    pub q: Vec<f64>,
    /// Velocities, rad/s or m/s.
    pub v: Vec<f64>,
    /// Accelerations, rad/s² or m/s².
    pub a: Vec<f64>,
    /// Cut-off of the low-pass filter, Hz.
    pub cutoff: f64,
    /// Missing samples that were filled by straight lines.
    pub filled: usize,
}

/// Filters row-by-row channels without phase shift (Butterworth of order 4, both ways).
///
/// `t` are the times of the samples, s; `cutoff` is in Hz. Unevenly sampled records (steps more
/// than 1 % off their median) are brought to a uniform grid by cubic interpolation, filtered, and
/// brought back. Use it on inputs too when they are compared with filtered states. Missing samples
/// must have been filled.
///
/// # Errors
/// [`FilterError`] if the cut-off does not lie between 0 and half the sampling rate.
pub fn low_pass_channels(
    t: &[f64],
    x: &[f64],
    columns: usize,
    cutoff: f64,
) -> Result<Vec<f64>, FilterError> {
    let grid = Grid::new(t);
    let filter = Butterworth::low_pass(ORDER, cutoff, 1.0 / grid.step)?;
    Ok(map_columns(x, columns, |c| grid.filter(&filter, t, c)))
}

/// Positions, velocities and accelerations from the channels of an experiment.
///
/// 1. Missing samples are filled by straight lines (and counted).
/// 2. All channels pass the same zero-phase low-pass of order 4, so that nothing is shifted against
///    anything else. `cutoff` is in Hz; `None` takes the highest of the cut-offs that
///    [`choose_cutoff`] finds for the position and velocity channels, so that no joint's motion is
///    cut.
/// 3. v is the filtered velocity channel where there is one, otherwise the central difference of
///    the filtered q.
/// 4. a is the central difference of v.
///
/// # Errors
/// [`SignalError`] for records of fewer than 5 samples, channels without values, impossible cut-offs.
pub fn state_from_data(
    experiment: &Experiment,
    cutoff: Option<f64>,
) -> Result<StateEstimate, SignalError> {
    let (n, nq, t) = (experiment.len(), experiment.nq, experiment.t.as_slice());
    let name = || experiment.name.clone();
    if n < 5 {
        return Err(SignalError::TooShort {
            experiment: name(),
            samples: n,
        });
    }
    let mut filled = 0;
    let mut q = Vec::with_capacity(nq);
    for j in 0..nq {
        let mut c = column(&experiment.q, nq, j);
        let gaps = fill_missing(t, &mut c);
        if gaps == n {
            let channel = format!("q{}", j + 1);
            return Err(SignalError::NoValues {
                experiment: name(),
                channel,
            });
        }
        filled += gaps;
        q.push(c);
    }

    let grid = Grid::new(t);
    let rate = 1.0 / grid.step;
    let cutoff = cutoff.unwrap_or_else(|| {
        // Velocities hold the faster part of the motion.
        let velocities = (0..nq).filter_map(|j| {
            let mut c = column(experiment.v.as_ref()?, nq, j);
            (fill_missing(t, &mut c) < n).then_some(c)
        });
        let channels = q.iter().cloned().chain(velocities);
        channels
            .map(|c| choose_cutoff(&grid.to_uniform(t, &c), rate))
            .fold(0.0, f64::max)
    });
    let filter =
        Butterworth::low_pass(ORDER, cutoff, rate).map_err(|error| SignalError::Filter {
            experiment: name(),
            error,
        })?;

    let mut out = StateEstimate {
        q: vec![0.0; n * nq],
        v: vec![0.0; n * nq],
        a: vec![0.0; n * nq],
        cutoff,
        filled,
    };
    for (j, raw) in q.iter().enumerate() {
        let position = grid.filter(&filter, t, raw);
        let recorded = experiment.v.as_ref().map(|v| column(v, nq, j));
        let velocity = match recorded {
            Some(mut c) if c.iter().any(|x| !x.is_nan()) => {
                out.filled += fill_missing(t, &mut c);
                grid.filter(&filter, t, &c)
            }
            _ => central_differences(t, &position),
        };
        let acceleration = central_differences(t, &velocity);
        for i in 0..n {
            out.q[i * nq + j] = position[i];
            out.v[i * nq + j] = velocity[i];
            out.a[i * nq + j] = acceleration[i];
        }
    }
    Ok(out)
}

/// A uniform grid over a record.
struct Grid {
    step: f64,
    /// Times of the grid; empty if the record itself is uniform.
    times: Vec<f64>,
}

impl Grid {
    fn new(t: &[f64]) -> Self {
        let n = t.len();
        let mut steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
        if steps.is_empty() {
            return Grid {
                step: 1.0,
                times: Vec::new(),
            };
        }
        let middle = steps.len() / 2;
        let step = *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
        if steps.iter().all(|s| (s - step).abs() <= UNEVEN * step) {
            return Grid {
                step: (t[n - 1] - t[0]) / (n - 1) as f64,
                times: Vec::new(),
            };
        }
        let count = ((t[n - 1] - t[0]) / step).round().max(1.0) as usize;
        let step = (t[n - 1] - t[0]) / count as f64;
        Grid {
            step,
            times: uniform_times(t[0], step, count + 1),
        }
    }

    fn to_uniform(&self, t: &[f64], x: &[f64]) -> Vec<f64> {
        if self.times.is_empty() {
            x.to_vec()
        } else {
            resample(t, x, &self.times, Interpolation::Cubic)
        }
    }

    fn filter(&self, filter: &Butterworth, t: &[f64], x: &[f64]) -> Vec<f64> {
        let y = filter.both_ways(&self.to_uniform(t, x));
        if self.times.is_empty() {
            y
        } else {
            resample(&self.times, &y, t, Interpolation::Cubic)
        }
    }
}

/// Inputs as they act around each sample, N × inputs: under zero-order hold the mean of the values
/// before and after it. Missing values are filled.
pub fn acting_inputs(experiment: &Experiment, hold: InputHold) -> Vec<f64> {
    let (n, nq) = (experiment.len(), experiment.nq);
    let mut u = experiment.u.clone();
    for j in 0..nq {
        let mut channel: Vec<f64> = (0..n).map(|i| u[i * nq + j]).collect();
        fill_missing(&experiment.t, &mut channel);
        for i in 0..n {
            u[i * nq + j] = match hold {
                InputHold::ZeroOrder if i > 0 => 0.5 * (channel[i - 1] + channel[i]),
                _ => channel[i],
            };
        }
    }
    u
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Role;

    /// q1 = sin 3t, q2 = cos 2t; the velocity of the first joint only.
    fn experiment(t: Vec<f64>, with_v: bool) -> Experiment {
        let q = t
            .iter()
            .flat_map(|t| [(3.0 * t).sin(), (2.0 * t).cos()])
            .collect();
        let v = with_v.then(|| {
            t.iter()
                .flat_map(|t| [3.0 * (3.0 * t).cos(), f64::NAN])
                .collect()
        });
        let u = vec![0.0; 2 * t.len()];
        Experiment {
            name: "e".into(),
            role: Role::Train,
            note: String::new(),
            nq: 2,
            t,
            q,
            v,
            u,
            tau: None,
            qref: None,
            missing: 0,
            gain_factors: Default::default(),
        }
    }

    fn check_state(t: Vec<f64>, with_v: bool, tolerance: f64) {
        let e = experiment(t, with_v);
        let s = state_from_data(&e, None).unwrap();
        for i in 30..e.len() - 30 {
            let t = e.t[i];
            let expected = [
                (s.q[2 * i], (3.0 * t).sin()),
                (s.q[2 * i + 1], (2.0 * t).cos()),
                (s.v[2 * i], 3.0 * (3.0 * t).cos()),
                (s.v[2 * i + 1], -2.0 * (2.0 * t).sin()),
                (s.a[2 * i], -9.0 * (3.0 * t).sin()),
                (s.a[2 * i + 1], -4.0 * (2.0 * t).cos()),
            ];
            for (k, (found, truth)) in expected.into_iter().enumerate() {
                assert!(
                    (found - truth).abs() < tolerance,
                    "sample {i}, value {k}: {found} for {truth}"
                );
            }
        }
    }

    #[test]
    fn states_of_known_motions_on_even_and_uneven_grids() {
        let even: Vec<f64> = (0..500).map(|i| 0.01 * f64::from(i)).collect();
        check_state(even.clone(), true, 5e-3);
        check_state(even.clone(), false, 5e-3);
        let uneven = even.iter().map(|t| t + 0.002 * (20.0 * t).sin()).collect();
        check_state(uneven, false, 2e-2);
    }

    #[test]
    fn missing_samples_are_filled_and_counted() {
        let mut e = experiment((0..300).map(|i| 0.01 * f64::from(i)).collect(), true);
        e.q[2 * 100] = f64::NAN;
        e.v.as_mut().unwrap()[2 * 150] = f64::NAN;
        let s = state_from_data(&e, Some(20.0)).unwrap();
        assert_eq!((s.filled, s.cutoff), (2, 20.0));
        assert!(s.q.iter().chain(&s.v).chain(&s.a).all(|x| x.is_finite()));
        assert!((s.q[200] - 3.0_f64.sin()).abs() < 2e-3);
    }

    #[test]
    fn what_cannot_be_estimated_is_said() {
        let mut e = experiment((0..300).map(|i| 0.01 * f64::from(i)).collect(), false);
        let text = state_from_data(&e, Some(80.0)).unwrap_err().to_string();
        assert!(
            text.contains("`e`") && text.contains("80 Hz") && text.contains("below 50"),
            "{text}"
        );
        e.q.iter_mut()
            .skip(1)
            .step_by(2)
            .for_each(|x| *x = f64::NAN);
        let text = state_from_data(&e, None).unwrap_err().to_string();
        assert!(text.contains("`q2`"), "{text}");
        let short = experiment(vec![0.0, 0.1, 0.2], false);
        assert!(matches!(
            state_from_data(&short, None),
            Err(SignalError::TooShort { samples: 3, .. })
        ));
    }
}
