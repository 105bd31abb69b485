//! Steps, their sizes, and the choice between explicit and implicit.

#[cfg(test)]
mod tests;

use super::explicit::Explicit;
use super::forward::ForwardDynamics;
use super::implicit::Implicit;
use super::{Drive, Fault, Interval, Method, Settings, SimulateError, Stats};
use pid_runtime::dynamics::{Dynamics, Jacobian};

/// Motion counts as stiff after this many steps in a row with |h λ| > 3.25, and as not stiff after
/// this many without (E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section
/// IV.2).
const STIFF: usize = 15;
const NOT_STIFF: usize = 6;
/// After this many explicit steps within one sampling interval the implicit method is tried.
const MANY: usize = 60;
/// After this many sampling intervals the explicit method is tried again.
const RETRY: usize = 25;

/// Simulates one model again and again without allocating.
pub struct Simulator<'m> {
    forward: ForwardDynamics<'m>,
    settings: Settings,
    explicit: Explicit,
    implicit: Option<Implicit<'m>>,
    /// The state x = (q, v).
    x: Vec<f64>,
    run: Run,
}

/// Memory from step to step.
#[derive(Default)]
struct Run {
    stats: Stats,
    /// Step to try next, s; 0 before the first.
    h: f64,
    implicit: bool,
    /// Intervals since the implicit method took over.
    since: usize,
    stiff: usize,
    not_stiff: usize,
}

/// By what the length of a step is multiplied after an error, which is 1 where it is just tolerated.
fn step_factor(error: f64, order: f64) -> f64 {
    if error.is_finite() {
        (0.9 * error.max(1e-10).powf(-1.0 / order)).clamp(0.2, 6.0)
    } else {
        0.25
    }
}

impl<'m> Simulator<'m> {
    /// For a model without derivatives: [`Method::Auto`] stays explicit.
    pub fn new(model: &'m dyn Dynamics, settings: Settings) -> Self {
        let dims = model.dims();
        Simulator {
            forward: ForwardDynamics::new(model),
            settings,
            explicit: Explicit::new(dims.nq, dims.nu),
            implicit: None,
            x: vec![0.0; 2 * dims.nq],
            run: Run::default(),
        }
    }

    /// For a model with derivatives.
    pub fn with_derivatives(model: &'m dyn Jacobian, settings: Settings) -> Self {
        let mut simulator = Simulator::new(model, settings);
        simulator.implicit = Some(Implicit::new(model));
        simulator
    }

    /// Simulates from (q0, v0) at the first sample and writes the state at every sample.
    ///
    /// Shapes: `p` np; `q0`, `v0` nq; `drive.t` N; `drive.u` N × nu; `q`, `v` N × nq. On an error
    /// the samples before its time have been written.
    ///
    /// # Errors
    /// [`SimulateError`], with the time at which it happened.
    pub fn run(
        &mut self,
        p: &[f64],
        q0: &[f64],
        v0: &[f64],
        drive: &Drive<'_>,
        q: &mut [f64],
        v: &mut [f64],
    ) -> Result<Stats, SimulateError> {
        let dims = self.forward.dims();
        let (nq, nu, n) = (dims.nq, dims.nu, drive.t.len());
        for (what, expected, found) in [
            ("p", dims.np, p.len()),
            ("q0", nq, q0.len()),
            ("v0", nq, v0.len()),
            ("u", n * nu, drive.u.len()),
            ("q", n * nq, q.len()),
            ("v", n * nq, v.len()),
        ] {
            if expected != found {
                return Err(SimulateError::Shape {
                    what,
                    expected,
                    found,
                });
            }
        }
        if self.settings.method == Method::Radau && self.implicit.is_none() {
            let model = self.forward.model().name().to_owned();
            return Err(SimulateError::NoDerivatives { model });
        }
        if n == 0 {
            return Ok(Stats::default());
        }
        if p.iter().chain(q0).chain(v0).any(|x| !x.is_finite()) {
            return Err(SimulateError::NotFinite { time: drive.t[0] });
        }
        self.run = Run {
            implicit: self.settings.method == Method::Radau,
            ..Run::default()
        };
        self.x[..nq].copy_from_slice(q0);
        self.x[nq..].copy_from_slice(v0);
        q[..nq].copy_from_slice(q0);
        v[..nq].copy_from_slice(v0);
        for i in 0..n - 1 {
            let interval = Interval {
                t0: drive.t[i],
                t1: drive.t[i + 1],
                u0: &drive.u[i * nu..(i + 1) * nu],
                u1: &drive.u[(i + 1) * nu..(i + 2) * nu],
                hold: drive.hold,
            };
            if !interval.is_finite() {
                return Err(SimulateError::NotFinite { time: interval.t0 });
            }
            if let Method::Rk4 { substeps } = self.settings.method {
                self.fixed(&interval, p, substeps.max(1))?;
            } else {
                self.adaptive(&interval, p)?;
            }
            if let Some(k) = self.x.iter().position(|x| x.abs() > self.settings.blow_up) {
                let (time, limit) = (interval.t1, self.settings.blow_up);
                return Err(SimulateError::Diverged {
                    time,
                    joint: k % nq,
                    limit,
                });
            }
            let next = (i + 1) * nq..(i + 2) * nq;
            q[next.clone()].copy_from_slice(&self.x[..nq]);
            v[next].copy_from_slice(&self.x[nq..]);
        }
        Ok(self.run.stats)
    }

    fn fixed(
        &mut self,
        interval: &Interval<'_>,
        p: &[f64],
        substeps: usize,
    ) -> Result<(), SimulateError> {
        let h = (interval.t1 - interval.t0) / substeps as f64;
        for k in 0..substeps {
            let t = interval.t0 + k as f64 * h;
            self.explicit
                .rk4(&mut self.forward, interval, p, (t, &self.x, h))
                .map_err(|fault| self.error(fault, t))?;
            self.x.copy_from_slice(&self.explicit.x1);
            self.run.stats.steps += 1;
        }
        Ok(())
    }

    fn adaptive(&mut self, interval: &Interval<'_>, p: &[f64]) -> Result<(), SimulateError> {
        let length = interval.t1 - interval.t0;
        let automatic = self.settings.method == Method::Auto && self.implicit.is_some();
        self.run.since += 1;
        if automatic && self.run.implicit && self.run.since > RETRY {
            self.run.implicit = false;
            self.run.stiff = 0;
        }
        if self.run.h <= 0.0 {
            self.run.h = length;
        }
        // Inputs jump here: the slope of the last step is not that of the next one.
        self.explicit.first_known = false;
        let mut t = interval.t0;
        let mut tried = 0;
        // Distances are measured from the start of the interval, so that large times cost no
        // digits.
        let mut done = 0.0;
        let mut fault = None;
        while done < length {
            let rest = length - done;
            let last = self.run.h >= rest * (1.0 - 1e-12);
            let h = if last { rest } else { self.run.h };
            if tried >= self.settings.max_steps || h <= 1e-14 * length {
                return Err(match fault {
                    Some(fault) => self.error(fault, t),
                    None => SimulateError::TooManySteps {
                        time: t,
                        step: h,
                        steps: tried,
                    },
                });
            }
            tried += 1;
            let outcome = if self.run.implicit {
                self.implicit_step(interval, p, t, h)
            } else {
                self.explicit_step(interval, p, t, h)
            };
            let (error, order) = match outcome {
                Ok(Some(trial)) => trial,
                Ok(None) => (f64::INFINITY, 4.0),
                // A shorter step may avoid the place. If none does, the place is the error.
                Err(found) => {
                    fault = Some(found);
                    (f64::INFINITY, 4.0)
                }
            };
            let factor = step_factor(error, order);
            if error <= 1.0 {
                fault = None;
                self.accept();
                done = if last { length } else { done + h };
                t = if last {
                    interval.t1
                } else {
                    interval.t0 + done
                };
                // A step cut short by the sample says little about the length it could have had.
                self.run.h = if last {
                    self.run.h.max(h * factor)
                } else {
                    h * factor
                };
            } else {
                self.run.stats.rejected += 1;
                self.run.h = h * factor.min(0.9);
            }
            if automatic
                && !self.run.implicit
                && done < length
                && (tried > MANY || self.run.stiff >= STIFF)
            {
                self.run.implicit = true;
                self.run.since = 0;
                self.run.h = (8.0 * self.run.h).min(length);
            }
        }
        Ok(())
    }

    /// Takes the state at the end of the step that was tried.
    fn accept(&mut self) {
        let x1 = match (&self.implicit, self.run.implicit) {
            (Some(implicit), true) => &implicit.x1,
            _ => &self.explicit.x1,
        };
        self.x.copy_from_slice(x1);
        self.run.stats.steps += 1;
        if self.run.implicit {
            self.run.stats.implicit += 1;
            self.explicit.first_known = false;
        } else {
            self.explicit.accept();
        }
    }

    /// Scaled error and order of the step-size rule.
    fn explicit_step(
        &mut self,
        interval: &Interval<'_>,
        p: &[f64],
        t: f64,
        h: f64,
    ) -> Result<Option<(f64, f64)>, Fault> {
        let step = (t, self.x.as_slice(), h);
        let trial =
            self.explicit
                .dormand_prince(&mut self.forward, interval, p, step, &self.settings)?;
        if trial.error <= 1.0 {
            if trial.h_lambda > 3.25 {
                self.run.stiff += 1;
                self.run.not_stiff = 0;
            } else {
                self.run.not_stiff += 1;
                if self.run.not_stiff >= NOT_STIFF {
                    self.run.stiff = 0;
                }
            }
        }
        Ok(Some((trial.error, 5.0)))
    }

    fn implicit_step(
        &mut self,
        interval: &Interval<'_>,
        p: &[f64],
        t: f64,
        h: f64,
    ) -> Result<Option<(f64, f64)>, Fault> {
        let Some(implicit) = &mut self.implicit else {
            return Ok(None);
        };
        let step = (t, self.x.as_slice(), h);
        let error = implicit.step(&mut self.forward, interval, p, step, &self.settings)?;
        Ok(error.map(|e| (e, 4.0)))
    }

    fn error(&self, fault: Fault, time: f64) -> SimulateError {
        match fault {
            Fault::NotFinite => SimulateError::NotFinite { time },
            Fault::Singular { joint, value } => {
                let name = self
                    .forward
                    .model()
                    .joints()
                    .get(joint)
                    .map_or_else(String::new, |j| j.name.to_string());
                SimulateError::SingularMass {
                    time,
                    joint,
                    name,
                    value,
                }
            }
        }
    }
}
