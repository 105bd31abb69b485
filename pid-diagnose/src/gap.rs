//! The gap: free-run error on records that were never fitted.
//!
//! Each record is cut into windows of the stated horizon; from the read state at the start of a window the model runs freely
//! under the recorded inputs. Per joint the root mean square error of position and of velocity (as the drive would report it) is
//! divided by the standard deviation of the read channel in that record; the gap is the root mean square over joints, channels
//! and records.

use pid_runtime::data::Role;

use crate::case::{Case, Velocity};
use crate::predict::{Runner, gains};
use crate::simulate::{Hypothesis, State};

/// An error beyond this, relative to the motion, counts as this.
const LARGEST: f64 = 9.9;

/// The gap of one model.
#[derive(Debug, Clone, PartialEq)]
pub struct Gap {
    /// Over everything.
    pub total: f64,
    /// Per joint and channel (position, velocity), root mean square over records; `None` where a velocity is not recorded.
    pub joints: Vec<(f64, Option<f64>)>,
    /// Squared normalised error of each window, all joints and channels: what an interval is drawn from.
    pub windows: Vec<f64>,
}

/// Free-run error of a hypothesis at its parameters on the records of a role.
pub fn gap(case: &Case, hypothesis: &Hypothesis, theta: &[f64], e: &[f64], role: Role) -> Gap {
    let n = case.n();
    let mut sums = vec![(0.0, 0.0); n];
    let mut records = 0.0;
    let mut windows = Vec::new();
    for record in case.records.iter().filter(|r| r.role == role) {
        records += 1.0;
        let h = record.h;
        let last = record.len() - 1;
        let length = case
            .nominal
            .horizon
            .map_or(last, |s| ((s / h).round() as usize).clamp(1, last));
        let count = last / length;
        let mut starts: Vec<State<f64>> = Vec::with_capacity(count);
        let g = gains(case, hypothesis, theta, e, h);
        let mut runner = Runner::<f64>::new(case, record, hypothesis, theta, e);
        runner.predict(&g, &mut |_, _, _, _| {}, &mut |k, state| {
            if k % length == 0 && starts.len() < count {
                starts.push(state.clone());
            }
        });
        let deviation: Vec<(f64, f64)> = (0..n)
            .map(|j| (deviation(&record.q[j]), deviation(&record.v[j])))
            .collect();
        let fade: Vec<f64> = (0..n)
            .map(|j| {
                case.nominal
                    .velocity_filter_hz
                    .map_or(0.0, |hz| (-2.0 * std::f64::consts::PI * hz * h).exp())
                    * f64::from(u8::from(case.velocity[j] == Velocity::Derived))
            })
            .collect();
        let lag: Vec<f64> = (0..n)
            .map(|j| runner.velocity_fade(j).unwrap_or(0.0))
            .collect();
        let mut square = vec![(0.0, 0.0, 0.0, 0.0); n];
        for (w, start) in starts.iter().enumerate() {
            let k = w * length;
            let mut previous: Vec<f64> = (0..n).map(|j| record.q[j][k]).collect();
            let mut filtered: Vec<f64> = (0..n).map(|j| record.v[j][k]).collect();
            let mut shown = filtered.clone();
            let mut own = 0.0;
            runner.free(start, k, length, &mut |i, j, q, v| {
                let (mq, mv) = (record.q[j][k + i], record.v[j][k + i]);
                let mut read = v;
                if case.velocity[j] == Velocity::Derived {
                    filtered[j] = fade[j] * filtered[j] + (1.0 - fade[j]) * (q - previous[j]) / h;
                    previous[j] = q;
                    read = filtered[j];
                }
                shown[j] = lag[j] * shown[j] + (1.0 - lag[j]) * read;
                let eq = clip((q - mq) / deviation[j].0);
                if eq.is_finite() {
                    square[j].0 += eq * eq;
                    square[j].1 += 1.0;
                    own += eq * eq;
                }
                let ev = clip((shown[j] - mv) / deviation[j].1);
                if mv.is_finite() {
                    square[j].2 += ev * ev;
                    square[j].3 += 1.0;
                    own += ev * ev;
                }
            });
            windows.push(own / (2 * n * length) as f64);
        }
        for j in 0..n {
            let s = square[j];
            sums[j].0 += if s.1 > 0.0 {
                (s.0 / s.1).min(LARGEST * LARGEST)
            } else {
                0.0
            };
            sums[j].1 += if s.3 > 0.0 {
                (s.2 / s.3).min(LARGEST * LARGEST)
            } else {
                0.0
            };
        }
    }
    let absent = |j: usize| case.velocity[j] == Velocity::Absent;
    let joints: Vec<(f64, Option<f64>)> = (0..n)
        .map(|j| {
            (
                (sums[j].0 / records).sqrt(),
                (!absent(j)).then(|| (sums[j].1 / records).sqrt()),
            )
        })
        .collect();
    let all: Vec<f64> = joints
        .iter()
        .flat_map(|(q, v)| std::iter::once(*q).chain(*v))
        .collect();
    let total = (all.iter().map(|x| x * x).sum::<f64>() / all.len() as f64).sqrt();
    Gap {
        total,
        joints,
        windows,
    }
}

fn clip(x: f64) -> f64 {
    if x.is_nan() { x } else { x.clamp(-1e3, 1e3) }
}

fn deviation(x: &[f64]) -> f64 {
    let known: Vec<f64> = x.iter().copied().filter(|x| x.is_finite()).collect();
    if known.is_empty() {
        return 1.0;
    }
    let mean = known.iter().sum::<f64>() / known.len() as f64;
    (known.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / known.len() as f64)
        .sqrt()
        .max(1e-12)
}

/// The gap that noise alone leaves: the fitted model against itself with the drive noise and the reading noise of the case drawn
/// anew (fixed seed), on the same windows and inputs.
pub fn floor(case: &Case, hypothesis: &Hypothesis, theta: &[f64], e: &[f64], role: Role) -> f64 {
    let mut random = Normal::new(0x5eed);
    let n = case.n();
    let mut twin = case.clone();
    for (record, copy) in case.records.iter().zip(&mut twin.records) {
        if record.role != role {
            continue;
        }
        let last = record.len() - 1;
        let length = case
            .nominal
            .horizon
            .map_or(last, |s| ((s / record.h).round() as usize).clamp(1, last));
        let count = last / length;
        let g = gains(case, hypothesis, theta, e, record.h);
        let mut starts = Vec::with_capacity(count);
        let mut noisy = record.clone();
        for j in 0..n {
            let scale = case.noise[j].torque / case.nominal.joints[j].motor_gain.abs();
            for u in &mut noisy.u[j] {
                *u += scale * random.next();
            }
        }
        Runner::<f64>::new(case, record, hypothesis, theta, e).predict(
            &g,
            &mut |_, _, _, _| {},
            &mut |k, state| {
                if k % length == 0 && starts.len() < count {
                    starts.push(state.clone());
                }
            },
        );
        let mut runner = Runner::<f64>::new(case, &noisy, hypothesis, theta, e);
        let fade = case.nominal.velocity_filter_hz.map_or(0.0, |hz| {
            (-2.0 * std::f64::consts::PI * hz * record.h).exp()
        });
        let lag: Vec<f64> = (0..n)
            .map(|j| runner.velocity_fade(j).unwrap_or(0.0))
            .collect();
        for (w, start) in starts.iter().enumerate() {
            let k = w * length;
            let mut filtered: Vec<f64> = (0..n).map(|j| record.v[j][k]).collect();
            let mut shown = filtered.clone();
            let mut previous: Vec<f64> = (0..n).map(|j| record.q[j][k]).collect();
            runner.free(start, k, length, &mut |i, j, q, v| {
                let q = q + case.noise[j].q * random.next();
                copy.q[j][k + i] = q;
                let read = match case.velocity[j] {
                    Velocity::Derived => {
                        filtered[j] =
                            fade * filtered[j] + (1.0 - fade) * (q - previous[j]) / record.h;
                        previous[j] = q;
                        filtered[j]
                    }
                    _ => v,
                };
                shown[j] = lag[j] * shown[j] + (1.0 - lag[j]) * read;
                let noise = if case.velocity[j] == Velocity::Measured {
                    case.noise[j].v * random.next()
                } else {
                    0.0
                };
                copy.v[j][k + i] = shown[j] + noise;
            });
        }
    }
    gap(&twin, hypothesis, theta, e, role).total
}

/// Normal numbers by Box and Muller on splitmix64, for the figures that need a repeatable draw.
struct Normal(u64);

impl Normal {
    fn new(seed: u64) -> Self {
        Normal(seed)
    }
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
    fn next(&mut self) -> f64 {
        let (a, b) = (1.0 - self.uniform(), self.uniform());
        (-2.0 * a.ln()).sqrt() * (2.0 * std::f64::consts::PI * b).cos()
    }
}
