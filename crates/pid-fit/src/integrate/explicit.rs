//! Explicit Runge-Kutta steps: the classical one and the Dormand-Prince pair.

use super::forward::ForwardDynamics;
use super::{Fault, Interval, Settings, scaled_norm};

/// Nodes of the Dormand-Prince pair.
const C: [f64; 7] = [0.0, 1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0];
/// Its stages; the last row is the solution of order 5.
pub(crate) const A: [&[f64]; 7] = [
    &[],
    &[1.0 / 5.0],
    &[3.0 / 40.0, 9.0 / 40.0],
    &[44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0],
    &[
        19372.0 / 6561.0,
        -25360.0 / 2187.0,
        64448.0 / 6561.0,
        -212.0 / 729.0,
    ],
    &[
        9017.0 / 3168.0,
        -355.0 / 33.0,
        46732.0 / 5247.0,
        49.0 / 176.0,
        -5103.0 / 18656.0,
    ],
    &[
        35.0 / 384.0,
        0.0,
        500.0 / 1113.0,
        125.0 / 192.0,
        -2187.0 / 6784.0,
        11.0 / 84.0,
    ],
];
/// Difference of the weights of order 5 and 4.
const E: [f64; 7] = [
    71.0 / 57600.0,
    0.0,
    -71.0 / 16695.0,
    71.0 / 1920.0,
    -17253.0 / 339200.0,
    22.0 / 525.0,
    -1.0 / 40.0,
];

/// Memory of the explicit methods. States are x = (q, v).
pub(super) struct Explicit {
    /// Slopes at the stages.
    k: [Vec<f64>; 7],
    /// The current stage.
    stage: Vec<f64>,
    /// The sixth stage, for the test of stiffness.
    sixth: Vec<f64>,
    error: Vec<f64>,
    u: Vec<f64>,
    /// The solution of the last step.
    pub(super) x1: Vec<f64>,
    /// Whether `k[0]` is the slope at the current point.
    pub(super) first_known: bool,
}

/// Outcome of one trial step of the pair.
pub(super) struct Trial {
    /// Scaled error; the step is good if it is at most 1.
    pub(super) error: f64,
    /// Estimate of |h λ| for the largest eigenvalue λ: above 3.25 stability limits the step
    /// (E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section IV.2).
    pub(super) h_lambda: f64,
}

impl Explicit {
    pub(super) fn new(nq: usize, nu: usize) -> Self {
        let zero = || vec![0.0; 2 * nq];
        Explicit {
            k: std::array::from_fn(|_| zero()),
            stage: zero(),
            sixth: zero(),
            error: zero(),
            u: vec![0.0; nu],
            x1: zero(),
            first_known: false,
        }
    }

    /// One step of the pair from (t, x); the solution is in `x1`.
    pub(super) fn dormand_prince(
        &mut self,
        forward: &mut ForwardDynamics<'_>,
        interval: &Interval<'_>,
        p: &[f64],
        (t, x, h): (f64, &[f64], f64),
        settings: &Settings,
    ) -> Result<Trial, Fault> {
        for s in 0..7 {
            if s == 0 && self.first_known {
                continue;
            }
            self.stage.copy_from_slice(x);
            for (a, k) in A[s].iter().zip(&self.k) {
                for (y, k) in self.stage.iter_mut().zip(k) {
                    *y += h * a * k;
                }
            }
            if s == 5 {
                self.sixth.copy_from_slice(&self.stage);
            }
            interval.input(t + C[s] * h, &mut self.u);
            slope(forward, &self.stage, &self.u, p, &mut self.k[s])?;
            self.first_known = true;
        }
        self.x1.copy_from_slice(&self.stage);
        self.error.fill(0.0);
        for (e, k) in E.iter().zip(&self.k) {
            for (y, k) in self.error.iter_mut().zip(k) {
                *y += h * e * k;
            }
        }
        let distance = |a: &[f64], b: &[f64]| -> f64 {
            a.iter()
                .zip(b)
                .map(|(a, b)| (a - b).powi(2))
                .sum::<f64>()
                .sqrt()
        };
        let apart = distance(&self.x1, &self.sixth);
        let slopes = distance(&self.k[6], &self.k[5]);
        Ok(Trial {
            error: scaled_norm(&self.error, x, &self.x1, settings),
            h_lambda: if apart > 0.0 { h * slopes / apart } else { 0.0 },
        })
    }

    /// Accepts the last step of the pair: its last slope is the first of the next step.
    pub(super) fn accept(&mut self) {
        self.k.swap(0, 6);
    }

    /// One step of the classical method of order 4; the solution is in `x1`.
    pub(super) fn rk4(
        &mut self,
        forward: &mut ForwardDynamics<'_>,
        interval: &Interval<'_>,
        p: &[f64],
        (t, x, h): (f64, &[f64], f64),
    ) -> Result<(), Fault> {
        for (s, c) in [0.0, 0.5, 0.5, 1.0].into_iter().enumerate() {
            self.stage.copy_from_slice(x);
            if s > 0 {
                for (y, k) in self.stage.iter_mut().zip(&self.k[s - 1]) {
                    *y += c * h * k;
                }
            }
            interval.input(t + c * h, &mut self.u);
            slope(forward, &self.stage, &self.u, p, &mut self.k[s])?;
        }
        for (i, y) in self.x1.iter_mut().enumerate() {
            let k = |s: usize| self.k[s][i];
            *y = x[i] + h / 6.0 * (k(0) + 2.0 * (k(1) + k(2)) + k(3));
        }
        Ok(())
    }
}

/// x' = (v, a).
fn slope(
    forward: &mut ForwardDynamics<'_>,
    x: &[f64],
    u: &[f64],
    p: &[f64],
    out: &mut [f64],
) -> Result<(), Fault> {
    let (q, v) = x.split_at(x.len() / 2);
    let (dq, dv) = out.split_at_mut(v.len());
    dq.copy_from_slice(v);
    forward.evaluate(q, v, u, p, dv)
}
