//! The file as written: keys, places, lines.

use pid_toml::Spanned;
use serde::Deserialize;

use super::servo::RawDrive;
use super::stated::{RawEffect, RawSimulated};

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawFile {
    pub(super) robot: RawRobot,
    pub(super) tolerance: Option<RawTolerance>,
    pub(super) drive: Option<RawDrive>,
    pub(super) joint: Vec<RawJoint>,
    #[serde(default)]
    pub(super) effect: Vec<RawEffect>,
    pub(super) simulated: Option<RawSimulated>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawRobot {
    pub(super) name: String,
    pub(super) gravity: Spanned<[f64; 3]>,
    pub(super) tool: Option<Spanned<[f64; 3]>>,
    pub(super) encoder_side: Option<Spanned<String>>,
    pub(super) velocity_filter_hz: Option<Spanned<f64>>,
    pub(super) input_noise: Option<Spanned<f64>>,
    pub(super) horizon_s: Option<Spanned<f64>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawTolerance {
    pub(super) mass_rel: Spanned<f64>,
    pub(super) com_abs_m: Spanned<f64>,
    pub(super) inertia_rel: Spanned<f64>,
    pub(super) rotor_inertia_rel: Spanned<f64>,
    pub(super) motor_gain_rel: Spanned<f64>,
    pub(super) friction_rel: Spanned<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawJoint {
    pub(super) name: Spanned<String>,
    pub(super) r#type: Spanned<String>,
    pub(super) axis: Spanned<[f64; 3]>,
    pub(super) parent: Option<Spanned<String>>,
    pub(super) origin: Spanned<[f64; 3]>,
    pub(super) rpy: Option<Spanned<[f64; 3]>>,
    pub(super) limits: Option<Spanned<[f64; 2]>>,
    pub(super) mass: Spanned<f64>,
    pub(super) com: Spanned<[f64; 3]>,
    pub(super) inertia: Spanned<[f64; 6]>,
    pub(super) rotor_inertia: Spanned<f64>,
    pub(super) coulomb: Spanned<f64>,
    pub(super) viscous: Spanned<f64>,
    pub(super) sharpness: Option<Spanned<f64>>,
    pub(super) motor_gain: Spanned<f64>,
    pub(super) input: Spanned<String>,
    pub(super) velocity: Spanned<String>,
    pub(super) q_resolution: Option<Spanned<f64>>,
    pub(super) q_noise_std: Option<Spanned<f64>>,
    pub(super) dq_noise_std: Option<Spanned<f64>>,
    pub(super) input_noise_std: Option<Spanned<f64>>,
    pub(super) torque_peak: Option<Spanned<f64>>,
    pub(super) speed_scale: Option<Spanned<f64>>,
    pub(super) tolerance: Option<RawHalfWidths>,
    pub(super) drive: Option<RawDrive>,
    pub(super) drive_model: Option<RawDriveModel>,
}

/// What a drive's feed-forward knows of a joint.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawDriveModel {
    pub(super) mass: Spanned<f64>,
    pub(super) com: Spanned<[f64; 3]>,
    pub(super) inertia: Option<Spanned<[f64; 6]>>,
    pub(super) rotor_inertia: Option<Spanned<f64>>,
    pub(super) motor_gain: Spanned<f64>,
}

/// Tolerances of one joint's own values, in their units.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawHalfWidths {
    pub(super) mass: Spanned<f64>,
    pub(super) com: Spanned<[f64; 3]>,
    pub(super) inertia: Spanned<[f64; 6]>,
    pub(super) rotor_inertia: Spanned<f64>,
    pub(super) coulomb: Spanned<f64>,
    pub(super) viscous: Spanned<f64>,
    pub(super) motor_gain: Spanned<f64>,
}

/// A `measurement.toml`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawMeasurement {
    #[serde(default)]
    pub(super) robot: RawMeasuredRobot,
    #[serde(default)]
    pub(super) joint: Vec<RawMeasuredJoint>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawMeasuredRobot {
    pub(super) tool: Option<Spanned<[f64; 3]>>,
    pub(super) encoder_side: Option<Spanned<String>>,
    pub(super) velocity_filter_hz: Option<Spanned<f64>>,
    pub(super) input_noise: Option<Spanned<f64>>,
    pub(super) horizon_s: Option<Spanned<f64>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawMeasuredJoint {
    pub(super) name: Spanned<String>,
    pub(super) velocity: Option<Spanned<String>>,
    pub(super) q_resolution: Option<Spanned<f64>>,
    pub(super) q_noise_std: Option<Spanned<f64>>,
    pub(super) dq_noise_std: Option<Spanned<f64>>,
    pub(super) torque_peak: Option<Spanned<f64>>,
    pub(super) speed_scale: Option<Spanned<f64>>,
}
