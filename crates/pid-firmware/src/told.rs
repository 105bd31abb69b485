//! What the code expresses of a robot, and what it cannot.

use std::fmt::Write;

use crate::equations::Equations;

/// What the code says of an effect of the library or a term, by its identifier; `None` for another one.
pub fn expression(id: &str) -> Option<&'static str> {
    Some(match id {
        "stribeck" | "saturating_friction" => "factor of the Coulomb level",
        "coulomb_asymmetry" => "factors of the friction, one per direction",
        "load_dependent_friction" => {
            "a share of the torque that the links take at the reference, added to the Coulomb level"
        }
        "quadratic_drag" => "force against the motion",
        "presliding_hysteresis" => {
            "nothing: its bristle has a state; Coulomb friction with tanh at rest stands in its place"
        }
        "cogging" => "force over the position",
        "friction_drift" => {
            "nothing: it depends on the time; the friction is that of the warm joint"
        }
        "joint_elasticity" => {
            "nothing: the gear's spring has a state; the torque is that of a stiff gear"
        }
        "backlash" => "nothing: the gear's play has a state; the torque is that of a stiff gear",
        "unmodelled_rotor_inertia" => "inertia of the rotor",
        "joint_coupling" => "forces on both joints",
        "motor_coupling" => "friction on both joints",
        "actuator_lag" => "nothing: it has a state; send u + T du/dt, T its time constant",
        "input_delay" => "nothing: it looks back in time; evaluate the reference one delay ahead",
        "command_filter"
        | "command_average"
        | "command_speed_limit"
        | "command_acceleration_limit"
        | "gravity_feed_forward"
        | "inertia_feed_forward"
        | "velocity_feed_forward"
        | "feedback_delay" => {
            "nothing: it is a stage of the drive's position loop, which the code does not have"
        }
        "torque_saturation" => {
            "`feed_forward` stays within the limit; `inverse_dynamics` does not know it"
        }
        "gain_error_nonlinear" => "solved for u; beyond the largest torque the u of that torque",
        "current_offset" => "subtracted from u",
        "drive_dead_zone" => {
            "its half width added to u in the direction of u; zero where u is zero"
        }
        "payload" => "mass, first moment and inertia of the last body",
        "base_tilt" => "gravity, turned",
        "spring" => "force over the position",
        "external_force" => "nothing: it acts within windows of time",
        "encoder_offset" => {
            "positions are those that the encoder shows; the offset is taken off inside"
        }
        "encoder_eccentricity" => "nothing: correct the readings and give true positions",
        "velocity_filter_lag" | "sensor_delay" => {
            "nothing: it changes what is read later, not the torque of a reference"
        }
        "hinge_above" | "hinge_below" => "force over the position",
        "friction_above_speed" | "friction_wave" => "added to the Coulomb level",
        "friction_above_load" => {
            "what the torque that the links take at the reference adds to the Coulomb level"
        }
        "wave_of_two" => "force over both positions",
        "wave_of_two_before" => "force on the joint before over both positions",
        "pull_of_two" => "forces on both joints",
        "supply_sag" => "nothing: it acts on the inputs of all joints together",
        "gain_over_time" | "time_wave" | "base_wave" => "nothing: it depends on the time",
        _ => return None,
    })
}

/// The list.
pub(crate) fn list(equations: &Equations) -> String {
    let mut out = format!(
        "# What the code expresses of this robot\n\n\
         Masses, inertias, gravity, rotors, Coulomb and viscous friction and gains are constants of the code. The \
         sign of dry friction is tanh(sharpness v). {} operations for the torques, {} for the residual.\n\n\
         | what | joint | in the code |\n|---|---|---|\n",
        equations.cost(),
        equations.residual_cost()
    );
    // Writing to a text cannot fail.
    let mut row = |what: &str, joint: &str, text: &str| {
        let _ = writeln!(out, "| {what} | {joint} | {text} |");
    };
    for (term, _) in &equations.effects {
        let info = term.effect.info();
        let joint = match info.has_joint {
            true => equations.drives[term.joint].name.as_str(),
            false => "whole robot",
        };
        let text = expression(info.id).unwrap_or("nothing: the code has no words for it");
        row(info.id, joint, text);
    }
    for drive in equations.drives.iter().filter(|d| d.looped) {
        let text = "nothing: u is the input of the motor behind the loop, not its target";
        row("position loop", &drive.name, text);
    }
    if let Some(coupled) = &equations.coupled {
        for (drive, (row_of, offset)) in equations
            .drives
            .iter()
            .zip(coupled.ratios.iter().zip(&coupled.offsets))
        {
            let text = format!(
                "coordinate of the drive: {row_of:?} times the joints' positions plus {offset}"
            );
            row("drive on several joints", &drive.name, &text);
        }
    }
    out
}
