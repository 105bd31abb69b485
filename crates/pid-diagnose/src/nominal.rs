//! What is known of the robot before looking at the data, as the simulation takes it: a tree of joints, each with its drive.
//!
//! The description itself is [`pid_interpret::nominal`]'s; this module reads its values off, joint by joint.

use std::path::Path;

use pid_derive::model::{Expr, JointKind};
use pid_interpret::nominal::{self as description, Role, Velocity};
use pid_runtime::dynamics::Dynamics;

pub use pid_interpret::nominal::EncoderSide;

use crate::plant::{COULOMB, GAIN, PER_JOINT, VISCOUS};
use crate::rigid::{Hinge, M3};

/// A nominal description that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NominalError {
    /// It cannot be read.
    #[error(transparent)]
    Description(#[from] description::NominalError),
    /// Records and description disagree.
    #[error(
        "nominal.toml describes {nominal} joints, dataset.toml {data}; give both the same joints, base to tip"
    )]
    Joints {
        /// Number in nominal.toml.
        nominal: usize,
        /// Number in dataset.toml.
        data: usize,
    },
}

/// One joint, the link it moves and its drive.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Name.
    pub name: String,
    /// Geometry.
    pub hinge: Hinge,
    /// Nominal values in the order of [`plant::NAMES`](crate::plant::NAMES), SI.
    pub values: [f64; PER_JOINT],
    /// The real values lie within nominal ± these.
    pub half_widths: [f64; PER_JOINT],
    /// Range of the coordinate, rad or m.
    pub limits: Option<(f64, f64)>,
    /// Step of the encoder, rad or m.
    pub resolution: Option<f64>,
    /// Standard deviation of a position reading, rad or m.
    pub position_noise: Option<f64>,
    /// Standard deviation of a measured velocity, rad/s or m/s.
    pub velocity_noise: Option<f64>,
    /// Standard deviation of the applied input, per sample, in its unit.
    pub input_noise: Option<f64>,
    /// Typical largest torque or force.
    pub torque_peak: Option<f64>,
}

impl Joint {
    /// Torque or force per unit of input.
    pub fn gain(&self) -> f64 {
        self.values[GAIN]
    }
    /// Mass of the link, kg.
    pub fn mass(&self) -> f64 {
        self.values[0]
    }
}

/// The nominal robot with its tolerances and what is said of the measurement.
#[derive(Debug, Clone, PartialEq)]
pub struct Nominal {
    /// Name.
    pub name: String,
    /// Acceleration of gravity in base axes, m/s².
    pub gravity: [f64; 3],
    /// Tool point in the last link's frame, m.
    pub tool: [f64; 3],
    /// Side of the encoders.
    pub encoder_side: EncoderSide,
    /// Corner of the filter behind a derived velocity, Hz.
    pub velocity_filter_hz: Option<f64>,
    /// Free-run window, s; the whole record if absent.
    pub horizon: Option<f64>,
    /// Joints, base to tip.
    pub joints: Vec<Joint>,
    /// The description it was read from.
    pub description: description::Nominal,
}

/// Place of a role among the values of a joint; `None` for what is no value of the robot.
pub(crate) fn place(role: Role) -> Option<usize> {
    match role {
        Role::Mass => Some(0),
        Role::CenterOfMass(k) => Some(1 + k),
        Role::Inertia(k) => Some(4 + k),
        Role::RotorInertia => Some(10),
        Role::Gain => Some(GAIN),
        Role::Coulomb => Some(COULOMB),
        Role::Viscous => Some(VISCOUS),
        _ => None,
    }
}

/// A description states numbers where the language of robots allows expressions.
fn number(x: &Expr) -> f64 {
    match x {
        Expr::Num(x) => *x,
        _ => f64::NAN,
    }
}

impl Nominal {
    /// Reads `nominal.toml` of a folder.
    ///
    /// # Errors
    /// If it is absent, malformed, or holds values that cannot be meant.
    pub fn read(folder: &Path) -> Result<Self, NominalError> {
        Self::read_file(&folder.join("nominal.toml"))
    }

    /// Reads a description.
    ///
    /// # Errors
    /// As [`Nominal::read`].
    pub fn read_file(path: &Path) -> Result<Self, NominalError> {
        Ok(Self::new(description::Nominal::read(path)?))
    }

    /// Of a declared robot: nominal values and tolerances are those of its parameters. What is known of the measurement may stand in a
    /// `measurement.toml` of the folder of the records, if there is one.
    ///
    /// # Errors
    /// As [`description::Nominal::of_declared`].
    pub fn of_declared(model: &dyn Dynamics, folder: Option<&Path>) -> Result<Self, NominalError> {
        let measurement = folder.map(|folder| folder.join("measurement.toml"));
        Ok(Self::new(description::Nominal::of_declared(
            model,
            measurement.as_deref(),
        )?))
    }

    /// From the text of the file; `path` is for messages.
    ///
    /// # Errors
    /// As [`Nominal::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, NominalError> {
        Ok(Self::new(description::Nominal::parse(path, text)?))
    }

    /// From a description.
    pub fn new(description: description::Nominal) -> Self {
        let robot = description.robot();
        let measurement = description.measurement();
        let mut joints = Vec::with_capacity(robot.joints.len());
        let mut velocity_filter_hz = None;
        for (k, (joint, channel)) in robot.joints.iter().zip(&measurement.channels).enumerate() {
            let (revolute, axis) = match joint.kind {
                JointKind::Prismatic(axis) => (false, axis),
                JointKind::Revolute(axis) => (true, axis),
                // A description has no other kinds.
                _ => (true, [f64::NAN; 3]),
            };
            let velocity_noise = match channel.velocity {
                Velocity::Measured { noise } => noise,
                Velocity::Derived { filter_hz } => {
                    velocity_filter_hz = velocity_filter_hz.or(filter_hz);
                    None
                }
                Velocity::Absent => None,
            };
            let mut values = [0.0; PER_JOINT];
            let mut half_widths = [0.0; PER_JOINT];
            for t in description.tolerances().iter().filter(|t| t.joint == k) {
                if let Some(i) = place(t.role) {
                    (values[i], half_widths[i]) = (t.nominal, t.half_width);
                }
            }
            joints.push(Joint {
                name: joint.name.clone(),
                hinge: Hinge {
                    parent: joint.parent,
                    revolute,
                    axis,
                    origin: [0, 1, 2].map(|i| number(&joint.origin[i])),
                    rotation: rpy([0, 1, 2].map(|i| number(&joint.rpy[i]))),
                },
                values,
                half_widths,
                limits: joint.limits,
                resolution: channel.position_resolution,
                position_noise: channel.position_std(),
                velocity_noise,
                input_noise: channel.input_noise,
                torque_peak: channel.torque_peak,
            });
        }
        Nominal {
            name: robot.name.clone(),
            gravity: [0, 1, 2].map(|i| number(&robot.gravity[i])),
            tool: measurement.tool.unwrap_or([0.0; 3]),
            encoder_side: measurement.encoder_side,
            velocity_filter_hz,
            horizon: measurement.horizon,
            joints,
            description,
        }
    }

    /// Number of joints.
    pub fn n(&self) -> usize {
        self.joints.len()
    }

    /// Geometry of the links.
    pub fn hinges(&self) -> Vec<Hinge> {
        self.joints.iter().map(|j| j.hinge.clone()).collect()
    }
}

/// Rotation `Rz(yaw) Ry(pitch) Rx(roll)`.
fn rpy([r, p, y]: [f64; 3]) -> M3<f64> {
    let ((sr, cr), (sp, cp), (sy, cy)) = (r.sin_cos(), p.sin_cos(), y.sin_cos());
    [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
}
