//! What a check finds: kind, place, evidence, mend.

use std::fmt;

use serde::{Deserialize, Serialize};

/// How sure it is that something must be mended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// Worth knowing; nothing must be done.
    Note,
    /// May be a fault or a property of the robot; look before fitting.
    Doubtful,
    /// The record contradicts the robot or itself; a fit on it means nothing.
    Wrong,
}

/// Which columns of a joint a fault is in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Channel {
    /// Time.
    Time,
    /// Positions, `q`.
    Position,
    /// Velocities, `dq`.
    Velocity,
    /// Positions and velocities together.
    Motion,
    /// Inputs, `u`.
    Input,
    /// All columns of the joint.
    All,
}

impl Channel {
    /// The word of the columns: `q`, `dq`, `q, dq`, `u`, `t`.
    pub fn columns(self) -> &'static str {
        match self {
            Channel::Time => "t",
            Channel::Position => "q",
            Channel::Velocity => "dq",
            Channel::Motion => "q and dq",
            Channel::Input => "u",
            Channel::All => "q, dq and u",
        }
    }

    /// The word for people.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Channel::Time => "time",
            Channel::Position => "position",
            Channel::Velocity => "velocity",
            Channel::Motion => "motion",
            Channel::Input => "input",
            Channel::All => "joint",
        }
    }
}

/// What was found, with the values that a mend needs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum FindingKind {
    /// The data set does not fit the robot, or the robot cannot be derived; nothing else was compared with it.
    NotComparable,
    /// An input is zero throughout.
    ZeroInput,
    /// A channel has one value throughout a record while the joint moves or is driven.
    DeadChannel,
    /// A channel stands still for a stretch in which the joint moves.
    FrozenChannel,
    /// Two channels hold the same values.
    DuplicateChannels,
    /// A channel sits at its bound.
    Saturated {
        /// The bound, in the unit of the column.
        level: f64,
    },
    /// Single readings far off their neighbours.
    Outliers {
        /// How many.
        count: usize,
    },
    /// Empty cells.
    MissingSamples {
        /// How many.
        count: usize,
    },
    /// An angle jumps by whole turns.
    Wrapped {
        /// The turn, in the unit of the column.
        turn: f64,
        /// How many jumps.
        jumps: usize,
    },
    /// A position jumps between two rows, by no whole turn, and stays.
    Jump {
        /// How many jumps.
        count: usize,
    },
    /// Rows whose time does not increase.
    DuplicateStamps {
        /// How many.
        count: usize,
    },
    /// Steps of time of more than one period.
    LostRows {
        /// Rows that are missing.
        count: usize,
    },
    /// Steps of time that vary.
    Jitter {
        /// Standard deviation over the mean step.
        share: f64,
    },
    /// Time is not in seconds.
    TimeUnit {
        /// Seconds per unit of the column.
        factor: f64,
    },
    /// The median step is not the one stated.
    SampleTimeStated {
        /// Median step, s.
        found: f64,
        /// Step stated, s.
        stated: f64,
    },
    /// The inputs are stamped later than the motion (negative: earlier).
    InputClock {
        /// Inputs are late by this, s.
        late: f64,
    },
    /// The rate is too low.
    RateLow {
        /// Samples per second.
        rate: f64,
        /// Rate that is asked for.
        needed: f64,
    },
    /// Columns stand in the wrong order.
    Swapped {
        /// Which columns.
        channel: Channel,
        /// Place `j` of the mended record holds column `order[j]` of the record; joints from 1.
        order: Vec<usize>,
    },
    /// Columns have the wrong sign.
    SignFlipped {
        /// Which columns.
        channel: Channel,
        /// Whether flipping another channel of the joint explains the record as well.
        or_other: bool,
    },
    /// Columns are in another unit.
    Unit {
        /// Which columns.
        channel: Channel,
        /// Factor that brings the columns to SI units.
        factor: f64,
        /// Name of the unit.
        unit: String,
    },
    /// A velocity is not the slope of its position.
    VelocityMismatch {
        /// Velocity over slope.
        slope: f64,
        /// Correlation of both.
        correlation: f64,
    },
    /// Inputs are off by a factor that is no usual unit.
    InputScale {
        /// Input over what the robot needs.
        factor: f64,
    },
    /// Gravity points elsewhere than stated.
    Gravity {
        /// Stated, m/s².
        stated: [f64; 3],
        /// As the record has it, m/s².
        found: [f64; 3],
    },
    /// Torque at rest is not that of gravity.
    RestTorque {
        /// Torque at rest less that of gravity, N·m or N.
        excess: f64,
    },
    /// The torques of the robot and those of the record have little in common, and no fault of the list explains it.
    TorqueUnexplained {
        /// Share of the mean square of the torque that is left, 0 to 1.
        left: f64,
    },
    /// Positions outside of the limits.
    OutsideLimits {
        /// Reached, rad or m.
        reached: [f64; 2],
        /// Limits, rad or m.
        limits: [f64; 2],
    },
    /// Torques far above the stated peak.
    AbovePeak {
        /// Largest torque, N·m or N.
        found: f64,
        /// Stated, N·m or N.
        stated: f64,
    },
    /// Speeds far above the stated scale.
    AboveSpeed {
        /// Largest speed, rad/s or m/s.
        found: f64,
        /// Stated, rad/s or m/s.
        stated: f64,
    },
    /// The joint does not move.
    JointRests,
    /// Parameters that a richer motion would determine and this record does not.
    NotDetermined {
        /// Their names.
        names: Vec<String>,
        /// Combinations determined by the record.
        rank: usize,
        /// Combinations that a rich motion determines.
        possible: usize,
    },
    /// A kind of motion that is missing.
    MotionMissing {
        /// What is missing.
        motion: Missing,
    },
}

/// A kind of motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Missing {
    /// Turning back at low speed: tells dry friction and play.
    SlowReversal,
    /// High speed: tells viscous friction and drag.
    Fast,
    /// A wide range of positions: tells gravity terms, cogging, springs.
    Range,
}

impl FindingKind {
    /// Its name, as in JSON.
    pub fn name(&self) -> &'static str {
        match self {
            Self::NotComparable => "not-comparable",
            Self::ZeroInput => "zero-input",
            Self::DeadChannel => "dead-channel",
            Self::FrozenChannel => "frozen-channel",
            Self::DuplicateChannels => "duplicate-channels",
            Self::Saturated { .. } => "saturated",
            Self::Outliers { .. } => "outliers",
            Self::MissingSamples { .. } => "missing-samples",
            Self::Wrapped { .. } => "wrapped",
            Self::Jump { .. } => "jump",
            Self::DuplicateStamps { .. } => "duplicate-stamps",
            Self::LostRows { .. } => "lost-rows",
            Self::Jitter { .. } => "jitter",
            Self::TimeUnit { .. } => "time-unit",
            Self::SampleTimeStated { .. } => "sample-time-stated",
            Self::InputClock { .. } => "input-clock",
            Self::RateLow { .. } => "rate-low",
            Self::Swapped { .. } => "swapped",
            Self::SignFlipped { .. } => "sign-flipped",
            Self::Unit { .. } => "unit",
            Self::VelocityMismatch { .. } => "velocity-mismatch",
            Self::InputScale { .. } => "input-scale",
            Self::Gravity { .. } => "gravity",
            Self::RestTorque { .. } => "rest-torque",
            Self::TorqueUnexplained { .. } => "torque-unexplained",
            Self::OutsideLimits { .. } => "outside-limits",
            Self::AbovePeak { .. } => "above-peak",
            Self::AboveSpeed { .. } => "above-speed",
            Self::JointRests => "joint-rests",
            Self::NotDetermined { .. } => "not-determined",
            Self::MotionMissing { .. } => "motion-missing",
        }
    }
}

/// A number that supports a finding.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// What it is.
    pub what: String,
    /// Its value.
    pub value: f64,
    /// Its unit; `1` for a pure number.
    pub unit: String,
}

/// One finding.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// What was found.
    #[serde(flatten)]
    pub kind: FindingKind,
    /// How sure it is that something must be mended.
    pub severity: Severity,
    /// Joints it is about, counted from 1 as the columns are; empty: the whole record.
    pub joints: Vec<usize>,
    /// Record it is about; `None`: all.
    pub experiment: Option<String>,
    /// First and last row, counted from 0 after the header; `None`: the whole record.
    pub rows: Option<(usize, usize)>,
    /// Time of these rows, s.
    pub time: Option<(f64, f64)>,
    /// Columns it is about, `u2`; empty: none in particular.
    pub columns: Vec<String>,
    /// Numbers that support it.
    pub evidence: Vec<Evidence>,
    /// What is seen.
    pub sentence: String,
    /// What to do.
    pub mend: String,
}

impl Finding {
    /// A finding about everything, without evidence.
    pub(crate) fn new(
        kind: FindingKind,
        severity: Severity,
        sentence: impl Into<String>,
        mend: impl Into<String>,
    ) -> Self {
        Self {
            kind,
            severity,
            joints: Vec::new(),
            experiment: None,
            rows: None,
            time: None,
            columns: Vec::new(),
            evidence: Vec::new(),
            sentence: sentence.into(),
            mend: mend.into(),
        }
    }

    /// About joints (from 1) and their columns of a stem.
    pub(crate) fn of(mut self, joints: &[usize], channel: Channel) -> Self {
        self.joints = joints.to_vec();
        let stems: &[&str] = match channel {
            Channel::Time => {
                self.columns = vec!["t".to_owned()];
                return self;
            }
            Channel::Position => &["q"],
            Channel::Velocity => &["dq"],
            Channel::Motion => &["q", "dq"],
            Channel::Input => &["u"],
            Channel::All => &["q", "dq", "u"],
        };
        let names = joints
            .iter()
            .flat_map(|j| stems.iter().map(move |stem| format!("{stem}{j}")));
        self.columns = names.collect();
        self
    }

    pub(crate) fn within(mut self, experiment: &str) -> Self {
        self.experiment = Some(experiment.to_owned());
        self
    }

    pub(crate) fn at(mut self, rows: (usize, usize), t: &[f64]) -> Self {
        self.rows = Some(rows);
        self.time = t.get(rows.0).copied().zip(t.get(rows.1).copied());
        self
    }

    pub(crate) fn with(mut self, what: &str, value: f64, unit: &str) -> Self {
        self.evidence.push(Evidence {
            what: what.to_owned(),
            value,
            unit: unit.to_owned(),
        });
        self
    }
}

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Severity::Note => "note",
            Severity::Doubtful => "doubtful",
            Severity::Wrong => "wrong",
        })
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.severity, self.sentence)?;
        let mut place = Vec::new();
        place.extend(
            self.experiment
                .as_ref()
                .map(|name| format!("record `{name}`")),
        );
        place.extend(self.rows.map(|(a, b)| format!("rows {a} to {b}")));
        place.extend(self.time.map(|(a, b)| format!("{a:.3} to {b:.3} s")));
        if !place.is_empty() {
            write!(f, "\n  where: {}", place.join(", "))?;
        }
        if !self.evidence.is_empty() {
            let numbers = self.evidence.iter().map(|e| {
                let unit = if e.unit == "1" {
                    String::new()
                } else {
                    format!(" {}", e.unit)
                };
                format!("{} {}{unit}", e.what, number(e.value))
            });
            write!(
                f,
                "\n  evidence: {}",
                numbers.collect::<Vec<_>>().join("; ")
            )?;
        }
        write!(f, "\n  help: {}", self.mend)
    }
}

/// Four figures, without a tail of zeros.
pub(crate) fn number(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return format!("{x}");
    }
    let digits = (3.0 - x.abs().log10().floor()) as i32;
    match digits {
        0..=8 => {
            let text = format!("{x:.*}", digits as usize);
            match text.contains('.') {
                true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
                false => text,
            }
        }
        -3..0 => format!("{x:.0}"),
        _ => format!("{x:.3e}"),
    }
}

/// `joint 1`, `joints 1 and 2`.
pub(crate) fn joints_text(joints: &[usize]) -> String {
    match joints {
        [] => "no joint".to_owned(),
        [one] => format!("joint {one}"),
        _ => format!("joints {}", list(joints.iter().map(ToString::to_string))),
    }
}

/// `a, b and c`.
pub(crate) fn list(items: impl IntoIterator<Item = String>) -> String {
    let items: Vec<String> = items.into_iter().collect();
    match items.split_last() {
        None => String::new(),
        Some((only, [])) => only.clone(),
        Some((last, rest)) => format!("{} and {last}", rest.join(", ")),
    }
}
