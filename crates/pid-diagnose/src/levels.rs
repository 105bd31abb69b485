//! Levels for a model that errs: errors of the model in place of noise.
//!
//! On a real robot no structure brings the innovations down to the noise of encoder and drive; what
//! is left is the model's own error, and it is correlated. Weights from sensor noise then say what
//! only fast motion tells, and count every sample of a slow error as news. Here the predictor
//! follows the record slowly: with the bandwidth of a part s of the horizon T that the gap is judged
//! over,
//!
//! ```text
//! ω = 4 / (s T),     σ_τ = I min(ω² σ_q, ω σ_v)
//! σ_q, σ_v = √κ · rms of what is left,     κ = 1 + 2 Σ ρ(k)
//! ```
//!
//! so that its errors are those of free runs over s T (M. Farina, L. Piroddi, Automatica 47(10),
//! 2011: simulation error in place of prediction error). With s = 1 they are those that the gap
//! counts, but motion that sticks and slips makes them rough in the parameters of friction, and
//! fits stop early. N samples count as N/κ independent ones (ρ: their autocorrelation; G. V.
//! Bayley, J. M. Hammersley, J. R. Stat. Soc. Suppl. 8(2), 1946). In the levels κ counts up to 4/(ω
//! h), the memory of the predictor: what is correlated for longer is an effect that is still
//! missing, and must not lose its weight for that.

use pid_data::Role;
use rayon::prelude::*;

use crate::case::{Case, Velocity};
use crate::fit::Fit;

/// Horizon where none is stated, s.
const HORIZON: f64 = 1.0;
/// Part of the horizon over which effects are sought first. 0.1: chosen on practice records with
/// several effects (docs/experiments.md).
pub(crate) const SHORT: f64 = 0.1;
/// All of it.
pub(crate) const WHOLE: f64 = 1.0;
/// Bandwidth times the part of the horizon.
const BANDWIDTH: f64 = 4.0;
/// Memory of the predictor, in times of its bandwidth.
const MEMORY: f64 = 4.0;
/// Largest error that counts, in shares of the motion.
const LARGEST: f64 = 1.0;

/// Errors of the predictor under a fit on the records of a role: `[record][joint][channel]`,
/// position and velocity, SI.
pub(crate) fn errors(case: &Case, fit: &Fit, role: Role) -> Vec<Vec<[Vec<f64>; 2]>> {
    let n = case.n();
    case.records
        .par_iter()
        .zip(&fit.gains)
        .filter(|(r, _)| r.role == role)
        .map(|(record, gains)| {
            let mut out = vec![[Vec::new(), Vec::new()]; n];
            let mut before = vec![0.0; n];
            fit.runner(case, record).predict(
                gains,
                &mut |_, j, channel, x| {
                    let w = &gains[j].whiten;
                    let x = if channel == 0 {
                        before[j] = x / w[0][0];
                        before[j]
                    } else {
                        (x - before[j] * w[1][0]) / w[1][1]
                    };
                    out[j][channel].push(if x.is_finite() { x } else { 1e6 });
                },
                &mut |_, _| {},
            );
            out
        })
        .collect()
}

/// How many samples of a series count as one: 1 + 2 Σ ρ(k) up to the first negative ρ.
pub(crate) fn shared(x: &[f64]) -> f64 {
    let n = x.len();
    let square: f64 = x.iter().map(|x| x * x).sum();
    if n < 4 || square <= 0.0 {
        return 1.0;
    }
    // By the trapezoidal rule from ρ(0) = 1 on, which is that sum. Far lags in steps that grow: the
    // correlation is smooth there.
    let mut sum = 0.0;
    let (mut lag, mut last) = (1_usize, (0_usize, 1.0));
    while lag < n / 2 {
        let product: f64 = x[lag..].iter().zip(x).map(|(a, b)| a * b).sum();
        let rho = product / square * n as f64 / (n - lag) as f64;
        if rho <= 0.0 {
            break;
        }
        sum += (lag - last.0) as f64 * (rho + last.1);
        last = (lag, rho);
        lag += (lag / 8).max(1);
    }
    sum.clamp(1.0, 0.5 * n as f64)
}

/// What is left of one channel of one joint over several records: root mean square, samples,
/// independent samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Left {
    /// Sum of squares.
    pub(crate) square: f64,
    /// Samples.
    pub(crate) number: f64,
    /// Independent ones.
    pub(crate) independent: f64,
}

/// [`Left`] per joint and channel.
pub(crate) fn left(errors: &[Vec<[Vec<f64>; 2]>]) -> Vec<[Left; 2]> {
    let n = errors.first().map_or(0, Vec::len);
    let nothing = Left {
        square: 0.0,
        number: 0.0,
        independent: 0.0,
    };
    let mut out = vec![[nothing; 2]; n];
    for record in errors {
        for (sum, joint) in out.iter_mut().zip(record) {
            for (sum, x) in sum.iter_mut().zip(joint) {
                sum.square += x.iter().map(|x| x * x).sum::<f64>();
                sum.number += x.len() as f64;
                sum.independent += x.len() as f64 / shared(x);
            }
        }
    }
    out
}

/// Sets the bandwidth to that of a part of the horizon, at levels in proportion to the range and
/// speed of the motion.
pub(crate) fn follow_slowly(case: &mut Case, part: f64) {
    case.ahead = part;
    let omega = bandwidth(case);
    for j in 0..case.n() {
        let scale = case.scale[j].clone();
        let noise = &mut case.noise[j];
        noise.q = noise.q.max(0.05 * scale.range);
        noise.v = noise.v.max(omega * noise.q);
        noise.torque = scale.inertia * drive(omega, noise.q, noise.v);
        noise.passed = 0.0;
        noise.stated = false;
    }
}

/// Sets the levels to what a fit leaves, at the same bandwidth. `sensors` are the levels of the
/// sensors, the least there can be.
pub(crate) fn settle(case: &mut Case, fit: &Fit, sensors: &[(f64, f64)]) {
    let omega = bandwidth(case);
    let left = left(&errors(case, fit, Role::Train));
    let step = case
        .records
        .iter()
        .map(|r| r.h)
        .fold(f64::INFINITY, f64::min);
    for j in 0..case.n() {
        let measured = case.velocity[j] == Velocity::Measured;
        let (range, speed) = (case.scale[j].range, case.scale[j].speed);
        let inertia = case.scale[j].inertia;
        let memory = (MEMORY / (omega * step)).max(1.0);
        let level = |l: &Left, least: f64, most: f64| {
            let rms = (l.square / l.number.max(1.0)).sqrt();
            let shared = (l.number / l.independent.max(1.0)).clamp(1.0, memory);
            rms.min(LARGEST * most).max(least) * shared.sqrt()
        };
        case.noise[j].q = level(&left[j][0], sensors[j].0, range);
        if measured {
            case.noise[j].v = level(&left[j][1], sensors[j].1, speed);
        }
        let v = if measured {
            case.noise[j].v
        } else {
            f64::INFINITY
        };
        case.noise[j].torque = inertia * drive(omega, case.noise[j].q, v);
    }
}

/// Acceleration noise with which neither reading is followed faster than the bandwidth.
fn drive(omega: f64, q: f64, v: f64) -> f64 {
    (omega * omega * q).min(omega * v)
}

/// The case with an observer of a bandwidth in rad/s, at most a fifth of what its sample time allows.
pub(crate) fn with_bandwidth(case: &Case, omega: f64) -> Case {
    let mut case = case.clone();
    let h = case.records.iter().map(|r| r.h).fold(0.0, f64::max);
    let omega = omega.min(0.2 / h);
    for j in 0..case.n() {
        let inertia = case.scale[j].inertia;
        let noise = &mut case.noise[j];
        noise.v = noise.v.max(omega * noise.q);
        noise.torque = inertia * omega * omega * noise.q;
        noise.passed = 0.0;
    }
    case
}

fn bandwidth(case: &Case) -> f64 {
    BANDWIDTH / (case.ahead * case.nominal.horizon.unwrap_or(HORIZON).min(HORIZON))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn independent_samples_of_a_first_order_process() {
        // x⁺ = a x + w: ρ(k) = aᵏ, κ = (1 + a)/(1 − a).
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let mut uniform = || random.random_range(-0.5..0.5);
        for a in [0.0, 0.8, 0.95] {
            let mut x = vec![0.0];
            for k in 0..60_000 {
                x.push(a * x[k] + uniform());
            }
            let expected = (1.0 + a) / (1.0 - a);
            let found = shared(&x);
            assert!(
                (found / expected - 1.0).abs() < 0.15,
                "{a}: {found} {expected}"
            );
        }
    }
}
