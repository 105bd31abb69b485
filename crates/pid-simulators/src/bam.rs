//! Better Actuator Models (Rhoban): a file of friction and motor parameters for each joint, and a list of
//! what these models cannot express.
//!
//! The models are those of `bam.model`: M1 has Coulomb and viscous friction, M2 adds the Stribeck curve
//! `exp(-|v / dtheta_stribeck|^alpha)`, M3 friction that grows with the torque at the gear, M4 both.

use std::fmt::Write;

use serde::Serialize;

use crate::File;
use crate::error::ExportError;
use crate::machine::Machine;

/// Parameters of a joint under the names of BAM, SI units at the joint.
#[derive(Debug, Serialize)]
struct Parameters<'a> {
    /// Torque per ampere; only a drive whose input is a current states it.
    #[serde(skip_serializing_if = "Option::is_none")]
    kt: Option<f64>,
    #[serde(rename = "R", skip_serializing_if = "Option::is_none")]
    resistance: Option<f64>,
    armature: f64,
    q_offset: f64,
    friction_base: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    friction_stribeck: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    load_friction_base: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    load_friction_stribeck: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    dtheta_stribeck: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    alpha: Option<f64>,
    friction_viscous: f64,
    model: &'static str,
    actuator: &'a str,
}

/// Exponent of the Stribeck curve of the library.
const SQUARE: f64 = 2.0;
/// BAM weighs the torques of motor and load at the gear together. Where they balance, that is twice
/// either of them, by which the library counts.
const BOTH_SIDES: f64 = 0.5;

/// Files of all turning joints.
pub(crate) fn files(machine: &Machine) -> Result<Vec<File>, ExportError> {
    let mut files = Vec::new();
    for c in (0..machine.drives.len()).filter(|&c| turns(machine, c)) {
        let text = serde_json::to_string_pretty(&parameters(machine, c));
        let text = text.map_err(|error| ExportError::Text {
            name: "the parameters for BAM",
            error: error.into(),
        })?;
        let name = format!("bam_{}.json", machine.joint(c));
        files.push(File::new(name, text + "\n"));
    }
    files.push(File::new("not_expressed.md", list(machine)));
    Ok(files)
}

fn turns(machine: &Machine, c: usize) -> bool {
    !machine.mechanism.bodies[machine.drives[c].body].prismatic
}

fn parameters(machine: &Machine, c: usize) -> Parameters<'_> {
    let own = &machine.drives[c];
    let of = |id: &str, name: &str| machine.at(id, c).and_then(|e| e.value(name));
    let excess = of("stribeck", "excess");
    let load = of("load_dependent_friction", "load_coefficient").map(|x| BOTH_SIDES * x);
    // Per volt a motor brings kt/R, and per velocity it induces kt.
    let back_emf = own.induced / own.gain;
    let (kt, resistance) = match own.unit.as_str() {
        "A" => (Some(own.gain), None),
        "V" if back_emf > 0.0 => (Some(back_emf), Some(back_emf / own.gain)),
        _ => (None, None),
    };
    Parameters {
        kt,
        resistance,
        armature: machine.mechanism.bodies[own.body].rotor.unwrap_or(0.0),
        q_offset: 0.0,
        friction_base: own.coulomb,
        friction_stribeck: excess.map(|x| x * own.coulomb),
        load_friction_base: load,
        load_friction_stribeck: load.zip(excess).map(|(load, excess)| load * excess),
        dtheta_stribeck: of("stribeck", "stribeck_velocity"),
        alpha: excess.map(|_| SQUARE),
        friction_viscous: own.viscous - own.induced,
        model: match (excess, load) {
            (None, None) => "m1",
            (Some(_), None) => "m2",
            (None, Some(_)) => "m3",
            (Some(_), Some(_)) => "m4",
        },
        actuator: machine.joint(c),
    }
}

/// What the files say of an effect.
fn expressed(id: &str) -> &'static str {
    match id {
        "stribeck" => "friction_stribeck, dtheta_stribeck, alpha",
        "load_dependent_friction" => {
            "load_friction_base: half the coefficient, the same force where motor and load balance"
        }
        "unmodelled_rotor_inertia" => "armature",
        "payload" | "base_tilt" => "nothing: the robot's own file has masses and gravity",
        _ => "nothing: BAM has no parameter for it",
    }
}

fn list(machine: &Machine) -> String {
    let mut out = String::from(
        "# What Better Actuator Models express of this robot\n\nA file `bam_JOINT.json` has the friction, the inertia of the \
         rotor and, where the input is a current or the drive states `back_emf`, the torque constant; with `back_emf` also the resistance `R`. Before `bam.load_model` reads it, put the name \
         of an actuator class of BAM into `actuator`, and `R` where it lacks.\n\n| what | joint | the files |\n|---|---|---|\n",
    );
    let mut row = |what: &str, joint: &str, text: &str| {
        // Writing to a text cannot fail.
        let _ = writeln!(out, "| {what} | {joint} | {text} |");
    };
    for effect in &machine.effects {
        let info = effect.term.effect.info();
        let (joint, text) = match info.has_joint {
            true if !turns(machine, effect.term.joint) => (
                machine.joint(effect.term.joint),
                "nothing: BAM has turning joints alone",
            ),
            true => (machine.joint(effect.term.joint), expressed(info.id)),
            false => ("whole robot", expressed(info.id)),
        };
        row(info.id, joint, text);
    }
    for (c, drive) in machine.drives.iter().enumerate() {
        let joint = machine.joint(c);
        if !turns(machine, c) {
            row("drive", joint, "nothing: BAM has turning joints alone");
        } else if drive.unit == "V" && drive.induced == 0.0 {
            let text = format!(
                "nothing: {} N m per V is kt over R; friction_viscous has the back-EMF in it, so subtract kt^2 / R",
                drive.gain
            );
            row("gain of the drive", joint, &text);
        } else if !["A", "V"].contains(&drive.unit.as_str()) && drive.gain != 1.0 {
            row(
                "gain of the drive",
                joint,
                "nothing: BAM has torques of its own motor",
            );
        }
    }
    for line in machine
        .loops_left_out()
        .chain(machine.mended.iter().cloned())
    {
        let _ = writeln!(out, "\n{line}");
    }
    out
}
