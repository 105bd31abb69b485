//! Steps, their sizes, and the choice between explicit and implicit.

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
            let factor = if error.is_finite() {
                (0.9 * error.max(1e-10).powf(-1.0 / order)).clamp(0.2, 6.0)
            } else {
                0.25
            };
            if error <= 1.0 {
                fault = None;
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

#[cfg(test)]
mod tests {
    use super::super::test_models::{DoublePendulum, PENDULUM, Pendulum, TwoMasses};
    use super::super::{Trajectory, simulate};
    use super::*;
    use pid_data::InputHold;

    fn settings(method: Method, tolerance: f64) -> Settings {
        Settings {
            method,
            rtol: tolerance,
            atol: tolerance,
            ..Settings::default()
        }
    }

    fn swing(
        p: &[f64],
        n: usize,
        h: f64,
        u: f64,
        settings: Settings,
    ) -> Result<Trajectory, SimulateError> {
        let t: Vec<f64> = (0..=n).map(|i| i as f64 * h).collect();
        let inputs = vec![u; n + 1];
        let drive = Drive {
            t: &t,
            u: &inputs,
            hold: InputHold::ZeroOrder,
        };
        simulate(&Pendulum, p, &[2.0], &[0.5], &drive, settings)
    }

    /// Final state of a driven, damped pendulum after 1 s.
    fn last(t: &Trajectory) -> [f64; 2] {
        [t.q[t.q.len() - 1], t.v[t.v.len() - 1]]
    }

    fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
        (a[0] - b[0]).hypot(a[1] - b[1])
    }

    #[test]
    fn orders_of_convergence_are_those_of_the_methods() {
        let p = [1.2, 9.0, 0.3, 0.2, 1.0];
        let exact = last(&swing(&p, 1, 1.0, 0.7, settings(Method::Radau, 1e-13)).unwrap());
        let other = last(&swing(&p, 1, 1.0, 0.7, settings(Method::DormandPrince, 1e-13)).unwrap());
        assert!(
            distance(exact, other) < 1e-10,
            "two methods, one solution: {exact:?} {other:?}"
        );
        // One step per sample, whatever its error.
        let loose = |method| Settings {
            rtol: 1e9,
            atol: 1e9,
            ..settings(method, 1.0)
        };
        for (method, order) in [
            (Method::Rk4 { substeps: 1 }, 4.0),
            (Method::DormandPrince, 5.0),
        ] {
            let error = |n: usize| {
                let t = swing(&p, n, 1.0 / n as f64, 0.7, loose(method)).unwrap();
                assert_eq!(t.stats.steps, n);
                distance(last(&t), exact)
            };
            let measured = (error(20) / error(40)).log2();
            assert!(
                (measured - order).abs() < 0.25,
                "{method:?}: order {measured}"
            );
        }
    }

    #[test]
    fn energy_is_kept_without_friction() {
        let p = [1.2, 9.0, 0.0, 0.0, 0.0];
        let t: Vec<f64> = (0..=1000).map(|i| 0.01 * f64::from(i)).collect();
        let u = vec![0.0; 1001];
        let drive = Drive {
            t: &t,
            u: &u,
            hold: InputHold::ZeroOrder,
        };
        let tight = Settings {
            rtol: 1e-11,
            atol: 1e-12,
            ..Settings::default()
        };
        let motion = simulate(&Pendulum, &p, &[2.5], &[0.0], &drive, tight).unwrap();
        let energy = |i: usize| 0.5 * p[0] * motion.v[i].powi(2) - p[1] * motion.q[i].cos();
        for i in 0..=1000 {
            assert!(
                (energy(i) - energy(0)).abs() < 1e-8 * p[1],
                "sample {i}: {}",
                energy(i)
            );
        }
    }

    #[test]
    fn energy_of_a_chaotic_double_pendulum_is_kept() {
        let model = DoublePendulum;
        let t: Vec<f64> = (0..=500).map(|i| 0.01 * f64::from(i)).collect();
        let drive = Drive {
            t: &t,
            u: &[0.0; 2 * 501],
            hold: InputHold::ZeroOrder,
        };
        let tight = Settings {
            rtol: 1e-11,
            atol: 1e-12,
            ..Settings::default()
        };
        let (mut q, mut v) = (vec![0.0; 2 * 501], vec![0.0; 2 * 501]);
        let mut simulator = Simulator::new(&model, tight);
        simulator
            .run(&[], &[2.0, 1.0], &[0.0, 0.0], &drive, &mut q, &mut v)
            .unwrap();
        let energy = |i: usize| {
            let at = pid_runtime::dynamics::At {
                q: &q[2 * i..2 * i + 2],
                v: &v[2 * i..2 * i + 2],
                a: &[],
                u: &[],
                p: &[],
            };
            model.kinetic_energy(&at) + model.potential_energy(&at)
        };
        let moved = (0..=500).any(|i| (q[2 * i] - 2.0).abs() > 1.0);
        assert!(moved);
        for i in 0..=500 {
            assert!(
                (energy(i) - energy(0)).abs() < 1e-7,
                "sample {i}: {} {}",
                energy(i),
                energy(0)
            );
        }
    }

    #[test]
    fn dry_friction_is_stiff_and_goes_to_the_implicit_method() {
        // tanh(1000 v) with a drive below the breakaway force: the pendulum comes to rest and creeps.
        let p = [0.05, 0.1, 0.0, 2.0, 1000.0];
        let auto = swing(&p, 200, 0.01, 0.5, settings(Method::Auto, 1e-7)).unwrap();
        assert!(auto.stats.implicit > 0, "{:?}", auto.stats);
        let radau = swing(&p, 200, 0.01, 0.5, settings(Method::Radau, 1e-9)).unwrap();
        assert!(
            distance(last(&auto), last(&radau)) < 1e-5,
            "{:?} {:?}",
            last(&auto),
            last(&radau)
        );
        let explicit = swing(&p, 200, 0.01, 0.5, settings(Method::DormandPrince, 1e-7)).unwrap();
        assert!(distance(last(&explicit), last(&radau)) < 1e-5);
        assert!(
            10 * auto.stats.steps < explicit.stats.steps,
            "{:?} {:?}",
            auto.stats,
            explicit.stats
        );
    }

    #[test]
    fn coupled_masses_swing_as_their_modes_say() {
        // M = [[2, 1], [1, 2]], K = [[5, -1], [-1, 5]]: modes (1, 1) with ω² = 4/3 and (1, −1) with ω² = 6.
        let t: Vec<f64> = (0..=100).map(|i| 0.05 * f64::from(i)).collect();
        let drive = Drive {
            t: &t,
            u: &[0.0; 2 * 101],
            hold: InputHold::Linear,
        };
        for method in [Method::Radau, Method::DormandPrince] {
            let motion = simulate(
                &TwoMasses,
                &[],
                &[1.0, 0.2],
                &[0.0, 0.0],
                &drive,
                settings(method, 1e-10),
            )
            .unwrap();
            for (i, t) in t.iter().enumerate() {
                let (even, odd) = (
                    0.6 * ((4.0_f64 / 3.0).sqrt() * t).cos(),
                    0.4 * (6.0_f64.sqrt() * t).cos(),
                );
                assert!(
                    (motion.q[2 * i] - (even + odd)).abs() < 1e-7,
                    "{method:?} at {t}"
                );
                assert!(
                    (motion.q[2 * i + 1] - (even - odd)).abs() < 1e-7,
                    "{method:?} at {t}"
                );
            }
        }
    }

    #[test]
    fn inputs_are_held_or_joined_by_lines() {
        // A free mass: a = u / m. Held: 1 then 2 gives v = 1·1 + 2·1; linear 1 → 2 → 4 gives 1.5 + 3.
        let p = [1.0, 0.0, 0.0, 0.0, 0.0];
        let (t, u) = ([0.0, 1.0, 2.0], [1.0, 2.0, 4.0]);
        for (hold, v) in [(InputHold::ZeroOrder, 3.0), (InputHold::Linear, 4.5)] {
            for method in [
                Method::DormandPrince,
                Method::Radau,
                Method::Rk4 { substeps: 2 },
            ] {
                let drive = Drive { t: &t, u: &u, hold };
                let m = simulate(
                    &Pendulum,
                    &p,
                    &[0.0],
                    &[0.0],
                    &drive,
                    settings(method, 1e-9),
                )
                .unwrap();
                assert!((m.v[2] - v).abs() < 1e-8, "{hold:?} {method:?}: {}", m.v[2]);
            }
        }
    }

    #[test]
    fn what_cannot_be_simulated_is_said_with_its_time() {
        let text = |r: Result<Trajectory, SimulateError>| r.unwrap_err().to_string();
        let massless = text(swing(
            &[0.0, 1.0, 0.0, 0.0, 0.0],
            10,
            0.1,
            0.0,
            Settings::default(),
        ));
        assert!(
            massless.contains("singular at t = 0 s") && massless.contains("`hinge`"),
            "{massless}"
        );
        // Negative damping: v' = 40 v explodes.
        let p = [1.0, 0.0, -40.0, 0.0, 0.0];
        let e = swing(&p, 100, 0.1, 0.0, Settings::default()).unwrap_err();
        assert!(
            matches!(e, SimulateError::Diverged { .. }) && e.time() < Some(1.0),
            "{e}"
        );
        let e = swing(&PENDULUM, 10, 0.1, f64::NAN, Settings::default()).unwrap_err();
        assert!(matches!(e, SimulateError::NotFinite { .. }), "{e}");
        let e = swing(&[1.0], 10, 0.1, 0.0, Settings::default()).unwrap_err();
        assert_eq!(
            e,
            SimulateError::Shape {
                what: "p",
                expected: 5,
                found: 1
            }
        );
        let few = Settings {
            max_steps: 3,
            ..settings(Method::DormandPrince, 1e-12)
        };
        let e = swing(&PENDULUM, 1, 1.0, 0.0, few).unwrap_err();
        assert!(
            matches!(e, SimulateError::TooManySteps { steps: 3, .. }),
            "{e}"
        );
        let mut simulator = Simulator::new(&Pendulum, settings(Method::Radau, 1e-6));
        let drive = Drive {
            t: &[0.0],
            u: &[0.0],
            hold: InputHold::ZeroOrder,
        };
        let e = simulator
            .run(&PENDULUM, &[0.0], &[0.0], &drive, &mut [0.0], &mut [0.0])
            .unwrap_err();
        assert!(matches!(e, SimulateError::NoDerivatives { .. }));
    }
}
