//! Records made ready, with noise levels and typical sizes. The module `prepare` makes them so.

use pid_data::{GainFactors, Role, signal};
use pid_interpret::nominal::{Gain, Role as Part};

pub use crate::case_error::CaseError;
use crate::drives::{Gains, slopes};
use crate::effect::{Parameter, Term, Unit};
use crate::hypothesis::{Hypothesis, Run};
use crate::known::Known;
use crate::nominal::Nominal;
pub use crate::outlier::{Channel, Outlier};

/// A stage of a loop that is not stated, where the law of the loop with it explains the motion best.
#[derive(Debug, Clone)]
pub(crate) struct Staged {
    /// Its joint.
    pub joint: usize,
    /// Which stage.
    pub stage: Gain,
    /// Its number, SI.
    pub value: f64,
    /// Gains of the loop beside it, by their places among the values of the robot.
    pub gains: Vec<(usize, f64)>,
}

/// How the velocity of a joint is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Velocity {
    /// A channel of its own.
    Measured,
    /// Computed from the positions.
    Derived,
    /// Not recorded.
    Absent,
}

/// One record, channel by channel: `q[j][k]` is joint j at sample k.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// Name.
    pub name: String,
    /// Role.
    pub role: Role,
    /// Sample time, s.
    pub h: f64,
    /// Whether the stamps had unequal steps: the clock that wrote them need not be that of the loop.
    pub uneven: bool,
    /// Time of the first sample since the start of what was recorded, s; zero unless it is a part
    /// of a record.
    pub begin: f64,
    /// Readings of the positions; NaN where missing.
    pub q: Vec<Vec<f64>>,
    /// Readings of the velocities; NaN where missing.
    pub v: Vec<Vec<f64>>,
    /// Inputs; targets where the drive has a position loop.
    pub u: Vec<Vec<f64>>,
    /// Positions through a zero-phase filter of 30 Hz.
    pub smooth_q: Vec<Vec<f64>>,
    /// Their derivative.
    pub smooth_v: Vec<Vec<f64>>,
    /// Velocities at the first sample; zero where readings show none.
    pub first_v: Vec<f64>,
    /// By how many times gains of position loops are those of the description.
    pub gain_factors: GainFactors,
    /// Of a part of a record: standard deviations of the position and velocity readings of every joint of the
    /// whole.
    pub whole: Option<Vec<(f64, f64)>>,
}

impl Record {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.u[0].len()
    }
    /// Whether it is empty; never so after reading.
    pub fn is_empty(&self) -> bool {
        self.u[0].is_empty()
    }
    /// Accelerations of all joints by central differences of the filtered velocities.
    pub(crate) fn accelerations(&self) -> Vec<Vec<f64>> {
        let t: Vec<f64> = (0..self.len()).map(|k| k as f64 * self.h).collect();
        let of = |v: &Vec<f64>| signal::central_differences(&t, v);
        self.smooth_v.iter().map(of).collect()
    }
}

/// Corner of the filter behind the states that windows start from, Hz.
const START_HZ: f64 = 30.0;

/// Positions at equal times through a zero-phase filter, and their derivative.
pub(crate) fn smoothed(t: &[f64], mut q: Vec<f64>) -> (Vec<f64>, Vec<f64>) {
    let rate = 1.0 / (t[1] - t[0]);
    if let Ok(filter) = signal::Butterworth::low_pass(3, START_HZ.min(0.4 * rate), rate) {
        q = filter.both_ways(&q);
    }
    let v = signal::central_differences(t, &q);
    (q, v)
}

/// Typical sizes of one joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Scale {
    /// Torque or force.
    pub torque: f64,
    /// Input.
    pub input: f64,
    /// Largest speed.
    pub speed: f64,
    /// Range of the motion.
    pub range: f64,
    /// Inertia seen by the joint, the others free, in the middle of the motion.
    pub inertia: f64,
}

/// Noise of one joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    /// Standard deviation of a position reading.
    pub q: f64,
    /// Of a measured velocity.
    pub v: f64,
    /// Of the applied torque, white from sample to sample.
    pub torque: f64,
    /// Of what the drive noise of the other joints does to this one through the mass matrix, as a
    /// torque at it.
    pub passed: f64,
    /// Whether the torque noise was stated.
    pub stated: bool,
}

/// Everything a diagnosis starts from.
#[derive(Debug, Clone)]
pub struct Case {
    /// Name of the data set.
    pub name: String,
    /// The nominal robot.
    pub nominal: Nominal,
    /// Records.
    pub records: Vec<Record>,
    /// Straight lines between inputs.
    pub linear_hold: bool,
    /// How velocities are read.
    pub velocity: Vec<Velocity>,
    /// Typical sizes.
    pub scale: Vec<Scale>,
    /// Noise levels.
    pub noise: Vec<Noise>,
    /// Typical force on the tool and mass of the last link.
    pub tip: (f64, f64),
    /// Torque at joint j that accelerates it as a unit torque at joint i does,
    /// `(M⁻¹)_ji / (M⁻¹)_jj`: root mean square over the motion, zero for i = j.
    pub passing: Vec<Vec<f64>>,
    /// Effects that the description states: part of every hypothesis, their parameters held.
    pub known: Known,
    /// Readings that were taken for errors of the recording and left out.
    pub outliers: Vec<Outlier>,
    /// Where effects that are stages of position loops start, as the laws fit the motion.
    pub(crate) staged: Vec<Staged>,
    /// What is odd about position loops.
    pub loop_warnings: Vec<String>,
    /// Time constant of the filter that all measured velocities share, s; zero unless the readings of
    /// two joints or more show it.
    pub shared_lag: f64,
    /// Part of the horizon over which slow predictions look ahead (see the module `levels`).
    pub ahead: f64,
}

impl Case {
    /// How a hypothesis is run: at least as the effects that are known are.
    pub fn run(&self, hypothesis: &Hypothesis) -> Run {
        hypothesis.run.beside(self.known.hypothesis.run)
    }

    /// Number of joints.
    pub fn n(&self) -> usize {
        self.nominal.n()
    }

    /// Brings [`Noise::passed`] in line with the drive noise of all joints.
    pub fn pass_on(&mut self) {
        for j in 0..self.n() {
            let sum: f64 = self.passing[j]
                .iter()
                .zip(&self.noise)
                .map(|(share, noise)| (share * noise.torque).powi(2))
                .sum();
            self.noise[j].passed = sum.sqrt();
        }
    }

    /// Torque or force per unit of the input of a joint in a record: of its target where the drive has a
    /// position loop. Zero where the drive is off.
    pub fn force_per_input(&self, record: &Record, joint: usize) -> f64 {
        if record.gain_factors.is_off(joint) {
            return 0.0;
        }
        let servo = self.nominal.description.servo(joint);
        let per_input = servo.map_or(1.0, |servo| {
            let value = |i: usize| self.nominal.values[i].nominal;
            let place = |gain| self.nominal.place(joint, Part::Servo(gain));
            let mut k = Gains::of(|gain| place(gain).map(value));
            k.times(|gain| record.gain_factors.at(gain as usize, joint));
            slopes(servo.law, &k)[0]
        });
        self.nominal.gain(joint) * per_input
    }

    /// Median over the records of the factor of a gain at a joint, those aside in which it is none.
    pub(crate) fn usual_factor(&self, gain: Gain, joint: usize) -> f64 {
        let own = self.records.iter().map(|r| &r.gain_factors);
        let own = own.filter(|own| !own.is_off(joint));
        let own = own.map(|own| own.at(gain as usize, joint));
        let mut all: Vec<f64> = own.filter(|x| *x > 0.0).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied().unwrap_or(1.0)
    }

    /// The starts of a term's parameters, SI.
    pub(crate) fn starts(&self, term: &Term) -> Vec<Vec<f64>> {
        let info = term.effect.info();
        let unit = |p: &Parameter| self.unit(p.unit, term.joint);
        let scaled = |start: &&[f64]| {
            let each = start.iter().zip(info.parameters);
            each.map(|(x, p)| x * unit(p)).collect()
        };
        info.starts.iter().map(scaled).collect()
    }

    /// Size of a unit at a joint, in SI.
    pub fn unit(&self, unit: Unit, joint: usize) -> f64 {
        let s = &self.scale[joint];
        match unit {
            Unit::One | Unit::Share | Unit::Angle | Unit::Time => 1.0,
            Unit::Torque => s.torque,
            Unit::Input => s.input,
            Unit::Speed => s.speed,
            Unit::Acceleration => s.speed * s.speed / s.range,
            Unit::Range => s.range,
            Unit::Inertia => s.inertia,
            Unit::Stiffness => s.torque / s.range,
            Unit::Damping => s.torque / s.speed,
            Unit::Drag => s.torque / (s.speed * s.speed),
            Unit::Wave => 1.0 / s.range,
            Unit::Compliance => s.range / s.torque,
            Unit::InverseInput => 1.0 / s.input,
            Unit::InverseSquareInput => 1.0 / (s.input * s.input),
            Unit::Ratio => joint
                .checked_sub(1)
                .map_or(1.0, |i| s.range / self.scale[i].range),
            Unit::Mass => self.tip.1,
            Unit::Force => self.tip.0,
        }
    }
}
