//! Free-run error: how far a simulation moves away from the record within a horizon.
//!
//! A record is cut into restart windows ([`pid_data::windows`]). Each window starts from the
//! recorded state, runs with the recorded inputs alone and is compared sample by sample; the start
//! itself is not counted. Per joint and channel, over the N compared values x of the simulation and
//! x^d of the record,
//!
//! ```text
//! RMS = √(Σ (x − x^d)² / N),        MAE = Σ |x − x^d| / N,        max = max |x − x^d|,
//! ```
//!
//! and, as in K. Schäfer et al., Section V-A, `J = 1/N Σ_i |x_i − x_i^d|²` over positions and
//! recorded velocities. Windows that diverge, and windows that cannot start because a sample is
//! missing, are counted and left out.
//!
//! The gap of a diagnosis is another figure: relative to the motion, from the states of a predictor.

use std::ops::Range;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::integrate::{Drive, Settings, SimulateError, Simulator};
use pid_data::signal::{SignalError, StateEstimate, state_from_data};
use pid_data::{Dataset, Experiment, Horizon, Role, VelocityKind, windows};
use pid_runtime::dynamics::Jacobian;

/// Settings of free runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreeRunSettings {
    /// How far a simulation runs before it is restarted.
    pub horizon: Horizon,
    /// Source of the velocity at the start.
    pub start: StartVelocity,
    /// Cut-off of the filter that derives velocities, Hz; `None` as in [`state_from_data`].
    pub cutoff: Option<f64>,
    /// Integration. The default here is 1e-6 relative and 1e-8 absolute, far below the errors that
    /// are judged.
    pub integration: Settings,
}

impl FreeRunSettings {
    /// The defaults for a horizon.
    pub fn new(horizon: Horizon) -> Self {
        let integration = Settings {
            rtol: 1e-6,
            atol: 1e-8,
            ..Settings::default()
        };
        FreeRunSettings {
            horizon,
            start: StartVelocity::default(),
            cutoff: None,
            integration,
        }
    }
}

/// Velocity at the start of a window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StartVelocity {
    /// The recorded one where there is one, otherwise the estimate.
    #[default]
    Recorded,
    /// The zero-phase estimate of [`state_from_data`] for all joints: less noise than a single sample.
    Estimated,
}

/// Why a free run cannot be judged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FreeRunError {
    /// States cannot be estimated.
    #[error(transparent)]
    Signal(#[from] SignalError),
    /// The model cannot be simulated at all: a singular mass matrix, a wrong shape.
    #[error("experiment `{experiment}`: {error}")]
    Simulate {
        /// The experiment.
        experiment: String,
        /// The cause.
        error: SimulateError,
    },
}

/// Error of one channel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ChannelError {
    /// Root mean square.
    pub rms: f64,
    /// Mean of the absolute value.
    pub mae: f64,
    /// Largest absolute value.
    pub max: f64,
    /// Values compared.
    pub count: usize,
}

/// Errors of one joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointError {
    /// Name of the joint in the data.
    pub joint: String,
    /// Position, rad or m; `None` if nothing could be compared.
    pub q: Option<ChannelError>,
    /// Velocity, rad/s or m/s; `None` without a recorded velocity.
    pub v: Option<ChannelError>,
}

/// Free-run error of one experiment or of all experiments of a role.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FreeRunScore {
    /// Experiments covered.
    pub experiments: Vec<String>,
    /// Their role.
    pub role: Role,
    /// The horizon.
    pub horizon: Horizon,
    /// Per joint.
    pub joints: Vec<JointError>,
    /// `1/N Σ_i |x_i − x_i^d|²` over positions and, where all joints have them, recorded velocities
    /// (mixed units, as in the source); `None` if nothing could be compared.
    pub objective: Option<f64>,
    /// Windows simulated to their end.
    pub windows: usize,
    /// Windows in which the simulation diverged or could not go on.
    pub diverged: usize,
    /// Windows that could not start or run because a sample is missing.
    pub skipped: usize,
}

/// Free-run errors per experiment, and pooled per role.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FreeRunTable {
    /// One per experiment, in the order of the data set.
    pub experiments: Vec<FreeRunScore>,
    /// One per role that occurs, train first.
    pub roles: Vec<FreeRunScore>,
}

/// A simulated record: restarted at the windows' borders, NaN where nothing was simulated.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeRun {
    /// Positions, N × nq. At a border the end of the earlier window, the start of the record at the
    /// first sample.
    pub q: Vec<f64>,
    /// Velocities, N × nq.
    pub v: Vec<f64>,
    /// The windows that were simulated to their end.
    pub windows: Vec<Range<usize>>,
    /// Windows that diverged, with the reason.
    pub diverged: Vec<(Range<usize>, SimulateError)>,
    /// Windows with a missing sample.
    pub skipped: usize,
}

/// Simulates an experiment window by window, in parallel.
///
/// # Errors
/// [`FreeRunError`] if states cannot be estimated, or if the model itself is at fault (a singular
/// mass matrix, wrong shapes).
pub fn free_run(
    model: &dyn Jacobian,
    p: &[f64],
    dataset: &Dataset,
    experiment: &Experiment,
    settings: &FreeRunSettings,
) -> Result<FreeRun, FreeRunError> {
    let nq = experiment.nq;
    let estimate = start_estimate(dataset, experiment, settings)?;
    let start = |i: usize| -> (&[f64], Vec<f64>) {
        let q = &experiment.q[i * nq..(i + 1) * nq];
        let v = (0..nq)
            .map(|j| {
                let recorded = experiment.v.as_ref().map_or(f64::NAN, |v| v[i * nq + j]);
                match &estimate {
                    Some(e) if recorded.is_nan() || settings.start == StartVelocity::Estimated => {
                        e.v[i * nq + j]
                    }
                    _ => recorded,
                }
            })
            .collect();
        (q, v)
    };

    let ranges = windows(experiment, settings.horizon);
    let runs: Vec<(Range<usize>, Outcome)> = ranges
        .into_par_iter()
        .map_init(
            || Simulator::with_derivatives(model, settings.integration),
            |simulator, range| {
                let (q0, v0) = start(range.start);
                let nu = experiment.nu();
                let u = &experiment.u[range.start * nu..range.end * nu];
                if q0.iter().chain(&v0).chain(u).any(|x| x.is_nan()) {
                    return (range, Outcome::Skipped);
                }
                let drive = Drive {
                    t: &experiment.t[range.clone()],
                    u,
                    hold: dataset.input_hold,
                };
                let (mut q, mut v) = (vec![0.0; range.len() * nq], vec![0.0; range.len() * nq]);
                let outcome = match simulator.run(p, q0, &v0, &drive, &mut q, &mut v) {
                    Ok(_) => Outcome::Done { q, v },
                    Err(e) => Outcome::Failed(e),
                };
                (range, outcome)
            },
        )
        .collect();
    joined(experiment, runs)
}

/// The windows of an experiment as one motion.
fn joined(
    experiment: &Experiment,
    runs: Vec<(Range<usize>, Outcome)>,
) -> Result<FreeRun, FreeRunError> {
    let nq = experiment.nq;
    let n = experiment.len() * nq;
    let mut out = FreeRun {
        q: vec![f64::NAN; n],
        v: vec![f64::NAN; n],
        windows: Vec::new(),
        diverged: Vec::new(),
        skipped: 0,
    };
    for (range, outcome) in runs {
        match outcome {
            Outcome::Done { q, v } => {
                // The sample at the border belongs to the earlier window, which ran up to it.
                let taken = !out.q[range.start * nq].is_nan();
                let from = usize::from(taken);
                let to = (range.start + from) * nq..range.end * nq;
                out.q[to.clone()].copy_from_slice(&q[from * nq..]);
                out.v[to].copy_from_slice(&v[from * nq..]);
                out.windows.push(range);
            }
            Outcome::Skipped => out.skipped += 1,
            Outcome::Failed(
                error @ (SimulateError::SingularMass { .. }
                | SimulateError::Shape { .. }
                | SimulateError::NoDerivatives { .. }),
            ) => {
                return Err(FreeRunError::Simulate {
                    experiment: experiment.name.clone(),
                    error,
                });
            }
            Outcome::Failed(error) => out.diverged.push((range, error)),
        }
    }
    Ok(out)
}

enum Outcome {
    Done { q: Vec<f64>, v: Vec<f64> },
    Failed(SimulateError),
    Skipped,
}

/// States of the whole record, only where the start of some window needs them.
fn start_estimate(
    dataset: &Dataset,
    experiment: &Experiment,
    settings: &FreeRunSettings,
) -> Result<Option<StateEstimate>, FreeRunError> {
    let recorded = dataset
        .joints
        .iter()
        .all(|j| j.velocity != VelocityKind::Absent);
    if recorded && settings.start == StartVelocity::Recorded {
        return Ok(None);
    }
    Ok(Some(state_from_data(experiment, settings.cutoff)?))
}

/// Free-run errors of a model on every experiment of a data set.
///
/// # Errors
/// As [`free_run`].
pub fn free_run_table(
    model: &dyn Jacobian,
    p: &[f64],
    dataset: &Dataset,
    settings: &FreeRunSettings,
) -> Result<FreeRunTable, FreeRunError> {
    let nq = dataset.nq();
    let mut sums = Vec::with_capacity(dataset.experiments.len());
    for experiment in &dataset.experiments {
        let run = free_run(model, p, dataset, experiment, settings)?;
        sums.push(Sums::of(experiment, &run, nq));
    }
    let experiments = dataset
        .experiments
        .iter()
        .zip(&sums)
        .map(|(e, s)| s.score(dataset, vec![e.name.clone()], e.role, settings.horizon))
        .collect();
    let roles = [Role::Train, Role::Test]
        .into_iter()
        .filter_map(|role| {
            let mut pooled: Option<Sums> = None;
            let mut names = Vec::new();
            for (e, s) in dataset.experiments.iter().zip(&sums) {
                if e.role == role {
                    names.push(e.name.clone());
                    pooled.get_or_insert_with(|| Sums::new(nq)).add(s);
                }
            }
            pooled.map(|s| s.score(dataset, names, role, settings.horizon))
        })
        .collect();
    Ok(FreeRunTable { experiments, roles })
}

/// Running sums of one channel.
#[derive(Debug, Clone, Copy, Default)]
struct Channel {
    square: f64,
    absolute: f64,
    max: f64,
    count: usize,
}

impl Channel {
    fn push(&mut self, error: f64) {
        self.square += error * error;
        self.absolute += error.abs();
        self.max = self.max.max(error.abs());
        self.count += 1;
    }

    fn add(&mut self, other: &Channel) {
        self.square += other.square;
        self.absolute += other.absolute;
        self.max = self.max.max(other.max);
        self.count += other.count;
    }

    fn error(&self) -> Option<ChannelError> {
        let n = self.count as f64;
        (self.count > 0).then(|| ChannelError {
            rms: (self.square / n).sqrt(),
            mae: self.absolute / n,
            max: self.max,
            count: self.count,
        })
    }
}

/// Running sums of an experiment.
struct Sums {
    q: Vec<Channel>,
    v: Vec<Channel>,
    windows: usize,
    diverged: usize,
    skipped: usize,
}

impl Sums {
    fn new(nq: usize) -> Self {
        let zero = vec![Channel::default(); nq];
        Sums {
            q: zero.clone(),
            v: zero,
            windows: 0,
            diverged: 0,
            skipped: 0,
        }
    }

    fn of(experiment: &Experiment, run: &FreeRun, nq: usize) -> Self {
        let mut sums = Sums::new(nq);
        sums.windows = run.windows.len();
        sums.diverged = run.diverged.len();
        sums.skipped = run.skipped;
        for range in &run.windows {
            for i in range.start + 1..range.end {
                for j in 0..nq {
                    let k = i * nq + j;
                    let error = run.q[k] - experiment.q[k];
                    if !error.is_nan() {
                        sums.q[j].push(error);
                    }
                    let error = experiment.v.as_ref().map_or(f64::NAN, |v| run.v[k] - v[k]);
                    if !error.is_nan() {
                        sums.v[j].push(error);
                    }
                }
            }
        }
        sums
    }

    fn add(&mut self, other: &Sums) {
        for (a, b) in self
            .q
            .iter_mut()
            .zip(&other.q)
            .chain(self.v.iter_mut().zip(&other.v))
        {
            a.add(b);
        }
        self.windows += other.windows;
        self.diverged += other.diverged;
        self.skipped += other.skipped;
    }

    fn score(
        &self,
        dataset: &Dataset,
        experiments: Vec<String>,
        role: Role,
        horizon: Horizon,
    ) -> FreeRunScore {
        let joints = dataset
            .joints
            .iter()
            .zip(self.q.iter().zip(&self.v))
            .map(|(joint, (q, v))| JointError {
                joint: joint.name.clone(),
                q: q.error(),
                v: v.error(),
            })
            .collect();
        let mean = |c: &Channel| c.error().map(|e| e.rms * e.rms);
        let q: Option<f64> = self.q.iter().map(mean).sum();
        let v: Option<f64> = self.v.iter().map(mean).sum();
        FreeRunScore {
            experiments,
            role,
            horizon,
            joints,
            objective: q.map(|q| q + v.unwrap_or(0.0)),
            windows: self.windows,
            diverged: self.diverged,
            skipped: self.skipped,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::simulate;
    use crate::integrate::test_models::{PENDULUM, Pendulum};
    use pid_data::{InputHold, InputQuantity, JointChannels, Kind};

    fn dataset(velocity: VelocityKind) -> Dataset {
        let t: Vec<f64> = (0..=400).map(|i| 0.01 * f64::from(i)).collect();
        let make = |name: &str, role, q0: f64| {
            let u: Vec<f64> = t.iter().map(|t| 2.0 * (3.0 * t).sin()).collect();
            let drive = Drive {
                t: &t,
                u: &u,
                hold: InputHold::ZeroOrder,
            };
            let m = simulate(
                &Pendulum,
                &PENDULUM,
                &[q0],
                &[0.0],
                &drive,
                Settings::default(),
            )
            .unwrap();
            Experiment {
                name: name.into(),
                role,
                note: String::new(),
                nq: 1,
                t: t.clone(),
                q: m.q,
                v: (velocity != VelocityKind::Absent).then_some(m.v),
                u,
                tau: None,
                qref: None,
                missing: 0,
                gain_factors: Default::default(),
            }
        };
        Dataset {
            name: "d".into(),
            title: String::new(),
            source: String::new(),
            license: String::new(),
            kind: Kind::Simulated,
            input_hold: InputHold::ZeroOrder,
            joints: vec![JointChannels {
                name: "hinge".into(),
                prismatic: false,
                input: InputQuantity::Torque,
                input_unit: "N*m".into(),
                velocity,
            }],
            experiments: vec![make("a", Role::Train, 1.0), make("b", Role::Test, -0.5)],
            warnings: Vec::new(),
        }
    }

    fn table(d: &Dataset, p: &[f64], horizon: Horizon) -> FreeRunTable {
        free_run_table(&Pendulum, p, d, &FreeRunSettings::new(horizon)).unwrap()
    }

    #[test]
    fn the_true_parameters_leave_nothing() {
        let d = dataset(VelocityKind::Measured);
        for horizon in [Horizon::Record, Horizon::Seconds(1.0), Horizon::Samples(1)] {
            let t = table(&d, &PENDULUM, horizon);
            assert_eq!(t.roles.len(), 2);
            for s in t.experiments.iter().chain(&t.roles) {
                assert!(s.objective.unwrap() < 1e-10, "{horizon}: {s:?}");
                assert_eq!((s.diverged, s.skipped), (0, 0));
                assert_eq!(s.joints[0].q.unwrap().count, 400);
            }
        }
        // Velocities derived from positions are close and are not scored.
        let s = &table(
            &dataset(VelocityKind::Absent),
            &PENDULUM,
            Horizon::Seconds(0.5),
        )
        .roles[0];
        assert!(s.joints[0].q.unwrap().rms < 5e-3, "{s:?}");
        assert!(s.joints[0].v.is_none());
    }

    #[test]
    fn an_offset_in_the_record_is_measured() {
        let mut d = dataset(VelocityKind::Measured);
        // A record that jumps by 0.1 rad after its start: each sample but the first is off by exactly that.
        for q in &mut d.experiments[0].q[1..] {
            *q += 0.1;
        }
        let t = table(&d, &PENDULUM, Horizon::Record);
        let e = t.experiments[0].joints[0].q.unwrap();
        for x in [e.rms, e.mae, e.max] {
            assert!((x - 0.1).abs() < 1e-5, "{e:?}");
        }
        assert!((t.experiments[0].objective.unwrap() - 0.01).abs() < 1e-5);
        assert!(
            t.roles[1].joints[0].q.unwrap().rms < 1e-5,
            "the test record is untouched"
        );
    }

    #[test]
    fn longer_horizons_show_more_of_a_wrong_parameter() {
        let d = dataset(VelocityKind::Measured);
        let mut p = PENDULUM;
        p[1] *= 1.1;
        let rms = |h| table(&d, &p, h).roles[1].joints[0].q.unwrap().rms;
        let (short, middle, long) = (
            rms(Horizon::Samples(1)),
            rms(Horizon::Seconds(0.2)),
            rms(Horizon::Seconds(1.0)),
        );
        assert!(
            10.0 * short < middle && middle < 0.5 * long,
            "{short} {middle} {long}"
        );
    }

    #[test]
    fn missing_samples_and_divergence_are_counted() {
        let mut d = dataset(VelocityKind::Measured);
        d.experiments[0].q[100] = f64::NAN; // the start of the second window
        d.experiments[0].u[250] = f64::NAN; // within the third
        d.experiments[0].q[350] = f64::NAN; // a sample of the fourth: not compared
        let s = &table(&d, &PENDULUM, Horizon::Seconds(1.0)).experiments[0];
        assert_eq!((s.windows, s.skipped, s.diverged), (2, 2, 0));
        assert_eq!(s.joints[0].q.unwrap().count, 198);

        let exploding = [1.0, 0.0, -60.0, 0.0, 0.0];
        let s = &table(&d, &exploding, Horizon::Seconds(1.0)).experiments[1];
        assert!(s.diverged > 0 && s.windows + s.diverged == 4, "{s:?}");

        let massless = [0.0, 1.0, 0.0, 0.0, 0.0];
        let settings = FreeRunSettings::new(Horizon::Record);
        let e = free_run_table(&Pendulum, &massless, &d, &settings);
        // The first experiment is skipped at once for its missing input; the second meets the matrix.
        let text = e.unwrap_err().to_string();
        assert!(text.contains("`b`") && text.contains("singular"), "{text}");
    }
}
