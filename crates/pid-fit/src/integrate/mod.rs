//! Accurate simulation: the motion of a robot under the recorded inputs.
//!
//! ```text
//! q' = v,        v' = a = M(q, p)⁻¹ (f_L(q, v, p, u(t)) − b(q, v, p)),        q(t_0) = q_0, v(t_0) = v_0
//! ```
//!
//! The identification uses simple one-step schemes at the sampling rate. Here the error is
//! controlled, so that a difference between simulation and record is the model's fault and not the
//! integrator's. Inputs may jump at every sample: steps end there, and each sampling interval is
//! smooth.
//!
//! Friction of the kind `tanh(1000 v)` is stiff near standstill. [`Method::Auto`] integrates with
//! an explicit pair of order 5(4) and goes over to an L-stable implicit method of order 5 where
//! stability, not accuracy, limits the step.
//!
//! A [`Simulator`] owns all memory: after it is made, runs allocate nothing.

mod explicit;
mod forward;
mod implicit;
mod linear;
mod simulator;
#[cfg(test)]
pub(crate) mod test_models;

pub(crate) use explicit::A as DORMAND_PRINCE;
pub use forward::ForwardDynamics;
pub use simulator::Simulator;

use pid_data::InputHold;
use pid_runtime::dynamics::Jacobian;

/// Method of integration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// [`Method::DormandPrince`] until it turns out stiff, then [`Method::Radau`] for a while.
    #[default]
    Auto,
    /// Explicit Runge-Kutta pair of order 5(4) with controlled steps (J. R. Dormand, P. J. Prince, 1980).
    DormandPrince,
    /// Radau IIA with three stages: order 5, L-stable, controlled steps (E. Hairer, G. Wanner,
    /// Solving Ordinary Differential Equations II, section IV.8); Newton's method with exact
    /// derivatives of the residual.
    Radau,
    /// The classical Runge-Kutta method of order 4 with so many equal steps per sampling interval.
    Rk4 {
        /// Steps per sampling interval, at least 1.
        substeps: usize,
    },
}

/// Settings of a simulation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Method of integration.
    pub method: Method,
    /// Tolerated local error relative to each state: 1e-8.
    pub rtol: f64,
    /// Tolerated local error of states near zero, in their unit: 1e-10, far below any encoder step.
    pub atol: f64,
    /// Most steps in one sampling interval, rejected ones included: 20 000; more means that the
    /// motion explodes.
    pub max_steps: usize,
    /// A position or velocity beyond this (SI) counts as diverged: 1e6.
    pub blow_up: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            method: Method::Auto,
            rtol: 1e-8,
            atol: 1e-10,
            max_steps: 20_000,
            blow_up: 1e6,
        }
    }
}

/// Recorded inputs: `t` has N ≥ 1 times, s, and `u` N × nu values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive<'a> {
    /// Times of the samples, strictly increasing, s.
    pub t: &'a [f64],
    /// Inputs, row by row.
    pub u: &'a [f64],
    /// Their course between samples.
    pub hold: InputHold,
}

/// Work of a simulation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Stats {
    /// Accepted steps.
    pub steps: usize,
    /// Rejected steps.
    pub rejected: usize,
    /// Accepted steps that were implicit.
    pub implicit: usize,
}

/// A simulated motion at the sample times.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// Positions, N × nq, rad or m.
    pub q: Vec<f64>,
    /// Velocities, N × nq, rad/s or m/s.
    pub v: Vec<f64>,
    /// Work it took.
    pub stats: Stats,
}

/// Why a simulation cannot go on.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SimulateError {
    /// A slice of the wrong length.
    #[error("{what} has {found} values, the model needs {expected}")]
    Shape {
        /// Which one.
        what: &'static str,
        /// Length needed.
        expected: usize,
        /// Length found.
        found: usize,
    },
    /// M has no Cholesky factorization.
    #[error(
        "the mass matrix is singular at t = {time} s: pivot {value:e} at coordinate {joint} (`{name}`)\n  help: give the links that move with this joint a mass or an inertia about its axis, and check the signs of the parameters"
    )]
    SingularMass {
        /// Time, s.
        time: f64,
        /// Number of the coordinate, from 0.
        joint: usize,
        /// Its name.
        name: String,
        /// The pivot that is not positive.
        value: f64,
    },
    /// The state, an input or a force is not a finite number.
    #[error(
        "the motion cannot be evaluated at t = {time} s: a state, input or force is not finite\n  help: check missing samples and the ranges of the parameters"
    )]
    NotFinite {
        /// Time, s.
        time: f64,
    },
    /// The state left all reasonable bounds.
    #[error("the motion diverged at t = {time} s: coordinate {joint} passed {limit:e}")]
    Diverged {
        /// Time, s.
        time: f64,
        /// Number of the coordinate, from 0.
        joint: usize,
        /// The bound.
        limit: f64,
    },
    /// Too many steps between two samples, or a step that vanishes.
    #[error(
        "the step became too small at t = {time} s (step {step:e} s, {steps} steps since the last sample)\n  help: use the implicit method, a looser tolerance or a smoother force law"
    )]
    TooManySteps {
        /// Time, s.
        time: f64,
        /// Last step tried, s.
        step: f64,
        /// Steps since the last sample.
        steps: usize,
    },
    /// An implicit method without derivatives.
    #[error(
        "model `{model}` has no derivatives, which the implicit method needs\n  help: emit `first_derivatives`, or use the explicit method"
    )]
    NoDerivatives {
        /// The model.
        model: String,
    },
}

impl SimulateError {
    /// Time at which the simulation stopped, s, where there is one.
    pub fn time(&self) -> Option<f64> {
        match self {
            SimulateError::SingularMass { time, .. }
            | SimulateError::NotFinite { time }
            | SimulateError::Diverged { time, .. }
            | SimulateError::TooManySteps { time, .. } => Some(*time),
            SimulateError::Shape { .. } | SimulateError::NoDerivatives { .. } => None,
        }
    }
}

/// Simulates once. For several simulations a [`Simulator`] reuses the memory.
///
/// Shapes: `p` np, `q0` and `v0` nq, `drive` as stated there.
///
/// # Errors
/// [`SimulateError`], with the time at which it happened.
pub fn simulate(
    model: &dyn Jacobian,
    p: &[f64],
    q0: &[f64],
    v0: &[f64],
    drive: &Drive<'_>,
    settings: Settings,
) -> Result<Trajectory, SimulateError> {
    let n = drive.t.len() * model.dims().nq;
    let (mut q, mut v) = (vec![0.0; n], vec![0.0; n]);
    let stats =
        Simulator::with_derivatives(model, settings).run(p, q0, v0, drive, &mut q, &mut v)?;
    Ok(Trajectory { q, v, stats })
}

/// Why a step could not be evaluated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Fault {
    /// A pivot of M is not positive.
    Singular { joint: usize, value: f64 },
    /// Something is not finite.
    NotFinite,
}

/// One sampling interval with its inputs.
#[derive(Debug, Clone, Copy)]
struct Interval<'a> {
    t0: f64,
    t1: f64,
    u0: &'a [f64],
    u1: &'a [f64],
    hold: InputHold,
}

impl Interval<'_> {
    /// Whether all inputs that act in the interval are numbers.
    fn is_finite(&self) -> bool {
        let finite = |u: &[f64]| u.iter().all(|x| x.is_finite());
        finite(self.u0) && (self.hold == InputHold::ZeroOrder || finite(self.u1))
    }

    fn input(&self, t: f64, out: &mut [f64]) {
        self.hold
            .at(self.u0, self.u1, (t - self.t0) / (self.t1 - self.t0), out);
    }
}

/// Root mean square of the entries of `e`, each over `atol + rtol max(|x|, |y|)`.
fn scaled_norm(e: &[f64], x: &[f64], y: &[f64], settings: &Settings) -> f64 {
    let sum: f64 = e
        .iter()
        .zip(x)
        .zip(y)
        .map(|((e, x), y)| (e / (settings.atol + settings.rtol * x.abs().max(y.abs()))).powi(2))
        .sum();
    (sum / e.len() as f64).sqrt()
}
