//! Solves the rows of a step for its unknowns, as an integrator does.

use super::super::butcher::Butcher;
use super::super::step::{Interval, Rule, Scratch};
use super::lu;
use super::stepping::Adaptive;
use crate::integrate::ForwardDynamics;

/// After a relative Newton correction of this size the next one is below rounding.
const SETTLED: f64 = 1e-9;
/// Newton corrections of a step.
const CORRECTIONS: usize = 25;
/// A state beyond this counts as diverged.
const BLOW_UP: f64 = 1e8;
/// Steps of an adaptive integration in one sampling interval.
const MOST_STEPS: usize = 5000;

/// Differences between the weights of order 5 and 4 of Dormand and Prince.
const ERROR: [f64; 7] = [
    71.0 / 57600.0,
    0.0,
    -71.0 / 16695.0,
    71.0 / 1920.0,
    -17253.0 / 339200.0,
    22.0 / 525.0,
    -1.0 / 40.0,
];

/// Memory of one thread for taking steps and differentiating them.
pub(super) struct Stepper<'m> {
    forward: ForwardDynamics<'m>,
    butcher: Butcher,
    squared: Vec<f64>,
    weighted: Vec<f64>,
    explicit: bool,
    nq: usize,
    /// Accelerations and velocities of the stages.
    k: Vec<f64>,
    stage_v: Vec<f64>,
    q: Vec<f64>,
    v: Vec<f64>,
    u: Vec<f64>,
    c: Vec<f64>,
    guess: Vec<f64>,
    matrix: Vec<f64>,
    pivots: Vec<usize>,
    pub(super) scratch: Scratch,
    pub(super) jacobian: Vec<f64>,
    pub(super) hessian: Vec<f64>,
}

impl<'m> Stepper<'m> {
    pub(super) fn new(rule: &Rule<'m>) -> Self {
        let dims = rule.model().dims();
        let (nq, ny) = (dims.nq, rule.ny());
        let butcher = rule.butcher().clone();
        let stages = butcher.stages();
        Self {
            forward: ForwardDynamics::new(rule.model()),
            squared: butcher.squared(),
            weighted: butcher.weighted(),
            explicit: butcher.explicit(),
            butcher,
            nq,
            k: vec![0.0; (stages + 1) * nq],
            stage_v: vec![0.0; (stages + 1) * nq],
            q: vec![0.0; nq],
            v: vec![0.0; nq],
            u: vec![0.0; dims.nu],
            c: vec![0.0; ny],
            guess: vec![0.0; ny],
            matrix: vec![0.0; ny * ny],
            pivots: vec![0; ny],
            scratch: rule.scratch(),
            jacobian: vec![0.0; rule.expansion().step_jacobian.len()],
            hessian: vec![0.0; rule.expansion().step_hessian.len()],
        }
    }

    /// y with c(x, y, p) = 0; `false` if the step cannot be taken.
    pub(super) fn advance(
        &mut self,
        rule: &Rule<'m>,
        x: &[f64],
        p: &[f64],
        interval: &Interval<'_>,
        y: &mut [f64],
    ) -> bool {
        let done = if self.explicit {
            self.explicit(rule, x, p, interval, y)
        } else {
            self.implicit(rule, x, p, interval, y)
        };
        done && y.iter().all(|y| y.is_finite())
            && y[y.len() - x.len()..].iter().all(|y| y.abs() < BLOW_UP)
    }

    /// Stage by stage.
    fn explicit(
        &mut self,
        rule: &Rule<'m>,
        x: &[f64],
        p: &[f64],
        interval: &Interval<'_>,
        y: &mut [f64],
    ) -> bool {
        let (nq, h, s) = (self.nq, interval.h, self.butcher.stages());
        let (q0, v0) = x.split_at(nq);
        for i in 0..s {
            for j in 0..nq {
                let (mut q, mut v) = (q0[j] + self.butcher.c[i] * h * v0[j], v0[j]);
                for l in 0..i {
                    let k = self.k[l * nq + j];
                    q += h * h * self.squared[i * s + l] * k;
                    v += h * self.butcher.a[i * s + l] * k;
                }
                self.q[j] = q;
                self.v[j] = v;
                self.stage_v[i * nq + j] = v;
            }
            rule.inputs(interval, self.butcher.c[i], &mut self.u);
            let a = &mut self.k[i * nq..(i + 1) * nq];
            if self
                .forward
                .acceleration(&self.q, &self.v, &self.u, p, a)
                .is_none()
            {
                return false;
            }
        }
        let stages = (s - 1) * nq;
        y[..stages].copy_from_slice(&self.k[..stages]);
        for j in 0..nq {
            let (mut q, mut v) = (q0[j] + h * v0[j], v0[j]);
            for l in 0..s {
                let k = self.k[l * nq + j];
                q += h * h * self.weighted[l] * k;
                v += h * self.butcher.b[l] * k;
            }
            y[stages + j] = q;
            y[stages + nq + j] = v;
        }
        true
    }

    /// Newton's method with exact derivatives, from constant acceleration, then from none.
    fn implicit(
        &mut self,
        rule: &Rule<'m>,
        x: &[f64],
        p: &[f64],
        interval: &Interval<'_>,
        y: &mut [f64],
    ) -> bool {
        let (nq, h) = (self.nq, interval.h);
        let (q0, v0) = x.split_at(nq);
        let stages = y.len() - 2 * nq;
        rule.inputs(interval, 0.0, &mut self.u);
        let known = self
            .forward
            .acceleration(q0, v0, &self.u, p, &mut self.v)
            .is_some();
        for attempt in 0..2 {
            if attempt == 0 && !known {
                continue;
            }
            for j in 0..nq {
                let a = if attempt == 0 { self.v[j] } else { 0.0 };
                (0..stages / nq).for_each(|i| y[i * nq + j] = a);
                y[stages + j] = q0[j] + h * v0[j] + 0.5 * h * h * a;
                y[stages + nq + j] = v0[j] + h * a;
            }
            if self.newton(rule, x, p, interval, y) {
                return true;
            }
        }
        false
    }

    fn newton(
        &mut self,
        rule: &Rule<'m>,
        x: &[f64],
        p: &[f64],
        interval: &Interval<'_>,
        y: &mut [f64],
    ) -> bool {
        let ny = y.len();
        let mut last = f64::INFINITY;
        for iteration in 0..CORRECTIONS {
            rule.constraints(x, y, p, interval, &mut self.scratch, &mut self.c);
            rule.jacobian(x, y, p, interval, &mut self.scratch, &mut self.jacobian);
            unknowns_matrix(rule, x.len(), &self.jacobian, &mut self.matrix);
            if !lu::factor(&mut self.matrix, ny, &mut self.pivots) {
                return false;
            }
            self.guess.copy_from_slice(&self.c);
            lu::solve(&self.matrix, ny, &self.pivots, &mut self.guess, 1);
            let mut size = 0.0_f64;
            for (y, d) in y.iter_mut().zip(&self.guess) {
                *y -= d;
                size = size.max(d.abs() / (1.0 + y.abs()));
            }
            if !size.is_finite() || iteration > 8 && size > 2.0 * last {
                return false;
            }
            if size < SETTLED {
                return true;
            }
            last = size;
        }
        false
    }

    /// Lengths of adaptive Dormand-Prince steps over one sampling interval from `x`, which is moved
    /// to its end; `false` if it cannot be crossed. `h` is the length proposed, and then that for
    /// the next interval.
    #[allow(
        clippy::too_many_arguments,
        reason = "a point, its interval, and where results go"
    )]
    pub(super) fn adapt(
        &mut self,
        rule: &Rule<'m>,
        x: &mut [f64],
        p: &[f64],
        interval: &Interval<'_>,
        tolerances: Adaptive,
        h: &mut f64,
        mut accept: impl FnMut(&[f64], &Interval<'_>),
    ) -> bool {
        let (nq, whole) = (self.nq, interval.h);
        let mut y = vec![0.0; rule.ny()];
        let mut from = 0.0_f64;
        for _ in 0..MOST_STEPS {
            let left = whole * (1.0 - from);
            let end = *h >= left * (1.0 - 1e-9);
            let length = if end { left } else { h.min(0.5 * left) };
            let step = Interval {
                h: length,
                from,
                share: if end { 1.0 - from } else { length / whole },
                ..*interval
            };
            let size = if self.advance(rule, x, p, &step, &mut y) {
                self.error(rule, x, p, &step, &y, tolerances)
            } else {
                f64::INFINITY
            };
            if size <= 1.0 {
                accept(&y, &step);
                x.copy_from_slice(&y[y.len() - 2 * nq..]);
                from += step.share;
            }
            let factor = if size.is_finite() {
                (0.9 * size.max(1e-10).powf(-0.2)).clamp(0.2, 5.0)
            } else {
                0.1
            };
            if size > 1.0 || !end || factor < 1.0 {
                *h = length * factor;
            } else {
                *h = h.max(length * factor);
            }
            if size <= 1.0 && end {
                return true;
            }
            if *h < 1e-12 * whole.max(1e-12) {
                return false;
            }
        }
        false
    }

    /// Error estimate of the explicit step just taken, over its tolerances.
    fn error(
        &mut self,
        rule: &Rule<'m>,
        x: &[f64],
        p: &[f64],
        step: &Interval<'_>,
        y: &[f64],
        tolerances: Adaptive,
    ) -> f64 {
        let nq = self.nq;
        let (q1, v1) = y[y.len() - 2 * nq..].split_at(nq);
        rule.inputs(step, 1.0, &mut self.u);
        let last = self.butcher.stages() * nq;
        self.stage_v[last..].copy_from_slice(v1);
        let a = &mut self.k[last..];
        if self.forward.acceleration(q1, v1, &self.u, p, a).is_none() {
            return f64::INFINITY;
        }
        let mut sum = 0.0;
        for j in 0..nq {
            let estimate = |slopes: &[f64]| -> f64 {
                let terms = ERROR.iter().enumerate();
                step.h * terms.map(|(i, e)| e * slopes[i * nq + j]).sum::<f64>()
            };
            for (e, a, b) in [
                (estimate(&self.stage_v), x[j], q1[j]),
                (estimate(&self.k), x[nq + j], v1[j]),
            ] {
                let scale = tolerances.atol + tolerances.rtol * a.abs().max(b.abs());
                sum += (e / scale) * (e / scale);
            }
        }
        (sum / (2 * nq) as f64).sqrt()
    }
}

/// ∂c/∂y, dense, from the values of a step's Jacobian.
pub(super) fn unknowns_matrix(rule: &Rule<'_>, nx: usize, jacobian: &[f64], out: &mut [f64]) {
    let ny = rule.ny();
    out.fill(0.0);
    for (&(row, col), value) in rule.expansion().step_jacobian.iter().zip(jacobian) {
        let (row, col) = (row as usize, col as usize);
        if (nx..nx + ny).contains(&col) {
            out[row * ny + col - nx] += value;
        }
    }
}
