//! What the wrapper in Python reads: joints, effects and how the robot is measured.

use pid_effects::nominal::EncoderSide;
use pid_interpret::nominal::Velocity;
use serde::Serialize;

use super::told::{Who, who};
use super::{GROUP, twist};
use crate::error::ExportError;
use crate::machine::{Drive, Machine, Named};
use crate::position_loop::PositionLoop;

/// The module; it reads the data beside it.
pub(super) const MODULE: &str = include_str!("robot_effects.py");
/// What it does where drives have position loops.
pub(super) const LOOPS: &str = include_str!("position_loops.py");

#[derive(Serialize)]
struct Data<'a> {
    robot: &'a str,
    actuator_group: u8,
    encoder_side: &'static str,
    /// File of the robot as the drives know it.
    drive_model: Option<&'static str>,
    tool: Option<Tool<'a>>,
    joints: Vec<Joint<'a>>,
    followers: Vec<Follower<'a>>,
    effects: Vec<Effect<'a>>,
}

#[derive(Serialize)]
struct Tool<'a> {
    body: &'a str,
    point: [f64; 3],
}

#[derive(Serialize)]
struct Joint<'a> {
    name: &'a str,
    unit: &'a str,
    gain: f64,
    coulomb: f64,
    viscous: f64,
    /// The part of `viscous` that goes with a drive that is off.
    induced: f64,
    velocity: &'static str,
    filter_hz: Option<f64>,
    gear: Option<Gear>,
    #[serde(rename = "loop")]
    position_loop: Option<&'a PositionLoop>,
    /// Torque or force per unit of the input as the drive knows it.
    known_gain: f64,
}

/// A joint at `ratio · position + offset` of another.
#[derive(Serialize)]
struct Follower<'a> {
    joint: &'a str,
    leader: &'a str,
    ratio: f64,
    offset: f64,
}

#[derive(Serialize)]
struct Gear {
    joint: String,
    stiffness: f64,
    damping: f64,
    open: f64,
    gap: f64,
}

#[derive(Serialize)]
struct Effect<'a> {
    id: &'a str,
    /// From 0; of no joint for effects of the whole robot.
    joint: Option<usize>,
    parameters: serde_json::Map<String, serde_json::Value>,
}

/// The data as JSON.
pub(super) fn data(machine: &Machine) -> Result<String, ExportError> {
    let bodies = &machine.mechanism.bodies;
    let data = Data {
        robot: &machine.mechanism.name,
        actuator_group: GROUP,
        encoder_side: match machine.encoder_side {
            EncoderSide::Motor => "motor",
            EncoderSide::Joint => "joint",
        },
        drive_model: machine.known.is_some().then_some(super::KNOWN),
        tool: machine.tool.map(|(body, point)| Tool {
            body: &bodies[body].link,
            point,
        }),
        joints: (machine.drives.iter().enumerate())
            .map(|(c, drive)| joint(machine, c, drive))
            .collect(),
        followers: (bodies.iter())
            .filter_map(|body| {
                let follows = body.follows?;
                Some(Follower {
                    joint: &body.joint,
                    leader: &bodies[follows.body].joint,
                    ratio: follows.ratio,
                    offset: follows.offset,
                })
            })
            .collect(),
        effects: (machine.effects.iter())
            .filter(|e| matches!(who(e), Who::Wrapper | Who::Both))
            .map(effect)
            .collect(),
    };
    let text = serde_json::to_string_pretty(&data).map_err(|error| ExportError::Text {
        name: "robot_effects.json",
        error: error.into(),
    })?;
    Ok(text + "\n")
}

fn joint<'a>(machine: &'a Machine, c: usize, drive: &'a Drive) -> Joint<'a> {
    let (velocity, filter_hz) = match drive.velocity {
        Velocity::Measured { .. } => ("measured", None),
        Velocity::Derived { filter_hz } => ("derived", filter_hz),
        Velocity::Absent => ("absent", None),
    };
    Joint {
        name: machine.joint(c),
        unit: &drive.unit,
        gain: drive.gain,
        coulomb: drive.coulomb,
        viscous: drive.viscous,
        induced: drive.induced,
        velocity,
        filter_hz,
        gear: drive.gear.map(|gear| Gear {
            joint: twist(machine, c),
            stiffness: gear.stiffness,
            damping: gear.damping,
            open: gear.open,
            gap: gear.gap,
        }),
        position_loop: drive.position_loop.as_ref(),
        known_gain: drive.known_gain,
    }
}

fn effect(effect: &Named) -> Effect<'_> {
    let info = effect.term.effect.info();
    let values = info.parameters.iter().zip(&effect.values);
    Effect {
        id: info.id,
        joint: info.has_joint.then_some(effect.term.joint),
        parameters: values
            .map(|(p, &x)| (p.name.to_owned(), serde_json::Value::from(x)))
            .collect(),
    }
}
