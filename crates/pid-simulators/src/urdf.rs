//! URDF: links, joints, limits and `<dynamics>`, and a list of what URDF cannot express.
//!
//! Source: the URDF specification of ROS, elements `link` and `joint`.

use std::fmt::Write;

use pid_derive::mechanism::{Body, Place};

use crate::File;
use crate::error::ExportError;
use crate::machine::{Machine, Named};
use crate::xml::Element;

/// Range of a slide without limits, m: URDF demands one.
const FAR: f64 = 1000.0;
/// Effort (N m or N) and velocity (rad/s or m/s) where the description states none: URDF demands both.
const UNLIMITED: (f64, f64) = (1e6, 1e3);
/// A direction of gravity within this of -z counts as -z.
const LEVEL: f64 = 1e-15;
/// Standard gravity, m/s², which readers of URDF take.
const STANDARD: f64 = 9.81;

/// Files for whatever reads URDF.
pub(crate) fn files(machine: &Machine) -> Result<Vec<File>, ExportError> {
    let text = xml(machine).text().map_err(|error| ExportError::Text {
        name: "robot.urdf",
        error,
    })?;
    Ok(vec![
        File::new("robot.urdf", text),
        File::new("not_expressed.md", list(machine)),
    ])
}

fn xml(machine: &Machine) -> Element {
    let mechanism = &machine.mechanism;
    let mut root = Element::new("robot").with("name", mechanism.name.as_str());
    let base = free_name(machine, "base");
    if let Some(place) = levelled(mechanism.gravity) {
        let world = free_name(machine, "world");
        root.push(Element::new("link").with("name", world.as_str()));
        root.push(
            Element::new("joint")
                .with("name", free_name(machine, "tilt"))
                .with("type", "fixed")
                .child(Element::new("parent").with("link", world))
                .child(Element::new("child").with("link", base.as_str()))
                .child(Element::new("origin").numbers("rpy", &place.rpy())),
        );
    }
    root.push(Element::new("link").with("name", base.as_str()));
    for (index, body) in mechanism.bodies.iter().enumerate() {
        root.push(link(body));
        root.push(joint(machine, index, body, &base));
    }
    root
}

/// A name that no link and no joint has.
fn free_name(machine: &Machine, name: &str) -> String {
    let bodies = &machine.mechanism.bodies;
    let mut name = name.to_owned();
    while bodies.iter().any(|b| b.joint == name || b.link == name) {
        name.push('_');
    }
    name
}

/// The place of the base in a world whose gravity points along -z; `None` where it does already.
fn levelled(gravity: [f64; 3]) -> Option<Place> {
    let size = gravity.iter().map(|x| x * x).sum::<f64>().sqrt();
    if size == 0.0 {
        return None;
    }
    let [x, y, z] = gravity.map(|g| g / size);
    let across = x.hypot(y);
    if across <= LEVEL && z < 0.0 {
        return None;
    }
    // The rotation from the direction of gravity to -z about their common normal, g × (0, 0, -1).
    let axis = match across <= LEVEL {
        true => [1.0, 0.0, 0.0],
        false => [-y / across, x / across, 0.0],
    };
    Some(Place::moved(false, axis, across.atan2(-z)))
}

fn link(body: &Body) -> Element {
    let [xx, yy, zz, xy, xz, yz] = body.inertia;
    let mut inertia = Element::new("inertia");
    for (key, x) in [
        ("ixx", xx),
        ("iyy", yy),
        ("izz", zz),
        ("ixy", xy),
        ("ixz", xz),
        ("iyz", yz),
    ] {
        inertia = inertia.numbers(key, &[x]);
    }
    Element::new("link").with("name", body.link.as_str()).child(
        Element::new("inertial")
            .child(
                Element::new("origin")
                    .numbers("xyz", &body.com)
                    .with("rpy", "0 0 0"),
            )
            .child(Element::new("mass").numbers("value", &[body.mass]))
            .child(inertia),
    )
}

fn joint(machine: &Machine, index: usize, body: &Body, base: &str) -> Element {
    let bodies = &machine.mechanism.bodies;
    let parent = body.parent.map_or(base, |p| bodies[p].link.as_str());
    let kind = match (body.prismatic, body.limits) {
        (true, _) => "prismatic",
        (false, Some(_)) => "revolute",
        (false, None) => "continuous",
    };
    let mut out = Element::new("joint")
        .with("name", body.joint.as_str())
        .with("type", kind)
        .child(Element::new("parent").with("link", parent))
        .child(Element::new("child").with("link", body.link.as_str()))
        .child(
            Element::new("origin")
                .numbers("xyz", &body.origin)
                .numbers("rpy", &body.rpy),
        )
        .child(Element::new("axis").numbers("xyz", &body.axis));
    let mut limit = Element::new("limit");
    if let Some((low, high)) = body.limits.or(body.prismatic.then_some((-FAR, FAR))) {
        limit = limit.numbers("lower", &[low]).numbers("upper", &[high]);
    }
    let coordinate = machine.drives.iter().position(|d| d.body == index);
    out.push(
        limit
            .numbers(
                "effort",
                &[coordinate.map_or(UNLIMITED.0, |c| effort(machine, c))],
            )
            .numbers("velocity", &[UNLIMITED.1]),
    );
    if let Some(c) = coordinate {
        let drive = &machine.drives[c];
        out.push(
            Element::new("dynamics")
                .numbers("damping", &[drive.viscous])
                .numbers("friction", &[drive.coulomb]),
        );
    }
    if let Some(follows) = body.follows {
        out.push(
            Element::new("mimic")
                .with("joint", bodies[follows.body].joint.as_str())
                .numbers("multiplier", &[follows.ratio])
                .numbers("offset", &[follows.offset]),
        );
    }
    out
}

/// Largest torque or force of a drive: where it saturates, or the typical peak.
fn effort(machine: &Machine, c: usize) -> f64 {
    let drive = &machine.drives[c];
    let limit = machine.at("torque_saturation", c);
    let limit = limit.and_then(|e| e.value("limit_input"));
    limit
        .map(|x| (x * drive.gain).abs())
        .or(drive.peak)
        .unwrap_or(UNLIMITED.0)
}

/// What URDF says of an effect; `None`: it has no word for it.
fn expressed(effect: &Named) -> Option<&'static str> {
    match effect.id() {
        "payload" => Some("mass and inertia of the last link"),
        "base_tilt" => Some("origin of the joint between world and base"),
        "torque_saturation" => Some("effort of the joint's limit"),
        _ => None,
    }
}

fn list(machine: &Machine) -> String {
    let mut out = String::from(
        "# What URDF expresses of this robot\n\nURDF has bodies, joints, limits, damping and dry friction. It has no word for \
         drives, sensors and their delays.\n\n| what | joint | robot.urdf |\n|---|---|---|\n",
    );
    let mut row = |what: &str, joint: &str, text: &str| {
        // Writing to a text cannot fail.
        let _ = writeln!(out, "| {what} | {joint} | {text} |");
    };
    for effect in &machine.effects {
        let info = effect.term.effect.info();
        let joint = match info.has_joint {
            true => machine.joint(effect.term.joint),
            false => "whole robot",
        };
        let text = match (expressed(effect), info.urdf) {
            (Some(text), _) => text.to_owned(),
            (None, Some(way)) => format!("nothing; it could stand there as: {way}"),
            (None, None) => "nothing: URDF has no element for it".to_owned(),
        };
        row(info.id, joint, &text);
    }
    for (c, drive) in machine.drives.iter().enumerate() {
        let (name, body) = (machine.joint(c), &machine.mechanism.bodies[drive.body]);
        if let Some(rotor) = body.rotor.filter(|x| *x != 0.0) {
            row(
                "rotor inertia",
                name,
                &format!("nothing: {rotor:.6e} kg m^2 or kg belong into the simulator's armature"),
            );
        }
        let (gain, unit) = (drive.gain, &drive.unit);
        if gain != 1.0 {
            row(
                "gain of the drive",
                name,
                &format!(
                    "nothing: {gain} N m or N per {unit}; inputs of URDF tools are torques and forces"
                ),
            );
        }
        if effort(machine, c) == UNLIMITED.0 {
            row(
                "largest effort",
                name,
                "a number without meaning, 1e6: the description states none",
            );
        }
        row(
            "largest velocity",
            name,
            "a number without meaning, 1000: the description states a typical velocity at most",
        );
    }
    let size = machine.gravity();
    if (size - STANDARD).abs() > 1e-9 {
        row(
            "gravity",
            "whole robot",
            &format!("nothing: set {size} m/s^2 along -z of the world in the simulator"),
        );
    }
    for line in machine.loops_left_out() {
        row("position loop", "", &line);
    }
    for line in &machine.mended {
        row("inertia", "", line);
    }
    out
}
