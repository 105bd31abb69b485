//! MuJoCo: `robot.xml` with what MJCF expresses, a wrapper in Python for the rest, and a list of
//! what each does.
//!
//! Source of the elements and attributes: MuJoCo documentation, XML reference.

mod told;
mod wrapper;

use pid_derive::mechanism::Body;
use pid_effects::nominal::EncoderSide;

use crate::File;
use crate::error::ExportError;
use crate::machine::{Drive, Machine};
use crate::xml::{Element, number};

pub use told::expression;

/// Group of the actuators: the wrapper turns it off where it drives the joints itself.
const GROUP: u8 = 5;
/// File of the robot as the feed-forward of the drives knows it.
const KNOWN: &str = "drive_model.xml";
/// Time constant, damping ratio, and impedance of dry friction and of followers: within 0.01 % of a
/// rigid constraint. MuJoCo takes no time constant below two steps.
const IMPEDANCE: [f64; 3] = [0.9999, 0.9999, 0.001];
/// Time constant of these constraints in steps.
const STEPS: f64 = 2.0;

/// Files for MuJoCo.
pub(crate) fn files(machine: &Machine, step: f64) -> Result<Vec<File>, ExportError> {
    let text = xml(machine, step)
        .text()
        .map_err(|error| ExportError::Text {
            name: "robot.xml",
            error,
        })?;
    let mut files = vec![
        File::new("robot.xml", text),
        File::new("robot_effects.py", wrapper::MODULE),
        File::new("robot_effects.json", wrapper::data(machine)?),
        File::new("not_expressed.md", told::list(machine)),
    ];
    if machine.drives.iter().any(|d| d.position_loop.is_some()) {
        files.push(File::new("position_loops.py", wrapper::LOOPS));
    }
    if let Some(known) = &machine.known {
        let text = xml(known, step)
            .text()
            .map_err(|error| ExportError::Text { name: KNOWN, error })?;
        files.push(File::new(KNOWN, text));
    }
    Ok(files)
}

/// Name of the joint in series with that of a coordinate: the twist of its gear.
fn twist(machine: &Machine, coordinate: usize) -> String {
    let mut name = format!("{}_twist", machine.joint(coordinate));
    while machine.mechanism.bodies.iter().any(|b| b.joint == name) {
        name.push('_');
    }
    name
}

fn xml(machine: &Machine, step: f64) -> Element {
    let mechanism = &machine.mechanism;
    let flags = Element::new("option")
        .numbers("timestep", &[step])
        .with("integrator", "implicitfast")
        .numbers("gravity", &mechanism.gravity);
    let mut root = Element::new("mujoco")
        .with("model", mechanism.name.as_str())
        .child(
            Element::new("compiler")
                .with("angle", "radian")
                .with("autolimits", "true")
                .with("inertiafromgeom", "false"),
        )
        .child(flags);
    let mut world = Element::new("worldbody");
    for child in children(machine, None, step) {
        world.push(child);
    }
    root.push(world);
    for part in [
        equalities(machine, step),
        tendons(machine),
        actuators(machine, step),
        sensors(machine, step),
    ] {
        if !part.is_empty() {
            root.push(part);
        }
    }
    root
}

fn children(machine: &Machine, parent: Option<usize>, step: f64) -> Vec<Element> {
    let bodies = machine.mechanism.bodies.iter().enumerate();
    let own = bodies.filter(|(_, body)| body.parent == parent);
    own.map(|(index, body)| element(machine, index, body, step))
        .collect()
}

fn element(machine: &Machine, index: usize, body: &Body, step: f64) -> Element {
    let mut out = Element::new("body")
        .with("name", body.link.as_str())
        .numbers("pos", &body.origin)
        .numbers("quat", &quaternion(body.rpy))
        .child(
            Element::new("inertial")
                .numbers("pos", &body.com)
                .numbers("mass", &[body.mass])
                .numbers("fullinertia", &body.inertia),
        );
    let drives = &machine.drives;
    let coordinate = drives.iter().position(|drive| drive.body == index);
    out.push(joint(machine, body, coordinate, step));
    if let Some(c) = coordinate
        && let Some(twisting) = twisting(machine, body, c)
    {
        out.push(twisting);
    }
    for child in children(machine, Some(index), step) {
        out.push(child);
    }
    out
}

fn axis(body: &Body, name: &str) -> Element {
    Element::new("joint")
        .with("name", name)
        .with("type", if body.prismatic { "slide" } else { "hinge" })
        .numbers("axis", &body.axis)
}

/// The joint of a body: with its drive, if it moves on its own.
fn joint(machine: &Machine, body: &Body, coordinate: Option<usize>, step: f64) -> Element {
    let mut out = axis(body, &body.joint);
    if let Some((low, high)) = body.limits {
        out = out.numbers("range", &[low, high]);
    }
    let Some(c) = coordinate else { return out };
    let drive = &machine.drives[c];
    let drag: f64 = machine
        .all("quadratic_drag")
        .filter(|e| e.term.joint == c)
        .filter_map(|e| e.value("drag"))
        .sum();
    let mut damping = vec![drive.viscous];
    if drag != 0.0 {
        damping.push(drag);
    }
    out = out
        .numbers("armature", &[body.rotor.unwrap_or(0.0)])
        .numbers("damping", &damping);
    if drive.coulomb > 0.0 {
        out = out
            .numbers("frictionloss", &[drive.coulomb])
            .numbers("solreffriction", &[STEPS * step, 1.0])
            .numbers("solimpfriction", &IMPEDANCE);
    }
    let (stiffness, preload) = spring(machine, c);
    if stiffness > 0.0 {
        out = out
            .numbers("stiffness", &[stiffness])
            .numbers("springref", &[preload / stiffness]);
    }
    out
}

/// Sum of the springs of a coordinate that have a stiffness: stiffness and preload.
fn spring(machine: &Machine, coordinate: usize) -> (f64, f64) {
    let mut sum = (0.0, 0.0);
    for effect in machine.all("spring") {
        let stiffness = effect.value("stiffness").unwrap_or(0.0);
        if effect.term.joint == coordinate && stiffness > 0.0 {
            sum.0 += stiffness;
            sum.1 += effect.value("preload").unwrap_or(0.0);
        }
    }
    sum
}

/// The second joint in series with a rotor: elastic, or with play.
///
/// A limit of MuJoCo has its stiffness and damping per mass: they are those of the nominal rotor and
/// link at position zero. The wrapper computes the contact exactly and turns the limit off.
fn twisting(machine: &Machine, body: &Body, coordinate: usize) -> Option<Element> {
    let drive = &machine.drives[coordinate];
    let gear = drive.gear?;
    let out = axis(body, &twist(machine, coordinate));
    if gear.gap <= 0.0 {
        return Some(
            out.numbers("stiffness", &[gear.stiffness])
                .numbers("damping", &[gear.damping + gear.open]),
        );
    }
    let still = vec![0.0; machine.mechanism.bodies.len()];
    let link = machine.mechanism.felt(&still)[drive.body];
    let rotor = body.rotor.unwrap_or(0.0).max(1e-3 * link);
    let mass = link * rotor / (link + rotor);
    let (stiffness, damping) = (gear.stiffness / mass, gear.damping / mass);
    Some(
        out.numbers("range", &[-0.5 * gear.gap, 0.5 * gear.gap])
            .numbers("damping", &[gear.open])
            .numbers("solreflimit", &[-stiffness, -damping.max(1e-6 * stiffness)])
            .numbers("solimplimit", &IMPEDANCE),
    )
}

/// `Rz(yaw) Ry(pitch) Rx(roll)` as w, x, y, z.
fn quaternion([roll, pitch, yaw]: [f64; 3]) -> [f64; 4] {
    let half = |x: f64| (0.5 * x).sin_cos();
    let ((sr, cr), (sp, cp), (sy, cy)) = (half(roll), half(pitch), half(yaw));
    [
        cy * cp * cr + sy * sp * sr,
        cy * cp * sr - sy * sp * cr,
        cy * sp * cr + sy * cp * sr,
        sy * cp * cr - cy * sp * sr,
    ]
}

/// Joints that follow others.
fn equalities(machine: &Machine, step: f64) -> Element {
    let bodies = &machine.mechanism.bodies;
    let mut out = Element::new("equality");
    for body in bodies {
        let Some(follows) = body.follows else {
            continue;
        };
        out.push(
            Element::new("joint")
                .with("joint1", body.joint.as_str())
                .with("joint2", bodies[follows.body].joint.as_str())
                .numbers("polycoef", &[follows.offset, follows.ratio, 0.0, 0.0, 0.0])
                .numbers("solref", &[STEPS * step, 1.0])
                .numbers("solimp", &IMPEDANCE),
        );
    }
    out
}

fn fixed(name: String, parts: &[(&str, f64)]) -> Element {
    let mut out = Element::new("fixed").with("name", name);
    for (joint, coefficient) in parts {
        out.push(
            Element::new("joint")
                .with("joint", *joint)
                .numbers("coef", &[*coefficient]),
        );
    }
    out
}

/// Cables over two joints, and the sides of gears with encoders on the link.
fn tendons(machine: &Machine) -> Element {
    let mut out = Element::new("tendon");
    for (index, effect) in machine.all("joint_coupling").enumerate() {
        let value = |name| effect.value(name).unwrap_or(0.0);
        let (stiffness, c) = (value("stiffness"), effect.term.joint);
        let Some(before) = c.checked_sub(1).filter(|_| stiffness > 0.0) else {
            continue;
        };
        // A rest length of -1 would stand for one that MuJoCo computes.
        let rest = match value("preload") / stiffness {
            -1.0 => -1.0 - f64::EPSILON,
            rest => rest,
        };
        let parts = [
            (machine.joint(c), 1.0),
            (machine.joint(before), value("ratio")),
        ];
        let cable = fixed(format!("cable_{}", index + 1), &parts);
        out.push(
            cable
                .numbers("stiffness", &[stiffness])
                .numbers("springlength", &[rest]),
        );
    }
    for (c, drive) in machine.drives.iter().enumerate() {
        if drive.gear.is_some() {
            let parts = [(machine.joint(c), 1.0), (&*twist(machine, c), 1.0)];
            out.push(fixed(format!("link_side_{}", machine.joint(c)), &parts));
        }
    }
    out
}

fn actuators(machine: &Machine, step: f64) -> Element {
    let mut out = Element::new("actuator");
    for (c, drive) in machine.drives.iter().enumerate() {
        out.push(actuator(machine, c, drive, step));
    }
    out
}

fn actuator(machine: &Machine, c: usize, drive: &Drive, step: f64) -> Element {
    let joint = machine.joint(c);
    let mut out = Element::new("general")
        .with("name", format!("u_{joint}"))
        .with("joint", joint)
        .with("group", GROUP.to_string());
    // Behind a loop the control is its target, in front of which a lag of the motor has no place.
    let (looped, [kp, kd]) = match &drive.position_loop {
        Some(own) => (true, own.gains()),
        None => (false, [1.0, 0.0]),
    };
    out = out.numbers("gainprm", &[drive.gain * kp]);
    let of = |id: &str, name: &str| machine.at(id, c).and_then(|e| e.value(name));
    let offset = of("current_offset", "offset");
    if looped || offset.is_some() {
        let held = if looped { drive.gain } else { 0.0 };
        let bias = [drive.gain * offset.unwrap_or(0.0), -held * kp, -held * kd];
        out = out.with("biastype", "affine").numbers("biasprm", &bias);
    }
    if let Some(limit) = drive.most(of("torque_saturation", "limit_input")) {
        out = out.numbers("forcerange", &[-limit, limit]);
    }
    if let (Some(time), false) = (of("actuator_lag", "time_constant_s"), looped) {
        out = out
            .with("dyntype", "filterexact")
            .numbers("dynprm", &[time]);
    }
    match of("input_delay", "delay_s") {
        Some(delay) if delay > 0.0 => delayed(out, delay, step),
        _ => out,
    }
}

/// With a delay, s, and as many samples as it spans.
fn delayed(element: Element, delay: f64, step: f64) -> Element {
    let samples = (delay / step).ceil() + 1.0;
    element
        .numbers("delay", &[delay])
        .with("nsample", number(samples))
}

fn sensors(machine: &Machine, step: f64) -> Element {
    let mut out = Element::new("sensor");
    for (c, drive) in machine.drives.iter().enumerate() {
        let joint = machine.joint(c);
        let on_link = drive.gear.is_some() && machine.encoder_side == EncoderSide::Joint;
        let delay = machine
            .at("sensor_delay", c)
            .and_then(|e| e.value("delay_s"))
            .filter(|delay| *delay > 0.0);
        for (what, of_joint, of_tendon) in [
            ("q", "jointpos", "tendonpos"),
            ("v", "jointvel", "tendonvel"),
        ] {
            let sensor = match on_link {
                true => Element::new(of_tendon).with("tendon", format!("link_side_{joint}")),
                false => Element::new(of_joint).with("joint", joint),
            };
            let sensor = sensor.with("name", format!("{what}_{joint}"));
            out.push(match delay {
                Some(delay) => delayed(sensor, delay, step),
                None => sensor,
            });
        }
    }
    out
}
