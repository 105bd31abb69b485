//! Inertias that no body has: what counts is the body, all links that are fixed to each other
//! together.

use pid_derive::mechanism::{Distribution, InertiaSource, about_axis};
use pid_derive::plausible;

use super::reader::Reader;
use crate::bodies::Rigid;
use crate::description::{Description, Inertial, Motion};
use crate::error::UrdfError;

/// An excess of this size is what writing seven decimals leaves, kg·m².
const ROUNDING: f64 = 1e-7;
/// A correction below this share of what every joint feels changes no motion that is measured.
const INFLUENCE: f64 = 1e-3;

/// Puts the nearest inertia that a body has in place of each other one, with a warning unless it is
/// of no matter.
///
/// # Errors
/// If a mass is negative, or, if `strict`, instead of a warning.
pub(super) fn bodies(
    reader: &Reader<'_>,
    description: &mut Description,
    strict: bool,
) -> Result<(), UrdfError> {
    let bodies = description.rigid();
    let merged: Vec<Distribution> = bodies.iter().map(|b| description.merged(b)).collect();
    let felt = felt(description, &bodies, &merged);
    for (index, (body, &all)) in bodies.iter().zip(&merged).enumerate() {
        // The link of the body that states mass and inertia.
        let mut stated = body
            .links
            .iter()
            .filter(|(link, _)| description.links[*link].inertial.is_some());
        let Some(&(link, place)) = stated.next() else {
            continue;
        };
        let (name, line) = {
            let link = &description.links[link];
            (link.name.clone(), link.places.inertial_line)
        };
        let refused = |fault| UrdfError::Inertia {
            file: reader.file.to_owned(),
            line,
            link: name.clone(),
            fault,
        };
        if all.mass < 0.0 {
            return Err(refused(plausible::Implausible::Mass { mass: all.mass }));
        }
        if !all
            .inertia
            .iter()
            .chain([&all.mass])
            .chain(&all.com)
            .all(|x| x.is_finite())
        {
            let value = f64::INFINITY;
            return Err(refused(plausible::Implausible::NotFinite { value }));
        }
        if all.mass == 0.0 && all.inertia != [0.0; 6] {
            reader.warn(
                line,
                format!("link `{name}` has an inertia but no mass; both are read as they are"),
            );
        }
        let (inertia, excess) = plausible::nearest(all.inertia);
        let largest = plausible::principal_moments(all.inertia)[0].abs();
        // What rounding to four digits explains is that of a body for every other check too.
        if excess <= 1e-4 * largest {
            continue;
        }
        let change: [f64; 6] = std::array::from_fn(|k| inertia[k] - all.inertia[k]);
        if excess > ROUNDING && influence(description, &bodies, &felt, index, change) > INFLUENCE {
            if strict {
                let unphysical = plausible::check(all.mass.max(f64::MIN_POSITIVE), all.inertia);
                return Err(refused(
                    unphysical
                        .err()
                        .unwrap_or(plausible::Implausible::Mass { mass: all.mass }),
                ));
            }
            reader.warn(
                line,
                format!(
                    "link `{name}`: no body has this inertia: its largest principal moment exceeds the sum of the others by \
                     {excess:.3e} kg m^2 ({:.2} %); the nearest inertia that a body has takes its place",
                    100.0 * excess / largest
                ),
            );
            description.links[link].source = InertiaSource::Corrected;
        }
        // The change is that of the whole body; one link of it takes all of it.
        let change = place.inverse().tensor(change);
        if let Some(inertial) = &mut description.links[link].inertial {
            add(inertial, change);
        }
    }
    Ok(())
}

/// Adds a tensor in the axes of the link.
fn add(inertial: &mut Inertial, change: [f64; 6]) {
    let change = inertial.axes().inverse().tensor(change);
    for (entry, change) in inertial.inertia.iter_mut().zip(change) {
        *entry += change;
    }
}

/// Inertia about its axis that each turning joint moves with all joints at zero; infinite for a
/// sliding joint, which no tensor matters to.
fn felt(description: &Description, bodies: &[Rigid], merged: &[Distribution]) -> Vec<f64> {
    let mut carried = merged.to_vec();
    for k in (0..bodies.len()).rev() {
        if let Some(parent) = bodies[k].parent {
            carried[parent] = carried[parent].with(&carried[k].placed(&bodies[k].place));
        }
    }
    let joint = |k: usize| match description.joints[bodies[k].joint].motion {
        Motion::Revolute(axis) => carried[k].felt(false, [0.0; 3], axis).abs(),
        _ => f64::INFINITY,
    };
    (0..bodies.len()).map(joint).collect()
}

/// Largest share by which a change of the tensor of a body changes what a joint feels.
fn influence(
    description: &Description,
    bodies: &[Rigid],
    felt: &[f64],
    index: usize,
    change: [f64; 6],
) -> f64 {
    // About any axis the change is at most the sum of all entries of the tensor.
    let most: f64 = change.iter().map(|x| x.abs()).sum();
    let own = match description.joints[bodies[index].joint].motion {
        Motion::Revolute(axis) => about_axis(change, axis).abs(),
        _ => 0.0,
    };
    let mut largest = 0.0_f64;
    let (mut at, mut size) = (Some(index), own);
    while let Some(k) = at {
        largest = largest.max(if size == 0.0 { 0.0 } else { size / felt[k] });
        (at, size) = (bodies[k].parent, most);
    }
    largest
}
