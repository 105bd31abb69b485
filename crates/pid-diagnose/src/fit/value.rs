//! The objective: sums of squared innovations over the records.

use std::cell::Cell;
use std::ops::ControlFlow;
use std::sync::Mutex;

use pid_data::Role;
use rayon::prelude::*;

use crate::case::{Case, Velocity};
use crate::hypothesis::Hypothesis;
use crate::initial;
use crate::observer::Gain;
use crate::point::Point;
use crate::predict::{Runner, gains, rows};

/// Standard deviation of a deviation, in tolerances.
pub const PRIOR: f64 = 0.55;
/// A parallel run checks every so many samples whether the shared sum already exceeds the bound.
const ASIDE: usize = 64;
/// An innovation larger than this many deviations counts as this: a diverging candidate must not
/// give infinities.
pub(super) const LARGEST: f64 = 1e4;

/// Value of the objective, in its parts.
#[derive(Debug, Clone, PartialEq)]
pub struct Value {
    /// Sum of squared innovations per joint and channel.
    pub chi: Vec<[f64; 2]>,
    /// Number of innovations per joint and channel.
    pub count: Vec<[f64; 2]>,
    /// Sum of (θ/σ)².
    pub prior: f64,
    /// Sum of ln det S over the innovations' predicted covariances S, per joint: gains of their own
    /// make hypotheses comparable only together with it.
    pub log_det: Vec<f64>,
}

impl Value {
    /// Sum of squared innovations.
    pub fn total(&self) -> f64 {
        self.chi.iter().map(|c| c[0] + c[1]).sum()
    }
    /// Number of innovations.
    pub fn number(&self) -> f64 {
        self.count.iter().map(|c| c[0] + c[1]).sum()
    }
    /// Sum of ln det S over all joints.
    pub fn spread(&self) -> f64 {
        self.log_det.iter().sum()
    }
    /// Sum of squares and prior.
    pub fn objective(&self) -> f64 {
        self.total() + self.prior
    }
    /// Minus twice the log-likelihood, up to a constant of the records: sum of squares and ln det S.
    pub fn surprise(&self) -> f64 {
        self.total() + self.spread()
    }
    /// Minus twice the logarithm of the posterior density, up to a constant of the records.
    pub fn evidence(&self) -> f64 {
        self.objective() + self.spread()
    }
}

/// Gains for every record.
pub fn all_gains(case: &Case, hypothesis: &Hypothesis, at: &Point) -> Vec<Vec<Gain>> {
    let from_rest = vec![Vec::new(); case.records.len()];
    gains_from(case, hypothesis, at, &from_rest, |_| true)
}

/// The same, with the states that no sensor reads looked for in the records of the roles that are `asked` for, from
/// where they were `before`.
pub(super) fn gains_from(
    case: &Case,
    hypothesis: &Hypothesis,
    at: &Point,
    before: &[Vec<Gain>],
    asked: impl Fn(Role) -> bool + Sync,
) -> Vec<Vec<Gain>> {
    let whole = case.run(hypothesis).initial_states;
    let open = whole || initial::starts_open(case);
    let (theta, e) = (&at.theta[..], &at.e[..]);
    (case.records.par_iter().zip(before))
        .map(|(record, before)| {
            let mut own = gains((case, record), hypothesis, theta, e);
            for (own, before) in own.iter_mut().zip(before) {
                own.hidden = before.hidden;
            }
            if open && asked(record.role) {
                initial::settle((case, record), hypothesis, (theta, e), &mut own, whole);
            }
            own
        })
        .collect()
}

/// An innovation within what counts.
pub(super) fn tame(x: f64) -> f64 {
    if x.is_finite() {
        x.clamp(-LARGEST, LARGEST)
    } else {
        LARGEST
    }
}

/// Sums of squares on the records of a role; gains are designed at the point itself.
pub fn value(
    case: &Case,
    hypothesis: &Hypothesis,
    at: &Point,
    gains: &[Vec<Gain>],
    role: Role,
) -> Value {
    run(case, hypothesis, at, gains, role, f64::INFINITY)
}

/// The same of innovations on the train records, as [`linearise`](super::linearise) has them.
pub(super) fn value_of(case: &Case, at: &Point, gains: &[Vec<Gain>], innovations: &[f64]) -> Value {
    let n = case.n();
    let measured = |j: usize| case.velocity[j] == Velocity::Measured;
    let channels: Vec<(usize, usize)> = (0..n)
        .flat_map(|j| (0..1 + usize::from(measured(j))).map(move |c| (j, c)))
        .collect();
    let mut total = Value {
        chi: vec![[0.0; 2]; n],
        count: vec![[0.0; 2]; n],
        prior: prior(at),
        log_det: log_dets(case, gains, Role::Train),
    };
    let mut rest = innovations;
    for record in case.records.iter().filter(|r| r.role == Role::Train) {
        let (own, others) = rest.split_at(rows(record) * channels.len());
        rest = others;
        let mut chi = vec![[0.0; 2]; n];
        for sample in own.chunks_exact(channels.len()) {
            for (&(j, c), x) in channels.iter().zip(sample) {
                chi[j][c] += x * x;
                total.count[j][c] += 1.0;
            }
        }
        for (sum, own) in total.chi.iter_mut().zip(&chi) {
            (sum[0], sum[1]) = (sum[0] + own[0], sum[1] + own[1]);
        }
    }
    total
}

/// [`value`] on the train records if its [`Value::objective`] is below a bound, else `None`: most
/// points above it are known to be after a part of the records.
pub fn value_below(
    bound: f64,
    case: &Case,
    hypothesis: &Hypothesis,
    at: &Point,
    gains: &[Vec<Gain>],
) -> Option<Value> {
    let there = run(case, hypothesis, at, gains, Role::Train, bound);
    (there.objective() < bound).then_some(there)
}

/// Sum of (θ/σ)².
fn prior(at: &Point) -> f64 {
    at.theta.iter().map(|t| (t / PRIOR).powi(2)).sum()
}

/// Sums of ln det S on the records of a role, per joint.
pub fn log_dets(case: &Case, gains: &[Vec<Gain>], role: Role) -> Vec<f64> {
    let mut out = vec![0.0; case.n()];
    for (record, g) in case.records.iter().zip(gains) {
        if record.role == role {
            let rows = rows(record) as f64;
            for (j, g) in g.iter().enumerate() {
                out[j] -= 2.0 * rows * g.whiten[0][0].ln();
                if case.velocity[j] == Velocity::Measured {
                    out[j] -= 2.0 * rows * g.whiten[1][1].ln();
                }
            }
        }
    }
    out
}

/// The sums; broken off as soon as they exceed a bound on the objective by more than they round.
fn run(
    case: &Case,
    hypothesis: &Hypothesis,
    at: &Point,
    gains: &[Vec<Gain>],
    role: Role,
    bound: f64,
) -> Value {
    let n = case.n();
    let prior = prior(at);
    let most = bound * (1.0 + 1e-9) - prior;
    // What the records at their end have summed up to.
    let summed = Mutex::new(0.0_f64);
    let summed_up = || summed.lock().map_or(0.0, |s| *s);
    type Channels = (Vec<[f64; 2]>, Vec<[f64; 2]>);
    let parts: Vec<Channels> = case
        .records
        .par_iter()
        .zip(gains)
        .filter(|(r, _)| r.role == role)
        .map(|(record, g)| {
            let mut chi = vec![[0.0; 2]; n];
            let mut count = vec![[0.0; 2]; n];
            let own = Cell::new(0.0);
            let mut others = summed_up();
            let mut runner = Runner::<f64>::new(case, record, hypothesis, &at.theta, &at.e);
            runner.predict_while(
                runner.counted(),
                g,
                &mut |_, j, c, x| {
                    let x = tame(x);
                    chi[j][c] += x * x;
                    count[j][c] += 1.0;
                    own.set(own.get() + x * x);
                },
                &mut |k, _| {
                    if k % ASIDE == 0 {
                        others = summed_up();
                    }
                    if others + own.get() > most {
                        ControlFlow::Break(())
                    } else {
                        ControlFlow::Continue(())
                    }
                },
            );
            if let Ok(mut s) = summed.lock() {
                *s += own.get();
            }
            (chi, count)
        })
        .collect();
    let mut total = Value {
        chi: vec![[0.0; 2]; n],
        count: vec![[0.0; 2]; n],
        prior,
        log_det: log_dets(case, gains, role),
    };
    for (chi, count) in parts {
        for j in 0..n {
            for c in 0..2 {
                total.chi[j][c] += chi[j][c];
                total.count[j][c] += count[j][c];
            }
        }
    }
    total
}
