//! Which part of MuJoCo's files carries an effect, in words.

use std::fmt::Write;

use crate::machine::{Machine, Named};
use crate::position_loop::PositionLoop;

/// What carries an effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Who {
    /// `robot.xml`.
    File,
    /// The wrapper alone.
    Wrapper,
    /// `robot.xml` approximately or in steps of the engine, the wrapper exactly.
    Both,
    /// Neither.
    Nobody,
}

/// What MJCF says of an effect, and what the wrapper does; `None` for an effect without a row.
pub fn expression(id: &str) -> Option<(&'static str, &'static str)> {
    row(id).map(|(_, file, wrapper)| (file, wrapper))
}

/// An effect whose stiffness is zero has no element of its own; the wrapper applies its constant force.
pub(super) fn who(effect: &Named) -> Who {
    let constant = effect.value("stiffness") == Some(0.0);
    match row(effect.id()) {
        Some((Who::File, ..)) if constant => Who::Wrapper,
        Some((who, ..)) => who,
        None => Who::Wrapper,
    }
}

const NOTHING: &str = "nothing: MJCF has no element for it";

/// Who carries an effect, what MJCF says of it, and what the wrapper does.
type Row = (Who, &'static str, &'static str);

fn row(id: &str) -> Option<Row> {
    friction(id)
        .or_else(|| transmission(id))
        .or_else(|| input(id))
        .or_else(|| load(id))
        .or_else(|| stage(id))
        .or_else(|| reading(id))
        .or_else(|| composed(id))
}

/// Friction at a joint.
fn friction(id: &str) -> Option<Row> {
    use Who::{File, Wrapper};
    Some(match id {
        "stribeck" => (
            Wrapper,
            "the Coulomb level alone, as frictionloss; the law `lugre` of the actuator `dcmotor` has other parameters",
            "sets the level of frictionloss at every step from the velocity",
        ),
        "coulomb_asymmetry" => (
            Wrapper,
            "the mean level, as frictionloss: it has one value for both directions",
            "sets frictionloss to the mean of both levels, applies half of their difference as a force, and changes the damping with the direction",
        ),
        "load_dependent_friction" => (
            Wrapper,
            "the level without load, as frictionloss",
            "computes the torque through the gear of the step before and raises frictionloss by it",
        ),
        "quadratic_drag" => (
            File,
            "second coefficient of the joint's damping",
            "nothing more",
        ),
        "saturating_friction" => (
            Wrapper,
            "the Coulomb level alone, as frictionloss, which MuJoCo rounds at rest in its own way",
            "sets the level of frictionloss at every step from the velocity",
        ),
        "presliding_hysteresis" => (
            Wrapper,
            "the Coulomb level, as frictionloss, without the elastic part",
            "replaces frictionloss by the force of the bristle, whose rate it adds to the damping",
        ),
        "cogging" => (
            Wrapper,
            NOTHING,
            "applies the ripple as a force on the joint",
        ),
        "friction_drift" => (
            Wrapper,
            NOTHING,
            "changes frictionloss and damping with the time since the start",
        ),
        _ => return None,
    })
}

/// What is between the drive and the link.
fn transmission(id: &str) -> Option<Row> {
    use Who::{Both, File, Wrapper};
    Some(match id {
        "joint_elasticity" => (
            File,
            "a second joint in series with stiffness and damping; rotor, friction and actuator are on the first",
            "nothing more; it reads the side of the gear on which the encoder sits",
        ),
        "backlash" => (
            Both,
            "a second joint in series with a range of ± gap/2; the stiffness of its limit holds for the inertia at position zero",
            "turns the limit off and applies the force of the contact exactly",
        ),
        "unmodelled_rotor_inertia" => (File, "armature of the joint", "nothing more"),
        "joint_coupling" => (
            File,
            "a fixed tendon over both joints with stiffness and rest length; without stiffness nothing",
            "nothing more; without stiffness it applies the constant pull",
        ),
        "motor_coupling" => (
            Wrapper,
            NOTHING,
            "applies the friction of the shared motor on both joints",
        ),
        _ => return None,
    })
}

/// What the drive makes of its input.
fn input(id: &str) -> Option<Row> {
    use Who::{Both, Wrapper};
    Some(match id {
        "actuator_lag" => (
            Both,
            "dyntype filterexact of the actuator",
            "computes the lag itself, between the other laws of the input",
        ),
        "input_delay" => (
            Both,
            "delay of the actuator, to a whole step of the simulation",
            "delays by fractions of a step too: the mean of the command over each step",
        ),
        "torque_saturation" => (
            Both,
            "forcerange of the actuator",
            "limits the input itself, between the other laws of the input",
        ),
        "gain_error_nonlinear" => (Wrapper, NOTHING, "bends the input before the gain"),
        "current_offset" => (
            Both,
            "biasprm of the actuator: gain times the offset",
            "adds the offset to the input, between the other laws of the input",
        ),
        "drive_dead_zone" => (Wrapper, NOTHING, "takes the dead zone off the input"),
        _ => return None,
    })
}

/// What the links carry and what pulls at them.
fn load(id: &str) -> Option<Row> {
    use Who::{File, Wrapper};
    Some(match id {
        "payload" => (File, "mass and inertia of the last body", "nothing more"),
        "base_tilt" => (File, "option gravity, turned", "nothing more"),
        "spring" => (
            File,
            "stiffness and springref of the joint; without stiffness nothing",
            "nothing more; without stiffness it applies the constant force",
        ),
        "external_force" => (
            Wrapper,
            NOTHING,
            "applies the force at the tool point within its time windows",
        ),
        _ => return None,
    })
}

/// Stages of a position loop.
fn stage(id: &str) -> Option<Row> {
    Some(match id {
        "command_filter"
        | "command_average"
        | "command_speed_limit"
        | "command_acceleration_limit"
        | "gravity_feed_forward"
        | "inertia_feed_forward"
        | "velocity_feed_forward"
        | "feedback_delay" => (
            Who::Nobody,
            "nothing: its actuators have the gains of position loops alone",
            "a stage of the joint's position loop",
        ),
        _ => return None,
    })
}

/// What is between the joint and its readings.
fn reading(id: &str) -> Option<Row> {
    use Who::{Both, Wrapper};
    Some(match id {
        "encoder_offset" => (
            Wrapper,
            "nothing: `ref` of the joint would move every position, not only what is read",
            "adds the offset to the readings",
        ),
        "encoder_eccentricity" => (
            Wrapper,
            NOTHING,
            "bends the readings of position and velocity",
        ),
        "velocity_filter_lag" => (Wrapper, NOTHING, "filters the reading of the velocity"),
        "sensor_delay" => (
            Both,
            "delay of the joint's sensors, to a whole step of the simulation",
            "delays the readings by fractions of a step too",
        ),
        _ => return None,
    })
}

/// Laws that a diagnosis composes itself.
fn composed(id: &str) -> Option<Row> {
    use Who::Wrapper;
    Some(match id {
        "hinge_above" | "hinge_below" | "time_wave" | "wave_of_two" | "wave_of_two_before"
        | "pull_of_two" => (Wrapper, NOTHING, "applies the law as a force"),
        "friction_above_speed" | "friction_above_load" | "friction_wave" => (
            Wrapper,
            "the Coulomb level alone, as frictionloss",
            "changes frictionloss at every step by the law",
        ),
        "gain_over_time" => (
            Wrapper,
            NOTHING,
            "changes the input with the time since the start",
        ),
        "supply_sag" => (
            Wrapper,
            NOTHING,
            "takes a share off each input that grows with the inputs of all joints",
        ),
        "base_wave" => (
            Wrapper,
            NOTHING,
            "takes the acceleration of the base off gravity at every step",
        ),
        _ => return None,
    })
}

/// What of a position loop is where.
fn loops(joint: &str, own: &PositionLoop) -> String {
    let left = own.beyond(&["limit"]);
    let left = match left.is_empty() {
        true => String::new(),
        false => format!(", without {}", left.join(", ")),
    };
    format!(
        "Joint `{joint}`: the input of both files is the target of its position loop (law \"{}\"). The actuator of robot.xml has its gains{left}; robot_effects.py has all of it.",
        own.law()
    )
}

/// The list for one robot.
pub(super) fn list(machine: &Machine) -> String {
    let mut out = String::from(
        "# What MuJoCo expresses of this robot\n\n`robot.xml` runs by itself. `robot_effects.py` adds what MJCF cannot \
         express; it then drives the joints itself and turns the actuators of robot.xml off.\n",
    );
    if machine.effects.is_empty() {
        out.push_str(
            "\nThe description names no effects: robot.xml has all masses, joints and motors.\n",
        );
    } else {
        out.push_str("\n| effect | joint | robot.xml | robot_effects.py |\n|---|---|---|---|\n");
    }
    for effect in &machine.effects {
        let (file, wrapper) = expression(effect.id()).unwrap_or((
            "nothing: this effect has no row here",
            "nothing: the effect is missing",
        ));
        let info = effect.term.effect.info();
        let joint = match info.has_joint {
            true => machine.joint(effect.term.joint),
            false => "whole robot",
        };
        // Writing to a text cannot fail.
        let _ = writeln!(out, "| {} | {joint} | {file} | {wrapper} |", info.id);
    }
    out.push_str("\n## What holds without effects\n\n");
    let mut always = vec![
        "Dry friction is a constraint of MuJoCo: a joint that sticks creeps at about 1e-4 of the velocity that the same torque \
         would give in one step."
            .to_owned(),
        "Noise of sensors and drives is in neither file.".to_owned(),
    ];
    if machine.mechanism.bodies.iter().any(|b| b.follows.is_some()) {
        always.push(
            "Joints that follow others are held by equality constraints, which give way by about 1e-4 of what a free joint would move."
                .to_owned(),
        );
    }
    if machine.drives.iter().any(|d| d.gear.is_some()) {
        always.push("The position of the first joint of a gear is that of the rotor; the link is at the sum of both joints.".to_owned());
    }
    always.extend(machine.loops().map(|(joint, own)| loops(joint, own)));
    always.extend(machine.mended.iter().cloned());
    for line in always {
        let _ = writeln!(out, "- {line}");
    }
    out
}
