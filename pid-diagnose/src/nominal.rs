//! `nominal.toml`: what is known of the robot before looking at the data.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::rigid::Hinge;

/// A nominal description that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NominalError {
    /// The file cannot be read.
    #[error(
        "cannot read {path}: {source}; a folder to diagnose holds nominal.toml beside dataset.toml"
    )]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is not what is expected.
    #[error("{path}: {message}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Where and what.
        message: String,
    },
    /// A value is out of range.
    #[error("joint `{joint}`: {key} = {value} must be {must}")]
    Value {
        /// The joint.
        joint: String,
        /// The key.
        key: &'static str,
        /// What was found.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// No joint is described.
    #[error("no [[joint]] in nominal.toml; describe the chain from base to tip")]
    NoJoint,
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

/// Which side of the transmission the encoder sits on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Default)]
#[serde(rename_all = "lowercase")]
pub enum EncoderSide {
    /// On the motor.
    #[default]
    Motor,
    /// On the link.
    Link,
}

/// How far the real values may lie from the nominal ones.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Tolerance {
    /// Share of the mass.
    pub mass_rel: f64,
    /// Each component of the centre of mass, m.
    pub com_abs_m: f64,
    /// Each element of the inertia about the centre of mass, share of its largest principal value.
    pub inertia_rel: f64,
    /// Share of the rotor inertia.
    pub rotor_inertia_rel: f64,
    /// Share of the motor gain.
    pub motor_gain_rel: f64,
    /// Share of Coulomb and viscous friction.
    pub friction_rel: f64,
}

/// One joint and the link it moves, as stated.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Joint {
    /// Name.
    pub name: String,
    /// `revolute` or `prismatic`.
    pub r#type: String,
    /// Axis in the link's frame.
    pub axis: [f64; 3],
    /// Origin of the link's frame in the parent's, m.
    pub origin: [f64; 3],
    /// Fixed roll, pitch, yaw, rad.
    #[serde(default)]
    pub rpy: [f64; 3],
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass, m.
    pub com: [f64; 3],
    /// Inertia about the centre of mass, xx yy zz xy xz yz, kg m².
    pub inertia: [f64; 6],
    /// Rotor inertia at the joint, kg m² (kg for a slide).
    #[serde(default)]
    pub rotor_inertia: f64,
    /// Coulomb friction, N m or N.
    #[serde(default)]
    pub coulomb: f64,
    /// Viscous friction, N m s or N s/m.
    #[serde(default)]
    pub viscous: f64,
    /// Torque or force per unit of input.
    pub motor_gain: f64,
    /// `measured`, `derived` or `absent`; the data set decides if absent here.
    #[serde(default)]
    pub velocity: Option<String>,
    /// Step of the encoder, rad or m.
    #[serde(default)]
    pub q_resolution: Option<f64>,
    /// Standard deviation of a position reading, rad or m.
    #[serde(default)]
    pub q_noise_std: Option<f64>,
    /// Standard deviation of a measured velocity, rad/s or m/s.
    #[serde(default)]
    pub dq_noise_std: Option<f64>,
    /// Typical largest torque or force.
    #[serde(default)]
    pub torque_peak: Option<f64>,
    /// Typical speed.
    #[serde(default)]
    pub speed_scale: Option<f64>,
}

#[derive(Debug, Deserialize)]
struct RawRobot {
    name: String,
    gravity: [f64; 3],
    #[serde(default)]
    tool: [f64; 3],
    #[serde(default)]
    encoder_side: EncoderSide,
    velocity_filter_hz: Option<f64>,
    input_noise: Option<f64>,
    horizon_s: Option<f64>,
}

#[derive(Debug, Deserialize)]
struct Raw {
    robot: RawRobot,
    tolerance: Tolerance,
    #[serde(default)]
    joint: Vec<Joint>,
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
    /// Standard deviation of the applied input's noise, share of the torque peak.
    pub input_noise: Option<f64>,
    /// Free-run window, s; the whole record if absent.
    pub horizon: Option<f64>,
    /// Tolerances.
    pub tolerance: Tolerance,
    /// Joints, base to tip.
    pub joints: Vec<Joint>,
}

impl Nominal {
    /// Reads `nominal.toml` of a folder.
    ///
    /// # Errors
    /// If it is absent, malformed, or holds values that cannot be meant.
    pub fn read(folder: &Path) -> Result<Self, NominalError> {
        let path = folder.join("nominal.toml");
        let text = std::fs::read_to_string(&path).map_err(|source| NominalError::Read {
            path: path.clone(),
            source,
        })?;
        Self::parse(&text, &path)
    }

    /// From the text of the file; `path` is for messages.
    ///
    /// # Errors
    /// As [`Nominal::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, NominalError> {
        let raw: Raw = toml::from_str(text).map_err(|e| NominalError::Syntax {
            path: path.to_owned(),
            message: e.to_string().trim_end().to_owned(),
        })?;
        if raw.joint.is_empty() {
            return Err(NominalError::NoJoint);
        }
        for j in &raw.joint {
            check(j)?;
        }
        Ok(Nominal {
            name: raw.robot.name,
            gravity: raw.robot.gravity,
            tool: raw.robot.tool,
            encoder_side: raw.robot.encoder_side,
            velocity_filter_hz: raw.robot.velocity_filter_hz,
            input_noise: raw.robot.input_noise,
            horizon: raw.robot.horizon_s,
            tolerance: raw.tolerance,
            joints: raw.joint,
        })
    }

    /// Number of joints.
    pub fn n(&self) -> usize {
        self.joints.len()
    }

    /// Geometry of the chain.
    pub fn hinges(&self) -> Vec<Hinge> {
        self.joints
            .iter()
            .map(|j| {
                let length = j.axis.iter().map(|x| x * x).sum::<f64>().sqrt();
                Hinge {
                    revolute: j.r#type == "revolute",
                    axis: j.axis.map(|x| x / length),
                    origin: j.origin,
                    rotation: rpy(j.rpy),
                }
            })
            .collect()
    }
}

fn check(j: &Joint) -> Result<(), NominalError> {
    let fail = |key, value, must| {
        Err(NominalError::Value {
            joint: j.name.clone(),
            key,
            value,
            must,
        })
    };
    if !(j.mass >= 0.0 && j.mass.is_finite()) {
        return fail("mass", j.mass, "zero or positive");
    }
    if j.motor_gain == 0.0 || !j.motor_gain.is_finite() {
        return fail("motor_gain", j.motor_gain, "finite and not zero");
    }
    for (key, x) in [
        ("rotor_inertia", j.rotor_inertia),
        ("coulomb", j.coulomb),
        ("viscous", j.viscous),
    ] {
        if !(x >= 0.0 && x.is_finite()) {
            return fail(key, x, "zero or positive");
        }
    }
    let length = j.axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    if !(length > 1e-9 && length.is_finite()) {
        return fail("axis", length, "a vector that is not zero");
    }
    if j.r#type != "revolute" && j.r#type != "prismatic" {
        return fail("type", f64::NAN, "`revolute` or `prismatic`");
    }
    Ok(())
}

/// Rotation `Rz(yaw) Ry(pitch) Rx(roll)`.
fn rpy([r, p, y]: [f64; 3]) -> [[f64; 3]; 3] {
    let ((sr, cr), (sp, cp), (sy, cy)) = (r.sin_cos(), p.sin_cos(), y.sin_cos());
    [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
}
