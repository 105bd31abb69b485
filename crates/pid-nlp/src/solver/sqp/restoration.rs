//! Back to points that the filter accepts.

use std::ops::ControlFlow;
use std::time::Instant;

use super::Solver;
use super::quadratic::{Nearest, Shifted};
use crate::solver::ip;
use crate::solver::outcome::{Iteration, Status};
use crate::solver::settings::Settings;

/// Weight of the distance in a restoration.
const ZETA: f64 = 1e-3;
/// A restoration must reduce the violation by this share.
const RESTORED: f64 = 0.9;

impl Solver<'_> {
    /// Goes to a point near this one that the filter accepts with less violation.
    pub(super) fn restore(&mut self) -> Result<Iteration, Status> {
        let theta = self.theta(&self.model.c);
        if theta <= 1e-2 * self.settings.tol {
            return Err(Status::NoProgress);
        }
        self.counts.restorations += 1;
        self.filter.add(theta, self.model.f);
        let settings = Settings {
            tol: self.settings.tol,
            max_iterations: self.settings.max_restoration,
            max_time: self.time_left(),
            interrupt: self.settings.interrupt.clone(),
            max_gradient: f64::INFINITY,
            mu_start: 1e-2,
            ..Settings::default()
        };
        let from = self.model.x.clone();
        let mut near = Nearest {
            problem: &mut *self.problem,
            from: from.clone(),
            zeta: ZETA,
        };
        let mut system = Shifted {
            inner: &mut *self.kkt,
            shift: ZETA,
            sigma: Vec::new(),
        };
        let begun = Instant::now();
        let enough = 1e-2 * theta / self.c_lower.len().max(1) as f64;
        let mut news = |line: &Iteration, _: &[f64]| {
            if line.iteration > 0 && line.primal_inf <= enough {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        };
        let found = ip::solve(&mut near, &mut system, &from, &settings, &mut news);
        self.counts.add(&found.counts);
        self.seconds.linear += begun.elapsed().as_secs_f64();
        if let Some(status) = self.stop_requested() {
            return Err(status);
        }
        let (f, c) = self.evaluate(&found.x);
        let reached = self.theta(&c);
        if !f.is_finite() || reached.is_nan() || reached > RESTORED * theta {
            return Err(if found.status == Status::LocallyInfeasible {
                Status::LocallyInfeasible
            } else {
                Status::RestorationFailed
            });
        }
        let distance = found.x.iter().zip(&from).map(|(a, b)| (a - b).abs());
        let step = distance.fold(0.0, f64::max);
        (self.model.x, self.model.f, self.model.c) = (found.x, f, c);
        self.lambda.fill(0.0);
        self.z.iter_mut().for_each(|z| z.fill(0.0));
        if !self.derivatives() {
            return Err(Status::InvalidNumber);
        }
        Ok(Iteration {
            step,
            alpha: 1.0,
            trials: 1,
            kind: 'R',
            ..Iteration::blank(0.0)
        })
    }
}
