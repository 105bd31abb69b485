//! The missing generalised force, read off the data: what would have to act beside the model for it to follow the record.
//!
//! ```text
//! w(t) = r(q, v, a, u, p) = M(q, p) a + b(q, v, p) − f_L(q, v, p, u)
//! ```
//!
//! evaluated on states estimated from the record ([`crate::signal::state_from_data`]), with the inputs passed through the same
//! filter. It needs no simulation and no multipliers, works for any parameters, and is the horizon of one sample of the
//! process noise w of an identification.

use crate::data::{Dataset, Experiment, InputHold};
use crate::dynamics::{At, Jacobian};
use crate::signal::{SignalError, low_pass_channels, noise_level_without_jumps, state_from_data};

/// Missing force of one experiment; N × nq, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct MissingForceEstimate {
    /// Positions, rad or m.
    pub q: Vec<f64>,
    /// Velocities, rad/s or m/s.
    pub v: Vec<f64>,
    /// Missing force w, N·m or N.
    pub w: Vec<f64>,
    /// Two standard deviations of what measurement noise alone puts into w.
    pub band: Vec<f64>,
    /// Total generalised force of drives and friction, f_L + w = M a + b.
    pub total: Vec<f64>,
    /// Cut-off of the filter, Hz.
    pub cutoff: f64,
}

/// Computes w on one experiment. `cutoff` (Hz) as in [`state_from_data`].
///
/// An input that is held from sample to sample acts between them: at a sample it counts with the mean of the values before and
/// after. Within three periods of the cut-off of either end of the record (but never more than a tenth of it) the filter lacks
/// neighbours: w, its band and the total are NaN there. Missing inputs are bridged by straight lines.
///
/// The band takes white noise of the levels found by [`noise_level_without_jumps`] on the recorded channels through the filter's gain
/// |H(f)|² and the differentiation to variances of q, v, a and u, and from there through the exact ∂r/∂(q, v, a, u) to w; the
/// four are taken as uncorrelated, and motion that is not smooth over five samples counts as noise. Inputs that are held
/// from sample to sample are commands: their jumps are meant, and they are taken as free of noise.
///
/// # Errors
/// As [`state_from_data`].
pub fn missing_force(
    model: &dyn Jacobian,
    p: &[f64],
    dataset: &Dataset,
    experiment: &Experiment,
    cutoff: Option<f64>,
) -> Result<MissingForceEstimate, SignalError> {
    let (n, nq) = (experiment.len(), experiment.nq);
    let state = state_from_data(experiment, cutoff)?;
    let acting = acting_inputs(experiment, dataset.input_hold);
    let u = low_pass_channels(&experiment.t, &acting, nq, state.cutoff).map_err(|error| {
        SignalError::Filter {
            experiment: experiment.name.clone(),
            error,
        }
    })?;
    let variances = Variances::of(experiment, dataset.input_hold, state.cutoff);

    let pattern = model.jacobian_pattern();
    let mut values = vec![0.0; pattern.nnz()];
    let mut out = MissingForceEstimate {
        w: vec![0.0; n * nq],
        band: vec![0.0; n * nq],
        total: vec![0.0; n * nq],
        cutoff: state.cutoff,
        q: state.q,
        v: state.v,
    };
    let mut f = vec![0.0; nq];
    for i in 0..n {
        let row = i * nq..(i + 1) * nq;
        let at = At {
            q: &out.q[row.clone()],
            v: &out.v[row.clone()],
            a: &state.a[row.clone()],
            u: &u[row.clone()],
            p,
        };
        model.residual_jacobian(&at, &mut out.w[row.clone()], &mut values);
        model.applied_force(&at, &mut f);
        for (k, f) in row.clone().zip(&f) {
            out.total[k] = f + out.w[k];
        }
        let band = &mut out.band[row];
        for ((r, c), d) in pattern.rows.iter().zip(pattern.cols).zip(&values) {
            // z = (q, v, a, u, p), one input per joint.
            let (kind, joint) = (*c as usize / nq, *c as usize % nq);
            if kind < 4 {
                band[*r as usize] += d * d * variances.0[kind][joint];
            }
        }
        for b in band {
            *b = 2.0 * b.sqrt();
        }
    }
    let edge = ((3.0 / (state.cutoff * experiment.sample_time())).ceil() as usize).min(n / 10);
    for x in [&mut out.w, &mut out.band, &mut out.total] {
        x[..edge * nq].fill(f64::NAN);
        x[(n - edge) * nq..].fill(f64::NAN);
    }
    Ok(out)
}

/// Inputs as they act around each sample.
pub(crate) fn acting_inputs(experiment: &Experiment, hold: InputHold) -> Vec<f64> {
    let (n, nq) = (experiment.len(), experiment.nq);
    let mut u = experiment.u.clone();
    for j in 0..nq {
        let mut channel: Vec<f64> = (0..n).map(|i| u[i * nq + j]).collect();
        crate::signal::fill_missing(&experiment.t, &mut channel);
        for i in 0..n {
            u[i * nq + j] = match hold {
                InputHold::ZeroOrder if i > 0 => 0.5 * (channel[i - 1] + channel[i]),
                _ => channel[i],
            };
        }
    }
    u
}

/// Variances of filtered q, v, a, u per joint.
struct Variances([Vec<f64>; 4]);

impl Variances {
    fn of(experiment: &Experiment, hold: InputHold, cutoff: f64) -> Self {
        let nq = experiment.nq;
        let rate = 1.0 / experiment.sample_time();
        let level = |x: &[f64], j: usize| {
            let known: Vec<f64> = x
                .iter()
                .skip(j)
                .step_by(nq)
                .copied()
                .filter(|x| x.is_finite())
                .collect();
            let sigma = noise_level_without_jumps(&known);
            if sigma.is_finite() {
                Some(sigma * sigma)
            } else {
                None
            }
        };
        let gains: [f64; 3] = std::array::from_fn(|k| gain(k as i32, cutoff, rate));
        let mut out: [Vec<f64>; 4] = std::array::from_fn(|_| Vec::with_capacity(nq));
        for j in 0..nq {
            let q = level(&experiment.q, j).unwrap_or(0.0);
            let u = match hold {
                InputHold::Linear => level(&experiment.u, j).unwrap_or(0.0),
                InputHold::ZeroOrder => 0.0,
            };
            let (velocity, acceleration) = match experiment.v.as_ref().and_then(|v| level(v, j)) {
                Some(v) => (v * gains[0], v * gains[1]),
                None => (q * gains[1], q * gains[2]),
            };
            let variances = [q * gains[0], velocity, acceleration, u * gains[0]];
            for (channel, variance) in out.iter_mut().zip(variances) {
                channel.push(variance);
            }
        }
        Variances(out)
    }
}

/// Variance of white noise of variance 1 after the filter (order 4, both ways) and `k` central differences:
/// `2/f_s ∫ |H|⁴ (f_s sin(2π f / f_s))^{2k} df` over 0 … f_s/2, with `|H|² = 1 / (1 + (tan(π f/f_s) / tan(π f_c/f_s))⁸)`.
fn gain(k: i32, cutoff: f64, rate: f64) -> f64 {
    const N: usize = 2000;
    let corner = (std::f64::consts::PI * cutoff / rate).tan();
    let sum: f64 = (0..N)
        .map(|i| {
            let x = std::f64::consts::PI * (i as f64 + 0.5) / N as f64;
            let h2 = 1.0 / (1.0 + ((0.5 * x).tan() / corner).powi(8));
            h2 * h2 * (rate * x.sin()).powi(2 * k)
        })
        .sum();
    sum / N as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{InputQuantity, JointChannels, Kind, Role, VelocityKind};
    use crate::integrate::test_models::{PENDULUM, Pendulum};
    use crate::integrate::{Drive, Settings, simulate};

    /// A record of the pendulum with white noise of 1e-4 rad on the position.
    fn record(noise: f64) -> (Dataset, Experiment) {
        let t: Vec<f64> = (0..4000).map(|i| 0.002 * f64::from(i)).collect();
        let u: Vec<f64> = t.iter().map(|t| 4.0 * (2.0 * t).sin()).collect();
        let drive = Drive {
            t: &t,
            u: &u,
            hold: InputHold::ZeroOrder,
        };
        let m = simulate(
            &Pendulum,
            &PENDULUM,
            &[1.0],
            &[0.0],
            &drive,
            Settings::default(),
        )
        .unwrap();
        let mut state = 9_u64;
        let mut uniform = || {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let q =
            m.q.iter()
                .map(|q| q + noise * ((0..12).map(|_| uniform()).sum::<f64>() - 6.0))
                .collect();
        let experiment = Experiment {
            name: "e".into(),
            role: Role::Train,
            note: String::new(),
            nq: 1,
            t: t.clone(),
            q,
            v: None,
            u,
            tau: None,
            qref: None,
            missing: 0,
        };
        let dataset = Dataset {
            name: "d".into(),
            title: String::new(),
            source: String::new(),
            license: String::new(),
            kind: Kind::Simulated,
            input_hold: InputHold::ZeroOrder,
            joints: vec![JointChannels {
                name: "hinge".into(),
                prismatic: false,
                input: InputQuantity::Torque,
                input_unit: "N*m".into(),
                velocity: VelocityKind::Absent,
            }],
            experiments: Vec::new(),
            warnings: Vec::new(),
        };
        (dataset, experiment)
    }

    fn rms(x: &[f64]) -> f64 {
        (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt()
    }

    #[test]
    fn a_term_taken_from_the_model_comes_back_as_missing_force() {
        let (dataset, e) = record(0.0);
        let whole = missing_force(&Pendulum, &PENDULUM, &dataset, &e, Some(40.0)).unwrap();
        let inner = 200..3800;
        assert!(rms(&whole.w[inner.clone()]) < 5e-3 * rms(&whole.total[inner.clone()]));
        // Without viscous friction the missing force is −d v (as part of f_L).
        let mut p = PENDULUM;
        p[2] = 0.0;
        let part = missing_force(&Pendulum, &p, &dataset, &e, Some(40.0)).unwrap();
        for i in inner {
            let expected = -PENDULUM[2] * part.v[i];
            assert!(
                (part.w[i] - expected).abs() < 0.02,
                "{i}: {} {expected}",
                part.w[i]
            );
        }
    }

    #[test]
    fn the_band_is_as_wide_as_the_noise() {
        let (dataset, e) = record(1e-4);
        let m = missing_force(&Pendulum, &PENDULUM, &dataset, &e, Some(30.0)).unwrap();
        let inner = 200..3800;
        let inside = inner
            .clone()
            .filter(|i| m.w[*i].abs() <= m.band[*i])
            .count() as f64
            / inner.len() as f64;
        assert!(
            (0.92..0.98).contains(&inside),
            "two standard deviations hold 95 %: {inside}"
        );
    }
}
