//! How a robot is measured: from its nominal description, or from a `measurement.toml` beside the
//! records of a declared robot.

use std::fs;
use std::path::Path;

use pid_toml::Spanned;

use super::error::NominalError;
use super::file::{
    RawFile, RawJoint, RawMeasuredJoint, RawMeasuredRobot, RawMeasurement, RawRobot,
};
use super::source::Source;
use super::{Channel, EncoderSide, Measurement, Velocity};

/// Where neither a sharpness nor a typical velocity is stated, 1/(rad/s) or 1/(m/s).
const SHARPNESS: f64 = 50.0;
/// Share of the typical velocity at which `tanh` reaches 0.76.
const TRANSITION: f64 = 0.02;

/// Sharpness of the transition at rest for a typical velocity.
pub(super) fn sharpness(speed: Option<f64>) -> f64 {
    speed.map_or(SHARPNESS, |speed| 1.0 / (TRANSITION * speed))
}

/// Statements about all joints.
#[derive(Default)]
struct Whole<'a> {
    tool: Option<&'a Spanned<[f64; 3]>>,
    encoder_side: Option<&'a Spanned<String>>,
    velocity_filter_hz: Option<&'a Spanned<f64>>,
    input_noise: Option<&'a Spanned<f64>>,
    horizon_s: Option<&'a Spanned<f64>>,
}

impl<'a> From<&'a RawRobot> for Whole<'a> {
    fn from(raw: &'a RawRobot) -> Self {
        Self {
            tool: raw.tool.as_ref(),
            encoder_side: raw.encoder_side.as_ref(),
            velocity_filter_hz: raw.velocity_filter_hz.as_ref(),
            input_noise: raw.input_noise.as_ref(),
            horizon_s: raw.horizon_s.as_ref(),
        }
    }
}

impl<'a> From<&'a RawMeasuredRobot> for Whole<'a> {
    fn from(raw: &'a RawMeasuredRobot) -> Self {
        Self {
            tool: raw.tool.as_ref(),
            encoder_side: raw.encoder_side.as_ref(),
            velocity_filter_hz: raw.velocity_filter_hz.as_ref(),
            input_noise: raw.input_noise.as_ref(),
            horizon_s: raw.horizon_s.as_ref(),
        }
    }
}

/// Statements about one joint.
#[derive(Default)]
struct One<'a> {
    velocity: Option<&'a Spanned<String>>,
    q_resolution: Option<&'a Spanned<f64>>,
    q_noise_std: Option<&'a Spanned<f64>>,
    input_noise_std: Option<&'a Spanned<f64>>,
    dq_noise_std: Option<&'a Spanned<f64>>,
    torque_peak: Option<&'a Spanned<f64>>,
    speed_scale: Option<&'a Spanned<f64>>,
}

impl<'a> From<&'a RawJoint> for One<'a> {
    fn from(raw: &'a RawJoint) -> Self {
        Self {
            velocity: Some(&raw.velocity),
            q_resolution: raw.q_resolution.as_ref(),
            q_noise_std: raw.q_noise_std.as_ref(),
            input_noise_std: raw.input_noise_std.as_ref(),
            dq_noise_std: raw.dq_noise_std.as_ref(),
            torque_peak: raw.torque_peak.as_ref(),
            speed_scale: raw.speed_scale.as_ref(),
        }
    }
}

impl<'a> From<&'a RawMeasuredJoint> for One<'a> {
    fn from(raw: &'a RawMeasuredJoint) -> Self {
        Self {
            velocity: raw.velocity.as_ref(),
            q_resolution: raw.q_resolution.as_ref(),
            q_noise_std: raw.q_noise_std.as_ref(),
            input_noise_std: None,
            dq_noise_std: raw.dq_noise_std.as_ref(),
            torque_peak: raw.torque_peak.as_ref(),
            speed_scale: raw.speed_scale.as_ref(),
        }
    }
}

/// A joint of a declared robot, as far as its measurement depends on it.
pub(super) struct Driven {
    pub(super) name: String,
    /// Torque or force per unit of the input.
    pub(super) gain: f64,
}

/// Measurement of a nominal description.
pub(super) fn of_file(source: &Source<'_>, raw: &RawFile) -> Result<Measurement, NominalError> {
    let joints = raw.joint.iter().map(|joint| {
        let driven = Driven {
            name: joint.name.get_ref().clone(),
            gain: *joint.motor_gain.get_ref(),
        };
        (driven, One::from(joint))
    });
    measurement(source, &Whole::from(&raw.robot), joints)
}

/// Measurement of a declared robot, as the file states it; without a file nothing is known.
pub(super) fn of_declared(
    path: Option<&Path>,
    joints: Vec<Driven>,
) -> Result<Measurement, NominalError> {
    let file = path.unwrap_or(Path::new(""));
    let text = match path.map(fs::read_to_string) {
        None => String::new(),
        Some(Ok(text)) => text,
        Some(Err(error)) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
        Some(Err(error)) => {
            return Err(NominalError::Unreadable {
                file: file.to_owned(),
                error,
            });
        }
    };
    let source = Source { file, text: &text };
    let raw: RawMeasurement = source.parse()?;
    for joint in &raw.joint {
        let name = joint.name.get_ref();
        if !joints.iter().any(|j| j.name == *name) {
            let names: Vec<&str> = joints.iter().map(|j| j.name.as_str()).collect();
            let mend = format!("the joints of the robot are {}", names.join(", "));
            return Err(source.error(&joint.name, "joint", "name", format!("\"{name}\""), mend));
        }
    }
    let joints = joints.into_iter().map(|driven| {
        let stated = raw.joint.iter().find(|j| *j.name.get_ref() == driven.name);
        (driven, stated.map(One::from).unwrap_or_default())
    });
    measurement(&source, &Whole::from(&raw.robot), joints)
}

fn measurement<'a>(
    source: &Source<'_>,
    robot: &Whole<'_>,
    joints: impl Iterator<Item = (Driven, One<'a>)>,
) -> Result<Measurement, NominalError> {
    let positive = "give a positive number, or leave the key out";
    let filter_hz = source.optional(
        robot.velocity_filter_hz,
        "robot",
        "velocity_filter_hz",
        |x| x > 0.0,
        positive,
    )?;
    let horizon = source.optional(robot.horizon_s, "robot", "horizon_s", |x| x > 0.0, positive)?;
    let noise = "a standard deviation is zero or positive";
    let input_noise = source.optional(
        robot.input_noise,
        "robot",
        "input_noise",
        |x| x >= 0.0,
        noise,
    )?;
    let sides = [
        ("motor", EncoderSide::Motor),
        ("joint", EncoderSide::Joint),
        ("link", EncoderSide::Joint),
    ];
    let encoder_side = match robot.encoder_side {
        Some(side) => source.word(side, "robot", "encoder_side", &sides)?,
        None => EncoderSide::Joint,
    };
    let tool = robot
        .tool
        .map(|tool| source.list(tool, "robot", "tool"))
        .transpose()?;

    let mut channels = Vec::new();
    for (driven, joint) in joints {
        let item = format!("joint {}", driven.name);
        let number = |value, key| source.optional(value, &item, key, |x| x >= 0.0, noise);
        let size = |value, key| source.optional(value, &item, key, |x| x > 0.0, positive);
        let dq_noise = number(joint.dq_noise_std, "dq_noise_std")?;
        let measured = Velocity::Measured { noise: dq_noise };
        let kinds = [
            ("measured", measured),
            ("derived", Velocity::Derived { filter_hz }),
            ("absent", Velocity::Absent),
        ];
        let peak = size(joint.torque_peak, "torque_peak")?;
        if peak.is_none()
            && let Some(share) = robot.input_noise
            && *share.get_ref() > 0.0
        {
            let mend = format!(
                "it is a share of `torque_peak`, which {item} does not state; state it, or give 0"
            );
            return Err(source.error(share, "robot", "input_noise", share.get_ref(), mend));
        }
        channels.push(Channel {
            name: driven.name,
            position_noise: number(joint.q_noise_std, "q_noise_std")?,
            position_resolution: number(joint.q_resolution, "q_resolution")?,
            velocity: match joint.velocity {
                Some(word) => source.word(word, &item, "velocity", &kinds)?,
                None if filter_hz.is_some() => Velocity::Derived { filter_hz },
                None => measured,
            },
            input_noise: match number(joint.input_noise_std, "input_noise_std")? {
                Some(own) => Some(own),
                None => input_noise.map(|share| share * peak.unwrap_or(0.0) / driven.gain.abs()),
            },
            torque_peak: peak,
            speed_scale: size(joint.speed_scale, "speed_scale")?,
        });
    }
    Ok(Measurement {
        channels,
        horizon,
        encoder_side,
        tool,
    })
}
