//! Isaac Lab and Newton: a URDF, the drives as data, a module that hands them to the engine, and a
//! list of what each engine cannot express.
//!
//! Sources: Isaac Lab 3, `isaaclab.actuators` (`ActuatorBaseCfg`, `DelayedPDActuatorCfg`); Newton
//! 1.8, `ModelBuilder` and `newton.actuators`.

use std::fmt::Write;

use pid_effects::effect::Info;
use serde::Serialize;

use crate::error::ExportError;
use crate::machine::Machine;
use crate::position_loop::PositionLoop;
use crate::{File, urdf};

/// Which of the two.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Engine {
    IsaacLab,
    Newton,
}

#[derive(Serialize)]
struct Data<'a> {
    note: &'static str,
    drives: Vec<Drive<'a>>,
}

#[derive(Serialize)]
struct Drive<'a> {
    joint: &'a str,
    unit: &'a str,
    gain: f64,
    armature: f64,
    friction: f64,
    static_friction: f64,
    viscous: f64,
    stiffness: f64,
    damping: f64,
    effort_limit: Option<f64>,
    stall_effort: Option<f64>,
    no_load_speed: Option<f64>,
    delay_s: f64,
    constant_effort: f64,
}

const NOTE: &str = "SI units at the joint. Without stiffness: effort = gain * input + constant_effort, delayed by delay_s, within effort_limit. With stiffness the input is the target of a position loop: effort = stiffness * (input - position) - damping * velocity + constant_effort, within effort_limit and stall_effort * (1 - speed / no_load_speed).";

/// Files for an engine.
pub(crate) fn files(machine: &Machine, engine: Engine) -> Result<Vec<File>, ExportError> {
    let drives = (0..machine.drives.len()).map(|c| drive(machine, c));
    let data = Data {
        note: NOTE,
        drives: drives.collect(),
    };
    let text = serde_json::to_string_pretty(&data).map_err(|error| ExportError::Text {
        name: "robot_drives.json",
        error: error.into(),
    })?;
    let mut files = urdf::files(machine)?;
    files.retain(|file| file.name == "robot.urdf");
    files.push(File::new("robot_drives.json", text + "\n"));
    files.push(match engine {
        Engine::IsaacLab => File::new(
            "isaaclab_actuators.py",
            include_str!("isaaclab_actuators.py"),
        ),
        Engine::Newton => File::new("newton_drives.py", include_str!("newton_drives.py")),
    });
    files.push(File::new("not_expressed.md", list(machine, engine)));
    Ok(files)
}

fn drive(machine: &Machine, c: usize) -> Drive<'_> {
    let own = &machine.drives[c];
    let of = |id: &str, name: &str| machine.at(id, c).and_then(|e| e.value(name));
    let own_loop = own.position_loop.as_ref();
    let [kp, kd] = own_loop.map_or([0.0; 2], PositionLoop::gains);
    let number = |key: &str| own_loop.and_then(|own| own.get(key));
    Drive {
        joint: machine.joint(c),
        unit: &own.unit,
        gain: own.gain,
        armature: machine.mechanism.bodies[own.body].rotor.unwrap_or(0.0),
        friction: own.coulomb,
        static_friction: own.coulomb * (1.0 + of("stribeck", "excess").unwrap_or(0.0)),
        viscous: own.viscous,
        stiffness: kp * own.gain,
        damping: kd * own.gain,
        effort_limit: own.most(of("torque_saturation", "limit_input")),
        stall_effort: number("stall").map(|x| (x * own.gain).abs()),
        no_load_speed: number("no_load_speed"),
        delay_s: of("input_delay", "delay_s").unwrap_or(0.0),
        constant_effort: own.gain * of("current_offset", "offset").unwrap_or(0.0),
    }
}

/// What the files say of an effect.
fn expressed(id: &str, engine: Engine) -> Option<&'static str> {
    use Engine::{IsaacLab, Newton};
    Some(match (id, engine) {
        ("payload", _) => "mass and inertia of the last link in robot.urdf",
        ("base_tilt", _) => "the joint between world and base in robot.urdf",
        ("unmodelled_rotor_inertia", _) => "armature",
        ("torque_saturation", IsaacLab) => "actuator_effort_limit",
        ("torque_saturation", Newton) => "ClampingMaxEffort of the actuator",
        ("input_delay", IsaacLab) => "DelayedPDActuatorCfg, to whole steps of the physics",
        ("input_delay", Newton) => "delay_steps of the actuator, to whole steps of the physics",
        ("stribeck", IsaacLab) => {
            "friction at standstill and dynamic_friction in motion: a jump in place of the curve"
        }
        ("current_offset", Newton) => "const_effort of the actuator",
        ("current_offset", IsaacLab) => {
            "nothing by itself: add constant_effort of robot_drives.json to every command"
        }
        _ => return None,
    })
}

fn row(info: &Info, engine: Engine) -> String {
    let way = match engine {
        Engine::IsaacLab => info.isaac,
        Engine::Newton => None,
    };
    match (expressed(info.id, engine), way) {
        (Some(text), _) => text.to_owned(),
        (None, Some(way)) => format!("nothing; it could stand there as: {way}"),
        (None, None) => "nothing: the engine has no field for it".to_owned(),
    }
}

fn list(machine: &Machine, engine: Engine) -> String {
    let name = match engine {
        Engine::IsaacLab => "Isaac Lab",
        Engine::Newton => "Newton",
    };
    let mut out = format!("# What {name} expresses of this robot\n\n");
    if machine.effects.is_empty() {
        out.push_str("The description names no effects.\n");
    } else {
        out.push_str("| effect | joint | the files |\n|---|---|---|\n");
    }
    for effect in &machine.effects {
        let info = effect.term.effect.info();
        let joint = match info.has_joint {
            true => machine.joint(effect.term.joint),
            false => "whole robot",
        };
        // Writing to a text cannot fail.
        let _ = writeln!(out, "| {} | {joint} | {} |", info.id, row(info, engine));
    }
    let size = machine.gravity();
    let _ = writeln!(
        out,
        "\nGravity is {size} m/s^2 along -z of the world; set it in the simulator. Noise of sensors and drives is in no file."
    );
    for (joint, own) in machine.loops() {
        let left = own.beyond(&["limit", "stall", "no_load_speed"]);
        let left = match left.is_empty() {
            true => String::new(),
            false => format!("; left out: {}", left.join(", ")),
        };
        let _ = writeln!(
            out,
            "\nJoint `{joint}`: the input is the target of its position loop (law \"{}\"), whose gains are stiffness and damping{left}.",
            own.law()
        );
    }
    for line in &machine.mended {
        let _ = writeln!(out, "\n{line}");
    }
    out
}
