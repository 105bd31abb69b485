//! Moving links without mass and inertia: named all at once, or guessed from their geometry.

use std::fmt::Write;

use pid_derive::mechanism::InertiaSource;

use super::geometry::Shapes;
use super::reader::Reader;
use crate::description::{Description, Inertial};
use crate::error::UrdfError;
use crate::reading::{Guess, Missing};

/// Mass and inertia of moving bodies without them, from their geometry. A link whose geometry says
/// nothing stays without.
pub(super) fn guess(
    reader: &Reader<'_>,
    description: &mut Description,
    shapes: &[Shapes],
    missing: &Missing,
) {
    let Missing::Guess(guess) = missing else {
        return;
    };
    for body in description.rigid() {
        let all = description.merged(&body);
        if all.mass != 0.0 || all.inertia != [0.0; 6] {
            continue;
        }
        for &(link, _) in &body.links {
            guess_link(reader, description, (link, &shapes[link]), guess);
        }
    }
    let Some(mass) = guess.otherwise.or_else(|| light(description)) else {
        return;
    };
    let bodies = description.rigid();
    for body in description.mechanism([0.0; 3]).without_inertia() {
        let link = bodies[body].links[0].0;
        let mass = guess
            .masses
            .get(&description.links[link].name)
            .copied()
            .unwrap_or(mass);
        stand_in(reader, description, link, (mass, guess.density));
    }
}

/// Share of the robot's mass that a link has of which nothing is known. A nominal description lets a link
/// without mass have up to one hundredth; with a tolerance of the whole this is the middle of that range.
const LIGHT: f64 = 0.005;

/// Mass of a link of which nothing is known, where the other links have one.
fn light(description: &Description) -> Option<f64> {
    let bodies = description.mechanism([0.0; 3]).bodies;
    let all: f64 = bodies.iter().map(|body| body.mass).sum();
    (all > 0.0 && all.is_finite()).then_some(LIGHT * all)
}

/// A rod from the origin of a link to the farthest joint it carries, or a sphere about its origin.
fn stand_in(
    reader: &Reader<'_>,
    description: &mut Description,
    index: usize,
    (mass, density): (f64, f64),
) {
    let length = |x: &[f64; 3]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
    let carried = description
        .joints
        .iter()
        .filter(|joint| joint.parent == index);
    let end = carried
        .map(|joint| joint.origin)
        .max_by(|x, y| length(x).total_cmp(&length(y)))
        .unwrap_or_default();
    let (span, volume) = (length(&end), mass / density);
    let pi = std::f64::consts::PI;
    // A rod thicker than long is none.
    let (inertia, word) = if span.powi(3) > volume {
        let d = end.map(|x| x / span);
        let r2 = volume / (pi * span);
        let (across, along) = (mass * (3.0 * r2 + span * span) / 12.0, 0.5 * mass * r2);
        let entry = |i: usize, j: usize| {
            let unit = if i == j { across } else { 0.0 };
            unit - (across - along) * d[i] * d[j]
        };
        let places = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];
        (
            places.map(|(i, j)| entry(i, j)),
            format!("a rod of {span:.3} m"),
        )
    } else {
        let j = 0.4 * mass * (0.75 * volume / pi).powf(2.0 / 3.0);
        ([j, j, j, 0.0, 0.0, 0.0], "a sphere".to_owned())
    };
    let link = &mut description.links[index];
    link.inertial = Some(Inertial {
        mass,
        com: if word == "a sphere" {
            [0.0; 3]
        } else {
            end.map(|x| 0.5 * x)
        },
        rpy: [0.0; 3],
        inertia,
    });
    link.source = InertiaSource::Guessed;
    reader.warn(
        link.places.line,
        format!(
            "link `{}` has no inertia; {mass:.4} kg is taken as {word}",
            link.name
        ),
    );
}

fn guess_link(
    reader: &Reader<'_>,
    description: &mut Description,
    (index, shapes): (usize, &Shapes),
    guess: &Guess,
) {
    let link = &mut description.links[index];
    let line = link.places.line;
    match shapes.filled(reader.file, guess) {
        Ok(filled) => {
            let volume = filled.distribution.mass;
            let mass = guess.masses.get(&link.name).copied();
            let mass = mass.unwrap_or(guess.density * volume);
            let density = mass / volume;
            link.inertial = Some(Inertial {
                mass,
                com: filled.distribution.com,
                rpy: [0.0; 3],
                inertia: filled.distribution.inertia.map(|x| density * x),
            });
            link.source = InertiaSource::Guessed;
            reader.warn(
                line,
                format!(
                    "link `{}` has no inertia; {mass:.4} kg is guessed from its {} at {density:.0} kg/m^3",
                    link.name, filled.of
                ),
            );
        }
        Err(reason) => reader.warn(
            line,
            format!(
                "link `{}` has no inertia, and none is guessed: {reason}",
                link.name
            ),
        ),
    }
}

/// # Errors
/// If a joint that moves on its own moves nothing that resists: all links of which that is so.
pub(super) fn refuse(
    reader: &Reader<'_>,
    description: &Description,
    missing: &Missing,
) -> Result<(), UrdfError> {
    if *missing == Missing::Keep {
        return Ok(());
    }
    let mechanism = description.mechanism([0.0; 3]);
    let joints: Vec<usize> = description.rigid().iter().map(|body| body.joint).collect();
    let links: Vec<(String, String, u32)> = mechanism
        .without_inertia()
        .into_iter()
        .map(|k| {
            let joint = &description.joints[joints[k]];
            let link = &description.links[joint.child];
            (link.name.clone(), joint.name.clone(), link.places.line)
        })
        .collect();
    let Some(&(_, _, line)) = links.first() else {
        return Ok(());
    };
    let mut list = String::new();
    for (link, joint, _) in &links {
        let comma = if list.is_empty() { "" } else { ", " };
        let _ = write!(list, "{comma}`{link}` (joint `{joint}`)");
    }
    Err(UrdfError::NoInertia {
        file: reader.file.to_owned(),
        line,
        links: links.into_iter().map(|(link, ..)| link).collect(),
        list,
    })
}
