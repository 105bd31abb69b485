//! The value behind all forms of a report.

use serde::{Deserialize, Serialize};

use pid_data::Role;
use pid_fit::gap::metrics::FreeRunScore;
use pid_nlp::solver::Iteration;

/// Version of the JSON form; raised when a field changes its meaning or disappears.
pub const SCHEMA_VERSION: u32 = 1;

/// Everything that is known at the end of an identification.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// [`SCHEMA_VERSION`] of the writer.
    pub schema_version: u32,
    /// Name and version of the program.
    pub program: String,
    /// Headline.
    pub title: String,
    /// The model.
    pub model: ModelSection,
    /// The data.
    pub data: DataSection,
    /// Settings as name and value.
    pub settings: Vec<Setting>,
    /// How it ended.
    pub outcome: OutcomeSection,
    /// Iterations of the best start.
    pub iterations: Vec<Iteration>,
    /// Parameters, in the model's order.
    pub parameters: Vec<ParameterRow>,
    /// Correlations of the estimates, a pair of parameters each: all pairs that have deviations.
    #[serde(default)]
    pub correlations: Vec<Correlation>,
    /// All starts, if there were several.
    pub starts: Vec<StartRow>,
    /// What was found, in sentences, the most important first.
    pub findings: Vec<String>,
    /// Measured against simulated motion.
    pub motions: Vec<Motion>,
    /// Free-run errors, for each experiment or role and horizon.
    pub free_run: Vec<FreeRunScore>,
    /// The missing generalised force, one per joint.
    pub missing_force: Vec<MissingForce>,
    /// Remarks and warnings.
    pub notes: Vec<String>,
}

/// The model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelSection {
    /// Name of the robot.
    pub name: String,
    /// One or two sentences about it and where its values come from.
    pub source: String,
    /// Number of coordinates.
    pub nq: usize,
    /// Number of inputs.
    pub nu: usize,
    /// Number of parameters.
    pub np: usize,
}

/// The data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DataSection {
    /// Short name.
    pub name: String,
    /// Title.
    pub title: String,
    /// Who measured it.
    pub source: String,
    /// Licence.
    pub license: String,
    /// Measured or simulated.
    pub kind: pid_data::Kind,
    /// What inputs do between samples.
    pub input_hold: pid_data::InputHold,
    /// The joints and their channels.
    pub joints: Vec<pid_data::JointChannels>,
    /// The records.
    pub experiments: Vec<ExperimentRow>,
    /// What looked odd.
    pub warnings: Vec<String>,
}

impl DataSection {
    /// Of a data set.
    pub fn of(dataset: &pid_data::Dataset) -> Self {
        let experiments = dataset
            .experiments
            .iter()
            .map(|e| ExperimentRow {
                name: e.name.clone(),
                role: e.role,
                samples: e.len(),
                duration: e.duration(),
                sample_time: e.sample_time(),
                missing: e.missing,
                note: e.note.clone(),
            })
            .collect();
        DataSection {
            name: dataset.name.clone(),
            title: dataset.title.clone(),
            source: dataset.source.clone(),
            license: dataset.license.clone(),
            kind: dataset.kind,
            input_hold: dataset.input_hold,
            joints: dataset.joints.clone(),
            experiments,
            warnings: dataset.warnings.iter().map(ToString::to_string).collect(),
        }
    }
}

/// One record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ExperimentRow {
    /// Name.
    pub name: String,
    /// What it was used for.
    pub role: Role,
    /// Number of samples.
    pub samples: usize,
    /// Length, s.
    pub duration: f64,
    /// Median step, s.
    pub sample_time: f64,
    /// Empty cells.
    pub missing: usize,
    /// Remark of the data set.
    pub note: String,
}

/// One setting.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Setting {
    /// Name.
    pub name: String,
    /// Value in words.
    pub value: String,
}

impl Setting {
    /// From name and value.
    pub fn new(name: &str, value: impl ToString) -> Self {
        Setting {
            name: name.to_owned(),
            value: value.to_string(),
        }
    }
}

/// How an identification ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OutcomeSection {
    /// Whether the result can be used.
    pub verdict: Verdict,
    /// The status in words.
    pub status: String,
    /// Iterations of the best start, without those before its last solve.
    pub iterations: usize,
    /// Iterations before its last solve: residual fit, lifting, earlier noise levels.
    #[serde(default)]
    pub preparing_iterations: usize,
    /// Its objective; `None` if nothing was minimised.
    pub objective: Option<f64>,
    /// Time of the whole identification, s.
    pub seconds: f64,
    /// Recomputed from the problem itself, not from the solver's claims.
    pub checks: Vec<CheckRow>,
}

impl OutcomeSection {
    /// `12 iterations after 30 that prepared the start`.
    pub(crate) fn iterations_in_words(&self) -> String {
        match self.preparing_iterations {
            0 => format!("{} iterations", self.iterations),
            before => format!(
                "{} iterations after {before} that prepared the start",
                self.iterations
            ),
        }
    }
}

/// Whether a result can be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Converged, and the independent check agrees.
    Good,
    /// Usable with the reservations the report states.
    Fair,
    /// Not to be used.
    Bad,
}

/// One figure of the independent check.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CheckRow {
    /// What was checked.
    pub name: String,
    /// The figure.
    pub value: f64,
    /// The figure it has to stay below.
    pub tolerance: f64,
}

impl CheckRow {
    /// Whether the figure is within its tolerance.
    pub fn passed(&self) -> bool {
        self.value <= self.tolerance
    }
}

/// One parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParameterRow {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// First line of its documentation.
    pub doc: String,
    /// Value at the start.
    pub start: f64,
    /// Identified value.
    pub value: f64,
    /// Standard deviation; `None` if the data do not determine the parameter by itself.
    pub deviation: Option<f64>,
    /// Lower bound, `None` if there is none.
    pub lower: Option<f64>,
    /// Upper bound, `None` if there is none.
    pub upper: Option<f64>,
    /// Which bound the value lies at.
    pub at_bound: Option<Bound>,
    /// Held at its value by the identification.
    pub fixed: bool,
    /// Published or nominal value to compare with.
    pub reference: Option<f64>,
}

/// Correlation of the estimates of two parameters; in JSON `[first, second, value]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Correlation(
    /// Name of the first.
    pub String,
    /// Name of the second.
    pub String,
    /// Its value, −1 to 1.
    pub f64,
);

/// A bound.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Bound {
    /// The lower one.
    Lower,
    /// The upper one.
    Upper,
}

/// One start of several.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StartRow {
    /// Its number, from 0.
    pub index: usize,
    /// Objective reached; `None` if the solver returned no usable point.
    pub objective: Option<f64>,
    /// Iterations.
    pub iterations: usize,
    /// Time, s.
    pub seconds: f64,
    /// Status in words.
    pub status: String,
}

/// Measured and simulated motion of one experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Motion {
    /// The experiment.
    pub experiment: String,
    /// Its role.
    pub role: Role,
    /// How it was simulated, in words: "restarted every 1 s".
    pub how: String,
    /// Per joint.
    pub joints: Vec<MotionJoint>,
}

/// Measured and simulated motion of one joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MotionJoint {
    /// Name of the joint.
    pub joint: String,
    /// Unit of the position.
    pub unit: String,
    /// Unit of the velocity.
    pub velocity_unit: String,
    /// Measured position.
    pub q_measured: Trace,
    /// Simulated position.
    pub q_simulated: Trace,
    /// Measured velocity, where there is one.
    pub v_measured: Option<Trace>,
    /// Simulated velocity.
    pub v_simulated: Trace,
}

/// A curve, reduced to the points that a plot can show. `None` in `y` interrupts it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Trace {
    /// Abscissa, increasing; time in s unless said otherwise.
    pub x: Vec<f64>,
    /// Ordinate.
    pub y: Vec<Option<f64>>,
}

/// The generalised force that the model lacks on one joint: it must act in addition for the model
/// to follow the record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MissingForce {
    /// Name of the joint.
    pub joint: String,
    /// Unit of the force, `N*m` or `N`.
    pub unit: String,
    /// Unit of the position.
    pub position_unit: String,
    /// Unit of the velocity.
    pub velocity_unit: String,
    /// Root mean square, all experiments.
    pub rms: f64,
    /// Root mean square of the total generalised force.
    pub total_rms: f64,
    /// `rms / total_rms`.
    pub share: f64,
    /// Root mean square of the band's half-width, two standard deviations of w, if there is a band.
    pub band_rms: Option<f64>,
    /// Over time, per experiment.
    pub over_time: Vec<ForceTrace>,
    /// A selection of samples (q, v, w).
    pub samples: Vec<[f64; 3]>,
    /// Means over classes of velocity.
    pub by_velocity: Vec<ForceBin>,
    /// Means over classes of position, for either direction of motion.
    pub by_position: Vec<ForceBin>,
}

/// Missing force over time in one experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ForceTrace {
    /// The experiment.
    pub experiment: String,
    /// Its role.
    pub role: Role,
    /// The force.
    pub w: Trace,
    /// The half-width of its band, at the same or fewer abscissae.
    pub band: Option<Trace>,
}

/// Mean of the missing force in a class of samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ForceBin {
    /// Direction of motion of the samples.
    pub direction: Direction,
    /// Mean of the abscissa (velocity or position) in the class.
    pub at: f64,
    /// Mean of the force.
    pub mean: f64,
    /// Standard deviation of the force within the class.
    pub spread: f64,
    /// Samples in the class.
    pub count: usize,
}

/// Direction of motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Direction {
    /// v > 0.
    Forward,
    /// v < 0.
    Backward,
}
