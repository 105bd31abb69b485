//! Measured records: motions, inputs, and the role of each record.
//!
//! A data set is a folder with one `dataset.toml` (who measured what, on which joints) and one CSV
//! file per experiment; `docs/data-format.md` describes it column by column. Everything is in SI
//! units; angles are in radians.
//!
//! ```text
//! t, q1 … qn [, dq1 … dqn], u1 … un [, tau1 … taun] [, qref1 … qrefn]
//! ```
//!
//! Samples are stored row by row: channel `j` of sample `i` is `q[i * nq + j]`. An empty cell is a
//! missing sample: it is stored as NaN and counted in [`Experiment::missing`], and every user of
//! the data says how it treats it. A NaN or an infinity *written* in a file is an error.
//!
//! ```
//! use pid_data::{Dataset, Horizon, windows};
//!
//! let toml = r#"
//! name = "cart"
//! title = "A cart"
//! source = "made up"
//! license = "CC0-1.0"
//! kind = "simulated"
//! input_hold = "zero-order"
//!
//! [[joint]]
//! name = "x"
//! type = "prismatic"
//! input = "force"
//! input_unit = "N"
//! velocity = "absent"
//!
//! [[experiment]]
//! file = "train.csv"
//! role = "train"
//! "#;
//! let csv = "t,q1,u1\n0,0.0,1\n0.1,0.005,1\n0.2,0.02,1\n";
//! let dataset = Dataset::from_embedded(&[("dataset.toml", toml), ("train.csv", csv)])?;
//! let experiment = &dataset.experiments[0];
//! assert_eq!(experiment.len(), 3);
//! assert_eq!(windows(experiment, Horizon::Samples(1)), [0..2, 1..3]);
//! # Ok::<(), pid_data::DataError>(())
//! ```

mod change;
mod check;
mod difference;
mod error;
mod gain_factors;
mod manifest;
mod read;
pub mod signal;
mod windows;

pub use change::ChangeError;
pub use difference::Difference;
pub use error::{DataError, DataWarning, ModelMismatch};
pub use gain_factors::{GainFactors, GainRule, matches};
pub use windows::{Horizon, ParseHorizonError, windows};

use std::borrow::Cow;
use std::fmt;
use std::ops::Range;

use serde::{Deserialize, Serialize};

/// A data set: what `dataset.toml` says and the records it lists.
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    /// Short name, usually that of the folder.
    pub name: String,
    /// One line for people.
    pub title: String,
    /// Who measured it and where it is published.
    pub source: String,
    /// Licence as the source states it.
    pub license: String,
    /// Measured or simulated.
    pub kind: Kind,
    /// What the inputs do between two samples.
    pub input_hold: InputHold,
    /// Channels of each joint, base to tip.
    pub joints: Vec<JointChannels>,
    /// The records, in the order of `dataset.toml`.
    pub experiments: Vec<Experiment>,
    /// Oddities that do not prevent the use of the data.
    pub warnings: Vec<DataWarning>,
}

impl Dataset {
    /// Number of joints, which is the number of coordinates and of input columns.
    pub fn nq(&self) -> usize {
        self.joints.len()
    }

    /// The experiments with a role.
    pub fn with_role(&self, role: Role) -> impl Iterator<Item = &Experiment> {
        self.experiments.iter().filter(move |e| e.role == role)
    }
}

/// Whether a data set comes from hardware.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Measured on hardware.
    Real,
    /// Made by a simulator.
    Simulated,
}

/// What the inputs do between two samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum InputHold {
    /// u(t) = u_i for t_i ≤ t < t_{i+1}: a sampled controller.
    #[default]
    ZeroOrder,
    /// u(t) runs straight from u_i to u_{i+1}: an input that was itself measured.
    Linear,
}

impl InputHold {
    /// The input at the fraction `s` in 0..=1 of an interval that starts with `u0` and ends with `u1`.
    pub fn at(self, u0: &[f64], u1: &[f64], s: f64, out: &mut [f64]) {
        match self {
            InputHold::ZeroOrder => out.copy_from_slice(u0),
            InputHold::Linear => {
                for ((o, a), b) in out.iter_mut().zip(u0).zip(u1) {
                    *o = a + s * (b - a);
                }
            }
        }
    }
}

/// The channels of one joint.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct JointChannels {
    /// Name of the joint.
    pub name: String,
    /// Whether the position is a length (m) or an angle (rad).
    pub prismatic: bool,
    /// Quantity of the input column.
    pub input: InputQuantity,
    /// Unit of the input column: `N*m`, `N`, `A` or `V`.
    pub input_unit: String,
    /// Where the velocity column comes from.
    pub velocity: VelocityKind,
}

impl JointChannels {
    /// Unit of the position: `m` or `rad`.
    pub fn unit(&self) -> &'static str {
        if self.prismatic { "m" } else { "rad" }
    }
    /// Unit of the velocity: `m/s` or `rad/s`.
    pub fn velocity_unit(&self) -> &'static str {
        if self.prismatic { "m/s" } else { "rad/s" }
    }
    /// Unit of the generalised force: `N` or `N*m`.
    pub fn force_unit(&self) -> &'static str {
        if self.prismatic { "N" } else { "N*m" }
    }
}

/// Physical quantity of an input column.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum InputQuantity {
    /// Torque at the joint, N·m.
    Torque,
    /// Force at the joint, N.
    Force,
    /// Motor current, A.
    Current,
    /// Motor voltage, V.
    Voltage,
    /// Commanded position, rad or m, for models with a controller.
    Position,
}

impl InputQuantity {
    /// The word used in `dataset.toml`.
    pub fn word(self) -> &'static str {
        match self {
            InputQuantity::Torque => "torque",
            InputQuantity::Force => "force",
            InputQuantity::Current => "current",
            InputQuantity::Voltage => "voltage",
            InputQuantity::Position => "position",
        }
    }
    /// The unit the quantity is recorded in; for positions that of a revolute joint.
    pub fn unit(self) -> &'static str {
        match self {
            InputQuantity::Torque => "N*m",
            InputQuantity::Force => "N",
            InputQuantity::Current => "A",
            InputQuantity::Voltage => "V",
            InputQuantity::Position => "rad",
        }
    }
}

/// Where the velocity column comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VelocityKind {
    /// A sensor or the drive's own estimate: a channel of its own.
    Measured,
    /// Computed from the positions by whoever published the data: carries no information of its own.
    Derived,
    /// Not in the record.
    Absent,
}

/// What an experiment may be used for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// To fit on.
    Train,
    /// Never fitted, to judge with.
    Test,
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Role::Train => "train",
            Role::Test => "test",
        })
    }
}

/// One record. Channels are stored row by row: joint `j` of sample `i` is at `i * nq + j`.
#[derive(Debug, Clone, PartialEq)]
pub struct Experiment {
    /// Name: the file name without its extension.
    pub name: String,
    /// What it may be used for.
    pub role: Role,
    /// Remark of `dataset.toml`.
    pub note: String,
    /// Number of joints.
    pub nq: usize,
    /// Time, s, strictly increasing; N.
    pub t: Vec<f64>,
    /// Measured positions, rad or m; N × nq. NaN where missing.
    pub q: Vec<f64>,
    /// Velocities, rad/s or m/s; N × nq. NaN where missing, and for joints whose velocity is
    /// [`VelocityKind::Absent`]; `None` if that is so for all joints.
    pub v: Option<Vec<f64>>,
    /// Inputs, N × [`Self::nu`]: one per joint in [`JointChannels::input_unit`], then those that a
    /// controller within the model takes besides. NaN where missing.
    pub u: Vec<f64>,
    /// Joint torques or forces of a sensor, N·m or N; N × nq.
    pub tau: Option<Vec<f64>>,
    /// Commanded positions, rad or m; N × nq.
    pub qref: Option<Vec<f64>>,
    /// Number of empty cells, all channels together.
    pub missing: usize,
    /// By how many times gains of position loops are those of the description.
    pub gain_factors: GainFactors,
}

impl Experiment {
    /// Number of samples N.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Number of inputs: that of the joints in records that were read.
    pub fn nu(&self) -> usize {
        self.u.len() / self.t.len().max(1)
    }

    /// Whether there is no sample; never so for experiments that were read.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// Time between the first and the last sample, s.
    pub fn duration(&self) -> f64 {
        match (self.t.first(), self.t.last()) {
            (Some(a), Some(b)) => b - a,
            _ => 0.0,
        }
    }

    /// Median time step, s; 0 with fewer than two samples.
    pub fn sample_time(&self) -> f64 {
        let mut steps: Vec<f64> = self.t.windows(2).map(|w| w[1] - w[0]).collect();
        if steps.is_empty() {
            return 0.0;
        }
        let middle = steps.len() / 2;
        *steps.select_nth_unstable_by(middle, f64::total_cmp).1
    }

    /// Commanded positions, rad or m; N × nq: where all drives are off and none are recorded, the positions themselves.
    pub fn targets(&self) -> Option<Cow<'_, [f64]>> {
        if let Some(qref) = &self.qref {
            return Some(Cow::Borrowed(qref));
        }
        if !self.is_off() {
            return None;
        }
        let mut out = self.q.clone();
        for j in 0..self.nq {
            let mut own: Vec<f64> = self.q.iter().skip(j).step_by(self.nq).copied().collect();
            signal::fill_missing(&self.t, &mut own);
            let places = out.iter_mut().skip(j).step_by(self.nq);
            places.zip(own).for_each(|(place, q)| *place = q);
        }
        Some(Cow::Owned(out))
    }

    /// Whether [`Experiment::targets`] has any.
    pub fn has_targets(&self) -> bool {
        self.qref.is_some() || self.is_off()
    }

    /// Whether all drives are off.
    pub fn is_off(&self) -> bool {
        (0..self.nq).all(|j| self.gain_factors.is_off(j))
    }

    /// The samples of a range, borrowed. Panics if the range reaches beyond the record.
    pub fn window(&self, range: Range<usize>) -> Window<'_> {
        let (start, end, nu) = (range.start, range.end, self.nu());
        let wide = start * self.nq..end * self.nq;
        Window {
            start: range.start,
            nq: self.nq,
            t: &self.t[range],
            q: &self.q[wide.clone()],
            v: self.v.as_deref().map(|v| &v[wide.clone()]),
            u: &self.u[start * nu..end * nu],
            tau: self.tau.as_deref().map(|x| &x[wide.clone()]),
            qref: self.qref.as_deref().map(|x| &x[wide.clone()]),
        }
    }
}

/// A stretch of an [`Experiment`]; shapes as there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window<'a> {
    /// Index of its first sample in the record.
    pub start: usize,
    /// Number of joints.
    pub nq: usize,
    /// Time, s.
    pub t: &'a [f64],
    /// Positions, rad or m.
    pub q: &'a [f64],
    /// Velocities, rad/s or m/s.
    pub v: Option<&'a [f64]>,
    /// Inputs.
    pub u: &'a [f64],
    /// Measured joint torques or forces.
    pub tau: Option<&'a [f64]>,
    /// Commanded positions.
    pub qref: Option<&'a [f64]>,
}

impl Window<'_> {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }
}
