//! What is written of a robot: its nominal description and the head of its records.

use std::fmt::Write as _;

use crate::motion::{LENGTH, RECORDS};
use crate::robot::{Robot, VELOCITY_HZ};

fn list(x: [f64; 3]) -> String {
    format!("[{:?}, {:?}, {:?}]", x[0], x[1], x[2])
}

/// `nominal.toml`, with or without the noise figures.
pub(crate) fn nominal(robot: &Robot, noise: bool, velocity: &str) -> String {
    let mut s = String::new();
    // Writing to a string cannot fail.
    let _ = write!(
        s,
        "[robot]\nname = \"drawn\"\ngravity = [0.0, 0.0, -9.81]\ntool = {}\nencoder_side = \"motor\"\nhorizon_s = {:?}\n",
        list(robot.tool),
        robot.horizon
    );
    if noise {
        let _ = writeln!(s, "input_noise = {:?}", robot.drive_noise);
    }
    if velocity == "derived" {
        let _ = writeln!(s, "velocity_filter_hz = {VELOCITY_HZ:?}");
    }
    s.push_str(
        "\n[tolerance]\nmass_rel = 0.05\ncom_abs_m = 0.003\ninertia_rel = 0.05\nrotor_inertia_rel = 0.05\nmotor_gain_rel = 0.01\nfriction_rel = 0.4\n",
    );
    for (k, j) in robot.joints.iter().enumerate() {
        let kind = if j.prismatic { "prismatic" } else { "revolute" };
        let [xx, yy, zz] = j.inertia;
        let _ = write!(
            s,
            "\n[[joint]]\nname = \"j{}\"\ntype = \"{kind}\"\naxis = {}\norigin = {}\nmass = {:?}\ncom = {}\ninertia = [{xx:?}, {yy:?}, {zz:?}, 0.0, 0.0, 0.0]\nrotor_inertia = {:?}\ncoulomb = {:?}\nviscous = {:?}\nmotor_gain = {:?}\ninput = \"current\"\nvelocity = \"{velocity}\"\n",
            k + 1,
            list(j.axis),
            list(j.origin),
            j.mass,
            list(j.com),
            j.rotor,
            j.coulomb,
            j.viscous,
            j.gain,
        );
        if j.torque > 0.0 {
            let _ = writeln!(s, "torque_peak = {:?}", j.torque);
        }
        if noise {
            let v = if velocity == "measured" {
                j.v_noise
            } else {
                0.0
            };
            let _ = write!(
                s,
                "q_resolution = {:?}\nq_noise_std = {:?}\ndq_noise_std = {v:?}\n",
                j.q_step, j.q_noise
            );
        }
    }
    s
}

/// `dataset.toml`.
pub(crate) fn dataset(id: &str, robot: &Robot, velocity: &str) -> String {
    let mut s = format!(
        "name = \"{id}\"\ntitle = \"drawn case\"\nsource = \"simtrue study\"\nlicense = \"as this program\"\nkind = \"simulated\"\ninput_hold = \"zero-order\"\n"
    );
    for (k, j) in robot.joints.iter().enumerate() {
        let kind = if j.prismatic { "prismatic" } else { "revolute" };
        let _ = write!(
            s,
            "\n[[joint]]\nname = \"j{}\"\ntype = \"{kind}\"\ninput = \"current\"\ninput_unit = \"A\"\nvelocity = \"{velocity}\"\n",
            k + 1
        );
    }
    for (name, role, _) in RECORDS {
        let _ = write!(
            s,
            "\n[[experiment]]\nfile = \"{name}\"\nrole = \"{role}\"\nsample_time_s = {:?}\nsamples = {}\nnote = \"\"\n",
            1.0 / robot.rate,
            (LENGTH * robot.rate) as usize + 1
        );
    }
    s
}
