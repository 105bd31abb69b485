//! What is known of the robot before looking at the data, as the simulation takes it: coordinates
//! with a drive each, and mass matrix and bias as programs.
//!
//! The description itself is [`pid_interpret::nominal`]'s. Unknowns are the deviations θ of its
//! parameters in units of their tolerances, `p = p₀ + Δp θ`, in its order; how many there are
//! differs from robot to robot.

use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

use pid_data::Dataset;
use pid_derive::model::Expr;
use pid_interpret::Links;
use pid_interpret::nominal::{self as description, Gain, Role, ServoGain, Velocity};
use pid_runtime::dynamics::Dynamics;

pub use pid_interpret::nominal::EncoderSide;

use crate::scalar::Scalar;

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

/// A parameter of the nominal structure.
#[derive(Debug, Clone, PartialEq)]
pub struct Value {
    /// Its joint, from 0; `None` for a declared parameter of the whole mechanism.
    pub joint: Option<usize>,
    /// What it is.
    pub role: Role,
    /// Nominal value, SI.
    pub nominal: f64,
    /// The real value lies within nominal ± this.
    pub half_width: f64,
    /// Its place among the parameters of the description's robot; `None` for a gain of a position loop.
    param: Option<usize>,
}

/// One coordinate and its drive.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Name.
    pub name: String,
    /// Whether positions are angles, not lengths.
    pub revolute: bool,
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

/// What the feed-forward of the drives knows of a robot, joint by joint.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveKnowledge<D> {
    /// Parameters of the robot.
    pub p: Vec<D>,
    /// Torque or force per unit of the input.
    pub gains: Vec<f64>,
    /// Rotor inertias, kg·m² or kg.
    pub rotors: Vec<f64>,
}

/// The nominal robot with its tolerances and what is said of the measurement.
#[derive(Debug, Clone, PartialEq)]
pub struct Nominal {
    /// Name.
    pub name: String,
    /// Side of the encoders.
    pub encoder_side: EncoderSide,
    /// Corner of the filter behind a derived velocity, Hz.
    pub velocity_filter_hz: Option<f64>,
    /// Free-run window, s; the whole record if absent.
    pub horizon: Option<f64>,
    /// Coordinates, base to tip.
    pub joints: Vec<Joint>,
    /// Parameters, in the order of the deviations θ.
    pub values: Vec<Value>,
    /// Mass matrix and bias.
    pub links: Arc<Links>,
    /// Sum of the distances from joint to joint and on to the tool, m.
    pub reach: f64,
    /// The description it was read from.
    pub description: description::Nominal,
}

/// Name of a role in reports.
pub fn role_name(role: Role) -> &'static str {
    const CENTER: [&str; 3] = ["com_x", "com_y", "com_z"];
    const INERTIA: [&str; 6] = [
        "inertia_xx",
        "inertia_yy",
        "inertia_zz",
        "inertia_xy",
        "inertia_xz",
        "inertia_yz",
    ];
    match role {
        Role::Mass => "mass",
        Role::CenterOfMass(k) => CENTER.get(k).copied().unwrap_or("com"),
        Role::Inertia(k) => INERTIA.get(k).copied().unwrap_or("inertia"),
        Role::RotorInertia => "rotor_inertia",
        Role::Gain => "motor_gain",
        Role::Coulomb => "coulomb",
        Role::Viscous => "viscous",
        Role::Sharpness => "sharpness",
        Role::Servo(gain) => gain.key(),
        _ => "parameter",
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

    /// Of a declared robot: nominal values and tolerances are those of its parameters. What is
    /// known of the measurement may stand in a `measurement.toml` of the folder of the records, if
    /// there is one.
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
        let mut coordinates: Vec<_> = robot.joints.iter().filter(|j| j.coord.is_some()).collect();
        coordinates.sort_by_key(|j| j.coord);
        let mut joints = Vec::with_capacity(coordinates.len());
        let mut velocity_filter_hz = None;
        for (joint, channel) in coordinates.iter().zip(&measurement.channels) {
            let velocity_noise = match channel.velocity {
                Velocity::Measured { noise } => noise,
                Velocity::Derived { filter_hz } => {
                    velocity_filter_hz = velocity_filter_hz.or(filter_hz);
                    None
                }
                Velocity::Absent => None,
            };
            joints.push(Joint {
                name: joint.name.clone(),
                revolute: !joint.kind.is_length(),
                limits: joint.limits,
                resolution: channel.position_resolution,
                position_noise: channel.position_std(),
                velocity_noise,
                input_noise: channel.input_noise,
                torque_peak: channel.torque_peak,
            });
        }
        // How sharp the transition of a smooth friction is does not enter where friction sticks.
        let values = (description.tolerances().iter().enumerate())
            .filter(|(_, t)| t.role != Role::Sharpness)
            .filter(|(_, t)| t.role != Role::Declared || t.half_width > 0.0)
            .map(|(param, t)| Value {
                joint: t.joint,
                role: t.role,
                nominal: t.nominal,
                half_width: t.half_width,
                param: Some(param),
            })
            .chain(servo_gains(&description, joints.len()))
            .collect();
        let tool = measurement.tool.unwrap_or([0.0; 3]);
        let between = robot.joints.iter().skip(1);
        let reach = between
            .map(|j| norm(j.origin.clone().map(|x| number(&x))))
            .sum::<f64>()
            + norm(tool);
        Nominal {
            name: robot.name.clone(),
            encoder_side: measurement.encoder_side,
            velocity_filter_hz,
            horizon: measurement.horizon,
            joints,
            values,
            links: Arc::new(Links::new(
                robot,
                description.tool_link().map(|link| (link, tool)),
            )),
            reach,
            description,
        }
    }

    /// Number of coordinates.
    pub fn n(&self) -> usize {
        self.joints.len()
    }

    /// Number of deviations.
    pub fn size(&self) -> usize {
        self.values.len()
    }

    /// Place among the deviations of what a joint has in a role.
    pub fn place(&self, joint: usize, role: Role) -> Option<usize> {
        (self.values.iter()).position(|v| v.joint == Some(joint) && v.role == role)
    }

    /// Torque or force per unit of input of a joint.
    pub fn gain(&self, joint: usize) -> f64 {
        self.place(joint, Role::Gain)
            .map_or(1.0, |i| self.values[i].nominal)
    }

    /// A gain of the position loop of a joint as the records say where it was stated as unknown: the
    /// value to start from, and how far from it it may lie.
    pub fn begin_servo(&mut self, joint: usize, gain: Gain, start: ServoGain) {
        let place = self.place(joint, Role::Servo(gain));
        if let (Some(place), Some(value)) = (place, start.value) {
            let own = &mut self.values[place];
            (own.nominal, own.half_width) = (value, start.half_width);
        }
    }

    /// The position loops with the gains at deviations; half widths are those stated, of unknown gains those
    /// that they started with.
    pub fn servos(&self, theta: &[f64]) -> Vec<Option<description::Servo>> {
        let of = |joint: usize| {
            let mut servo = self.description.servo(joint)?.clone();
            let gains: Vec<Gain> = servo.gains().collect();
            for gain in gains {
                if let Some(place) = self.place(joint, Role::Servo(gain)) {
                    let (value, stated) = (self.value(place, theta), servo.gain(gain));
                    let half_width = match stated.value {
                        Some(_) => stated.half_width,
                        None => self.values[place].half_width,
                    };
                    servo.set(gain, ServoGain::found(value, half_width));
                }
            }
            Some(servo)
        };
        match self.description.has_servos() {
            true => (0..self.n()).map(of).collect(),
            false => Vec::new(),
        }
    }

    /// What the feed-forward of the drives knows of the robot.
    pub fn known_to_drives<D: Scalar>(&self) -> DriveKnowledge<D> {
        let mut p: Vec<D> = self.parameters(&vec![D::nil(); self.size()]);
        let stated = self.description.tolerances();
        let (mut gains, mut rotors) = (vec![1.0; self.n()], vec![0.0; self.n()]);
        for (i, t) in stated.iter().enumerate() {
            let Some(j) = t.joint.filter(|j| *j < gains.len()) else {
                continue;
            };
            let known = self.description.drive_model(j);
            let of = |known: Option<f64>| known.unwrap_or(t.nominal);
            match t.role {
                Role::Mass => p[i] = D::constant(of(known.map(|k| k.mass))),
                Role::CenterOfMass(k) => p[i] = D::constant(of(known.map(|own| own.com[k]))),
                Role::Inertia(k) => p[i] = D::constant(of(known.map(|own| own.inertia[k]))),
                Role::RotorInertia => rotors[j] = of(known.map(|k| k.rotor_inertia)),
                Role::Gain => gains[j] = of(known.map(|k| k.motor_gain)),
                _ => {}
            }
        }
        DriveKnowledge { p, gains, rotors }
    }

    /// Value of the parameter at a place.
    pub fn value<D: Scalar>(&self, place: usize, theta: &[D]) -> D {
        let v = &self.values[place];
        theta[place] * v.half_width + v.nominal
    }

    /// Parameters of the description's robot at deviations.
    pub fn parameters<D: Scalar>(&self, theta: &[D]) -> Vec<D> {
        let nominal = self.description.tolerances().iter();
        let mut p: Vec<D> = nominal.map(|t| D::constant(t.nominal)).collect();
        for (i, v) in self.values.iter().enumerate() {
            if let Some(param) = v.param {
                p[param] = self.value(i, theta);
            }
        }
        p
    }

    /// The records in the coordinates of the description: those of drives on several joints are
    /// computed from the joints' readings.
    pub fn records<'a>(&self, dataset: &'a Dataset) -> Cow<'a, Dataset> {
        let Some(drives) = self.description.drives() else {
            return Cow::Borrowed(dataset);
        };
        let n = self.n();
        if dataset.nq() != n {
            return Cow::Borrowed(dataset);
        }
        let mut dataset = dataset.clone();
        for e in &mut dataset.experiments {
            for q in e.q.chunks_exact_mut(n) {
                q.copy_from_slice(&drives.positions(q));
            }
            for v in e.v.iter_mut().flat_map(|v| v.chunks_exact_mut(n)) {
                v.copy_from_slice(&drives.velocities(v));
            }
            for q in e.qref.iter_mut().flat_map(|q| q.chunks_exact_mut(n)) {
                q.copy_from_slice(&drives.positions(q));
            }
            // What a sensor of torque shows is that of the joints.
            e.tau = None;
        }
        Cow::Owned(dataset)
    }

    /// Whether a force on a tool or a payload has a body to act on.
    pub fn has_bodies(&self) -> bool {
        self.links.tool().is_some()
    }
}

/// The gains of the position loops; those that are unknown are not finite until
/// [`Nominal::begin_servo`] says where to start.
fn servo_gains(description: &description::Nominal, joints: usize) -> Vec<Value> {
    let loops = (0..joints).filter_map(|j| Some((j, description.servo(j)?)));
    let all = loops.flat_map(|(j, servo)| servo.gains().map(move |g| (j, servo, g)));
    all.map(|(joint, servo, gain)| Value {
        joint: Some(joint),
        role: Role::Servo(gain),
        nominal: servo.gain(gain).value.unwrap_or(f64::NAN),
        half_width: servo.gain(gain).half_width,
        param: None,
    })
    .collect()
}

fn norm(x: [f64; 3]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// A length that is stated as a number; of those that are computed the reach does without.
fn number(x: &Expr) -> f64 {
    match x {
        Expr::Num(x) => *x,
        _ => 0.0,
    }
}
