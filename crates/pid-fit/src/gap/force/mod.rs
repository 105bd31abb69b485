//! The missing generalised force: the force that must act beside the model for it to follow the
//! record.
//!
//! ```text
//! w(t) = r(q, v, a, u, p) = M(q, p) a + b(q, v, p) − f_L(q, v, p, u)
//!
//! minimise  Σ_i |y_i − (q_i, v_i)|²_R⁻¹ + Σ_i |w_{i+1} − w_i|²_(h S)⁻¹     over q_0, v_0, a_0 … a_{N−2}
//! with      q_{i+1} = q_i + h v_i + h²/2 a_i,   v_{i+1} = v_i + h a_i,
//!           w_i = r at the middle of the interval
//! ```
//!
//! the weak-constraint form of data assimilation (Y. Trémolet, Accounting for an imperfect model in
//! 4D-Var, 2006), with the dynamic rows of the implicit midpoint rule as the weak ones.
//! Gauss-Newton steps alternate with expectation maximisation of the noise levels R and the drift S
//! of the force; each step is one fixed-interval smoothing of the linearised chain. Nothing has to
//! be chosen: a record that follows the model gets a small S and a w near zero. The band is the
//! posterior variance of w.

mod estimate;
mod problem;
mod smoother;

pub use estimate::{MissingForceError, MissingForceEstimate, NoiseLevels, Values};
use pid_data::signal::state_from_data;
use pid_data::{Dataset, Experiment};
use pid_runtime::dynamics::Jacobian;
use problem::{Pace, Path, Problem};
use smoother::smooth;

/// Most Gauss-Newton steps.
const STEPS: usize = 40;
/// The noise levels have settled when none changes by more than this share in one round.
const SETTLED: f64 = 0.02;

/// Coordinates at which no force is missing: their equations are definitions, as that of a filter, or a force there is
/// one at the coordinate that is read beside them, as of a rotor.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct States {
    /// Those of which no sensor reads position or velocity.
    pub unread: Vec<usize>,
    /// Those whose velocities are readings that lag.
    pub readings: Vec<usize>,
}

impl States {
    /// A model whose coordinates are joints.
    pub const NONE: &'static States = &States {
        unread: Vec::new(),
        readings: Vec::new(),
    };

    /// Whether a coordinate is one of them.
    pub fn has(&self, coordinate: usize) -> bool {
        self.unread.contains(&coordinate) || self.readings.contains(&coordinate)
    }
}

/// Estimates w on one experiment.
///
/// A velocity channel counts where it is a measurement of its own
/// ([`Measured`](pid_data::VelocityKind::Measured)). Missing samples of q and v count as not
/// measured; missing inputs are bridged by straight lines. Inputs that are held from sample to
/// sample act as they are on each interval, others with their mean. No force is missing at `states`.
///
/// # Errors
/// [`MissingForceError`] for records too short or empty, and where the model cannot be evaluated.
pub fn missing_force(
    model: &dyn Jacobian,
    p: &[f64],
    dataset: &Dataset,
    experiment: &Experiment,
    states: &States,
) -> Result<MissingForceEstimate, MissingForceError> {
    let start = state_from_data(experiment, None)?;
    let (n, nq) = (experiment.len(), experiment.nq);
    let mut problem = Problem::new(model, p, dataset, (experiment, states));

    // The filtered record is no trajectory of the chain; the first step makes one of it.
    let mut path = Path {
        q: start.q,
        v: start.v,
        a: Vec::with_capacity((n - 1) * nq),
        w: vec![0.0; (n - 1) * nq],
    };
    for i in 0..n - 1 {
        let h = experiment.t[i + 1] - experiment.t[i];
        for j in i * nq..(i + 1) * nq {
            path.a.push((path.v[j + nq] - path.v[j]) / h);
        }
    }
    problem.force(&mut path)?;
    let mut noise = problem.first_levels(&path);
    let prior = problem.prior(&path, &noise);

    let mut pace = Pace::new(nq);
    let mut settled = false;
    let mut smoothed = None;
    for step in 0..STEPS {
        let steps = problem.linearise(&path)?;
        let s = smooth(&steps, &problem.y, &noise, &prior);
        let mut next = problem.path(&steps, &s);
        let arrived = if step == 0 {
            problem.force(&mut next)?;
            path = next;
            false
        } else {
            problem.search(&mut path, next, &noise, &prior)
        };
        let moved = pace.hurry(&mut noise, &s.moments, &problem);
        smoothed = Some(s);
        if arrived && moved < SETTLED {
            settled = true;
            break;
        }
    }
    let Some(smoothed) = smoothed else {
        unreachable!("at least one step is taken")
    };
    Ok(problem.estimate(path, &smoothed, noise, settled))
}

#[cfg(test)]
mod tests;
