//! Prior knowledge of a robot: structure, nominal values with their tolerances, and how it is
//! measured. A file `nominal.toml` states it; `docs/nominal-format.md` describes the format. For a
//! robot declared with `robot!` it is read off the declaration ([`Nominal::of_declared`]), for one that
//! a robot file describes off its mechanism, with tolerances by class ([`Nominal::of_mechanism`]).
//!
//! The nominal structure is, per joint,
//!
//! ```text
//! gain·u = (M(q) a + b(q, v))_j + rotor·a_j + coulomb·tanh(sharp·v_j) + viscous·v_j
//! ```
//!
//! with M and b of the tree of links. Parameters of each link are mass, centre of mass and inertia
//! about the centre of mass, since tolerances are stated for those. Parameters of each joint are
//! rotor inertia, Coulomb and viscous friction, gain, and the sharpness of the transition at rest,
//! which is held.
//!
//! A declared robot may be more than that: joints that follow others, drives on several joints, a
//! potential, a Lagrangian. Its parameters are then the declared ones, beside those of the drives.
//!
//! - [`Nominal::robot`]: the structure, ready for [`Model`](crate::Model), ranges as the tolerances say;
//! - [`Nominal::tolerances`]: kind and tolerance of each parameter;
//! - [`Nominal::measurement`]: noise, resolution, how velocities are read, drive noise.

mod assemble;
mod build;
mod declared;
mod drives;
mod error;
mod file;
mod general;
mod law;
mod measured;
mod mechanism;
mod provenance;
mod servo;
mod source;
mod stated;
mod write;

use std::fs;
use std::path::{Path, PathBuf};

use pid_derive::model::Robot;

pub use declared::declaration;
pub use drives::Drives;
pub use error::{DeclaredError, NominalError};
pub use mechanism::Described;
pub use provenance::{Provenance, Shares};
pub use servo::{DriveModel, FallingLimit, Gain, Servo, ServoGain, ServoLaw, Shaping};
pub use stated::{Effect, EffectParameter, Fault, Simulated, SimulatedJoint, Written};

/// A nominal description.
#[derive(Debug, Clone, PartialEq)]
pub struct Nominal {
    robot: Robot,
    tolerances: Vec<Tolerance>,
    measurement: Measurement,
    effects: Vec<Effect>,
    simulated: Option<Simulated>,
    file: PathBuf,
    tool_link: Option<usize>,
    drives: Option<Drives>,
    /// Position loops, one per coordinate or none at all.
    servos: Vec<Option<Servo>>,
    /// What the feed-forward of the drives knows, where that is not what is stated of the joints.
    drive_models: Vec<Option<DriveModel>>,
}

/// Ranges of the parameters of a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Ranges {
    /// Nominal value ± tolerance; where that leaves nothing free the parameter is fixed. Masses,
    /// rotor inertias, friction and gains stay on their side of zero.
    #[default]
    Tolerance,
    /// Only the limits of physics: positive masses, rotor inertias and friction that are not
    /// negative, gains of the sign of the nominal one. Parameters that are exact (zero tolerance)
    /// stay fixed.
    Physical,
}

/// Kind and tolerance of a parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Tolerance {
    /// Name of the parameter, as in the robot and in the same place.
    pub name: String,
    /// Index of the joint (and of the link it carries), base to tip; `None` for a declared
    /// parameter of the whole mechanism.
    pub joint: Option<usize>,
    /// Its kind.
    pub role: Role,
    /// Nominal value, SI.
    pub nominal: f64,
    /// The real value lies within nominal ± this; 0 if the value is exact.
    pub half_width: f64,
}

/// Kind of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Role {
    /// Mass of the link.
    Mass,
    /// Component (0, 1, 2) of the centre of mass in the link's frame.
    CenterOfMass(usize),
    /// Entry of the inertia about the centre of mass, in the order xx, yy, zz, xy, xz, yz.
    Inertia(usize),
    /// Rotor inertia or mass at the joint.
    RotorInertia,
    /// Coulomb friction.
    Coulomb,
    /// Viscous friction.
    Viscous,
    /// Force or torque at the joint per unit of the input.
    Gain,
    /// Sharpness of the transition of Coulomb friction at rest: no property of the robot, always
    /// held.
    Sharpness,
    /// A parameter of the mechanism as it is declared, whatever it is.
    Declared,
    /// A gain of the drive's position loop; not among [`Nominal::tolerances`] but in [`Nominal::servo`].
    Servo(Gain),
}

/// How the records were measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Measurement {
    /// One per joint, base to tip.
    pub channels: Vec<Channel>,
    /// Length of the windows of free simulation by which the gap is judged, s.
    pub horizon: Option<f64>,
    /// Where the encoders sit.
    pub encoder_side: EncoderSide,
    /// A point in the frame of the last link where a payload would sit, m.
    pub tool: Option<[f64; 3]>,
}

/// Side of the gear on which the encoder sits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EncoderSide {
    /// Before the gear.
    Motor,
    /// After the gear.
    Joint,
}

/// How a joint is measured and driven.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Name of the joint.
    pub name: String,
    /// Standard deviation of the position noise, rad or m; `None` if it is not stated.
    pub position_noise: Option<f64>,
    /// Step of the encoder, rad or m; `None` if it is not stated.
    pub position_resolution: Option<f64>,
    /// How the velocity is read.
    pub velocity: Velocity,
    /// Standard deviation, per sample, of the noise of the applied input, in the unit of the input;
    /// `None` if it is not stated.
    pub input_noise: Option<f64>,
    /// Typical largest torque or force at the joint.
    pub torque_peak: Option<f64>,
    /// Typical velocity.
    pub speed_scale: Option<f64>,
}

impl Channel {
    /// Standard deviation of a position reading: noise and rounding to the encoder's step `δ`,
    /// whose variance is `δ²/12`; `None` if the noise is not stated.
    pub fn position_std(&self) -> Option<f64> {
        let step = self.position_resolution.unwrap_or(0.0);
        Some(self.position_noise?.hypot(step / 12f64.sqrt()))
    }
}

/// How a velocity is read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Velocity {
    /// By a sensor of its own.
    Measured {
        /// Standard deviation of its noise, rad/s or m/s; `None` if it is not stated.
        noise: Option<f64>,
    },
    /// From the read positions, `w_k = c w_{k−1} + (1 − c)(q_k − q_{k−1})/h` with `c = exp(−2π f h)`.
    Derived {
        /// Corner frequency f of the filter, Hz; without one the difference quotient itself.
        filter_hz: Option<f64>,
    },
    /// Not at all.
    Absent,
}

impl Nominal {
    /// Reads a file.
    ///
    /// # Errors
    /// If it cannot be read, is not of the format, or states values that no robot can have: file,
    /// line, key, value, mend.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, NominalError> {
        let path = path.as_ref();
        let text = fs::read_to_string(path).map_err(|error| NominalError::Unreadable {
            file: path.to_owned(),
            error,
        })?;
        Self::parse(path, &text)
    }

    /// Reads a text; `file` is its name in messages.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn parse(file: impl AsRef<Path>, text: &str) -> Result<Self, NominalError> {
        build::nominal(&source::Source {
            file: file.as_ref(),
            text,
        })
    }

    /// The nominal structure, parameters ranging within their tolerances.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// The nominal structure with other ranges.
    pub fn robot_with(&self, ranges: Ranges) -> Robot {
        let mut robot = self.robot.clone();
        for (param, tolerance) in robot.params.iter_mut().zip(&self.tolerances) {
            let (lower, upper) = tolerance.range(ranges);
            (param.lower, param.upper) = (lower, upper);
        }
        robot
    }

    /// Kind and tolerance of each parameter, in the order of the robot's parameters.
    pub fn tolerances(&self) -> &[Tolerance] {
        &self.tolerances
    }

    /// The link that carries the tool: the one that the last joint with a coordinate carries, none
    /// of a bare Lagrangian.
    pub fn tool_link(&self) -> Option<usize> {
        self.tool_link
    }

    /// Coordinates of the description where they are those of drives on several joints, not of the joints.
    pub fn drives(&self) -> Option<&Drives> {
        self.drives.as_ref()
    }

    /// The position loop of the drive of a coordinate, if its input is a target position.
    pub fn servo(&self, joint: usize) -> Option<&Servo> {
        self.servos.get(joint)?.as_ref()
    }

    /// Whether any drive has a position loop.
    pub fn has_servos(&self) -> bool {
        self.servos.iter().any(Option::is_some)
    }

    /// Position loops of the drives, one per coordinate or none at all.
    pub fn servos(&self) -> &[Option<Servo>] {
        &self.servos
    }

    /// The same robot with other position loops, one per coordinate or none at all.
    pub fn with_servos(mut self, servos: Vec<Option<Servo>>) -> Self {
        self.servos = servos;
        self
    }

    /// What the feed-forward of the drives knows of a joint; `None`: what is stated of it.
    pub fn drive_model(&self, joint: usize) -> Option<&DriveModel> {
        self.drive_models.get(joint)?.as_ref()
    }

    /// What the feed-forward of the drives knows of all joints, where a drive has one.
    fn known_to_drives(&self) -> Vec<Option<DriveModel>> {
        match self.servos.iter().flatten().any(Servo::has_model) {
            true => self.stated_to_drives(),
            false => self.drive_models.clone(),
        }
    }

    /// What is stated of all joints, as the model of their drives.
    fn stated_to_drives(&self) -> Vec<Option<DriveModel>> {
        let of = |joint: usize| {
            let own = self.drive_model(joint).copied();
            own.unwrap_or_else(|| self.stated_to_drive(joint))
        };
        (0..self.servos.len()).map(of).map(Some).collect()
    }

    /// The same robot whose drives go on with what is stated now, whatever is found of it later.
    pub fn with_drive_models(mut self) -> Self {
        self.drive_models = self.stated_to_drives();
        self
    }

    /// What is stated of a joint, as the model of a drive.
    fn stated_to_drive(&self, joint: usize) -> DriveModel {
        let mut out = DriveModel::default();
        for t in self.tolerances.iter().filter(|t| t.joint == Some(joint)) {
            match t.role {
                Role::Mass => out.mass = t.nominal,
                Role::CenterOfMass(k) => out.com[k] = t.nominal,
                Role::Inertia(k) => out.inertia[k] = t.nominal,
                Role::RotorInertia => out.rotor_inertia = t.nominal,
                Role::Gain => out.motor_gain = t.nominal,
                _ => {}
            }
        }
        out
    }

    /// How the robot is measured.
    pub fn measurement(&self) -> &Measurement {
        &self.measurement
    }

    /// The same robot, its velocities read in another way: a robot file does not say how. One per
    /// joint of the measurement; those beyond stay as they are.
    pub fn with_velocities(mut self, velocities: &[Velocity]) -> Self {
        for (channel, velocity) in self.measurement.channels.iter_mut().zip(velocities) {
            channel.velocity = *velocity;
        }
        self
    }

    /// Effects beside the nominal structure, as a diagnosis named them.
    pub fn effects(&self) -> &[Effect] {
        &self.effects
    }

    /// The same robot with other effects.
    pub fn with_effects(mut self, effects: Vec<Effect>) -> Self {
        self.effects = effects;
        self
    }

    /// How a diagnosis simulated the robot with them.
    pub fn simulated(&self) -> Option<&Simulated> {
        self.simulated.as_ref()
    }

    /// The file it was read from; empty if from none.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// The same robot with other values, in the order of [`Nominal::tolerances`], their half widths
    /// kept, and with effects.
    ///
    /// # Panics
    /// If there are not as many values as parameters.
    pub fn extended(
        &self,
        values: &[f64],
        effects: Vec<Effect>,
        simulated: Option<Simulated>,
    ) -> Self {
        assert_eq!(
            values.len(),
            self.tolerances.len(),
            "one value per parameter"
        );
        let mut out = self.clone();
        for ((tolerance, param), &value) in
            (out.tolerances.iter_mut().zip(&mut out.robot.params)).zip(values)
        {
            tolerance.nominal = value;
            param.nominal = value;
            (param.lower, param.upper) = tolerance.range(Ranges::Tolerance);
        }
        (out.effects, out.simulated) = (effects, simulated);
        // What is found of the robot changes nothing in its drives.
        out.drive_models = self.known_to_drives();
        out
    }

    /// The same robot with other half widths, in the order of [`Nominal::tolerances`].
    ///
    /// # Panics
    /// If there are not as many half widths as parameters.
    pub fn with_half_widths(mut self, half_widths: &[f64]) -> Self {
        assert_eq!(
            half_widths.len(),
            self.tolerances.len(),
            "one half width per parameter"
        );
        for ((tolerance, param), &half_width) in
            (self.tolerances.iter_mut().zip(&mut self.robot.params)).zip(half_widths)
        {
            tolerance.half_width = half_width;
            param.fixed = half_width == 0.0;
            (param.lower, param.upper) = tolerance.range(Ranges::Tolerance);
        }
        self
    }
}

impl Tolerance {
    /// Lower and upper end of the range.
    pub fn range(&self, ranges: Ranges) -> (f64, f64) {
        let (lower, upper) = match self.role {
            _ if self.half_width == 0.0 => return (self.nominal, self.nominal),
            // A body needs a mass; a share of the nominal one keeps the mass matrix regular.
            Role::Mass => (1e-3 * self.nominal, f64::INFINITY),
            Role::RotorInertia | Role::Coulomb | Role::Viscous => (0.0, f64::INFINITY),
            Role::Gain if self.nominal > 0.0 => (1e-3 * self.nominal, f64::INFINITY),
            Role::Gain => (f64::NEG_INFINITY, 1e-3 * self.nominal),
            Role::CenterOfMass(_) | Role::Inertia(_) | Role::Sharpness | Role::Servo(_) => {
                (f64::NEG_INFINITY, f64::INFINITY)
            }
            // What it is, and so what physics demands of it, only its range says.
            Role::Declared => (
                self.nominal - self.half_width,
                self.nominal + self.half_width,
            ),
        };
        match ranges {
            Ranges::Physical => (lower, upper),
            Ranges::Tolerance => (
                lower.max(self.nominal - self.half_width),
                upper.min(self.nominal + self.half_width),
            ),
        }
    }
}
