//! What is written of a robot: its nominal description and the head of its records.

use std::fmt::Write as _;

use crate::motion::Planned;
use crate::robot::{Robot, VELOCITY_HZ};

fn list(x: [f64; 3]) -> String {
    format!("[{:?}, {:?}, {:?}]", x[0], x[1], x[2])
}

/// `nominal.toml`; with the input noise, a share of the largest usual torque, come the other noise
/// figures.
pub(crate) fn nominal(robot: &Robot, noise: Option<f64>, velocity: &str) -> String {
    let mut s = String::new();
    // Writing to a string cannot fail.
    let _ = write!(
        s,
        "[robot]\nname = \"drawn\"\ngravity = [0.0, 0.0, -9.81]\ntool = {}\nencoder_side = \"motor\"\nhorizon_s = {:?}\n",
        list(robot.tool),
        robot.horizon
    );
    if let Some(input) = noise {
        let _ = writeln!(s, "input_noise = {input:?}");
    }
    if velocity == "derived" {
        let _ = writeln!(s, "velocity_filter_hz = {VELOCITY_HZ:?}");
    }
    let t = &robot.tolerance;
    let _ = write!(
        s,
        "\n[tolerance]\nmass_rel = {:?}\ncom_abs_m = {:?}\ninertia_rel = {:?}\nrotor_inertia_rel = {:?}\nmotor_gain_rel = {:?}\nfriction_rel = {:?}\n",
        t.mass, t.com, t.inertia, t.rotor, t.gain, t.friction
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
        if noise.is_some() {
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

/// `dataset.toml`; `samples`: how many each record has, where none gets lost.
pub(crate) fn dataset(
    id: &str,
    robot: &Robot,
    velocity: &str,
    records: &[Planned],
    samples: Option<usize>,
) -> String {
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
    for Planned { name, role, .. } in records {
        let _ = write!(
            s,
            "\n[[experiment]]\nfile = \"{name}\"\nrole = \"{role}\"\nsample_time_s = {:?}\n",
            1.0 / robot.rate,
        );
        if let Some(samples) = samples {
            let _ = writeln!(s, "samples = {samples}");
        }
        s.push_str("note = \"\"\n");
    }
    s
}

/// A description with a table for each joint at the end of what is stated of it.
pub(crate) fn with_loops(nominal: &str, tables: &[String]) -> String {
    let mut parts = nominal.split("\n[[joint]]\n");
    let mut out = parts.next().unwrap_or_default().to_owned();
    for (joint, table) in parts.zip(tables) {
        let _ = write!(out, "\n[[joint]]\n{joint}{table}");
    }
    out
}

/// The head of records whose inputs are targets.
pub(crate) fn commanded(dataset: &str) -> String {
    let hinge = "type = \"revolute\"\ninput = \"current\"\ninput_unit = \"A\"";
    let slide = hinge.replace("revolute", "prismatic");
    let target = |kind: &str, unit: &str| {
        format!("type = \"{kind}\"\ninput = \"position\"\ninput_unit = \"{unit}\"")
    };
    let turned = dataset.replace(hinge, &target("revolute", "rad"));
    turned.replace(&slide, &target("prismatic", "m"))
}
