//! `<replicate>`: copies of what stands in it, each in a frame of its own.

use std::collections::BTreeMap;

use pid_derive::mechanism::Place;

use crate::element::Element;
use crate::error::MjcfError;
use crate::place::Angles;

/// Most elements that the copies of a model may have together, their frames among them. MuJoCo's own largest
/// examples have some ten thousand; a count with digits too many is a mistake that would fill the memory.
const MOST: usize = 50_000;
/// Bytes of attributes that count as one more element: about what an element takes without any.
const TEXT: usize = 256;

/// Name before the first copy was made. A blank keeps it apart from attributes of a file.
const ORIGIN: &str = "replica of";

/// Puts the copies in the place of every `<replicate>` of the world, and one drive for each copy of a
/// joint in the place of the drives of the joint.
///
/// Copy k stands in the frame that `offset` and the rotation of the element make when they are done k times,
/// and its names end with `sep` and k, as long as the count (MuJoCo, XML reference, "body/replicate").
///
/// # Errors
/// If a count is none or too large, or a place is none.
pub(crate) fn expand(root: &mut Element, angles: &Angles) -> Result<(), MjcfError> {
    let mut left = MOST;
    for world in root.children.iter_mut().filter(|c| c.name == "worldbody") {
        expand_in(world, angles, &mut left)?;
    }
    let mut copies: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for world in root.all("worldbody") {
        gather(world, &mut copies);
    }
    for drives in root.children.iter_mut().filter(|c| c.name == "actuator") {
        for drive in std::mem::take(&mut drives.children) {
            of_copies(drive, &copies, &mut left, &mut drives.children)?;
        }
    }
    Ok(())
}

fn expand_in(element: &mut Element, angles: &Angles, left: &mut usize) -> Result<(), MjcfError> {
    let mut children = Vec::new();
    for mut child in std::mem::take(&mut element.children) {
        expand_in(&mut child, angles, left)?;
        if child.name == "replicate" {
            copies(&child, angles, left, &mut children)?;
        } else {
            children.push(child);
        }
    }
    element.children = children;
    Ok(())
}

fn copies(
    replicate: &Element,
    angles: &Angles,
    left: &mut usize,
    out: &mut Vec<Element>,
) -> Result<(), MjcfError> {
    let stated = replicate.number("count")?.unwrap_or(0.0);
    let wrong = || replicate.error("count", "write a whole number that is not negative");
    let count = Some(stated).filter(|x| *x >= 0.0 && x.fract() == 0.0);
    let count = count.ok_or_else(wrong)?;
    let all = count * size(replicate) as f64;
    if all > *left as f64 {
        return Err(replicate.error("count", too_many()));
    }
    *left -= all as usize;
    let step = Place {
        origin: replicate.numbers("offset")?.unwrap_or_default(),
        ..angles.place(replicate)?
    };
    let (count, sep) = (count as usize, replicate.get("sep").unwrap_or(""));
    let width = count.to_string().len();
    let mut place = Place::IDENTITY;
    for k in 0..count {
        let mut children = replicate.children.clone();
        let suffix = format!("{sep}{k:0width$}");
        children.iter_mut().for_each(|c| rename(c, &suffix));
        let mut frame = replicate.clone();
        frame.name = "frame".to_owned();
        let class = replicate.get("childclass").map(str::to_owned);
        frame.attributes = vec![
            ("pos".to_owned(), words(&place.origin)),
            ("xyaxes".to_owned(), words(&axes(&place))),
        ];
        frame
            .attributes
            .extend(class.map(|c| ("childclass".to_owned(), c)));
        frame.children = children;
        out.push(frame);
        place = place.then(&step);
    }
    Ok(())
}

/// The x and y axes of a place: the first two columns of its rotation.
fn axes(place: &Place) -> [f64; 6] {
    let r = &place.rotation;
    [r[0][0], r[1][0], r[2][0], r[0][1], r[1][1], r[2][1]]
}

/// Numbers as text that reads back the same.
fn words(numbers: &[f64]) -> String {
    let all: Vec<String> = numbers.iter().map(f64::to_string).collect();
    all.join(" ")
}

/// An element and those below; long attributes count as further ones.
fn size(element: &Element) -> usize {
    let text = element.attributes.iter().map(|(k, v)| k.len() + v.len());
    1 + text.sum::<usize>() / TEXT + element.children.iter().map(size).sum::<usize>()
}

fn rename(element: &mut Element, suffix: &str) {
    if let Some(name) = element.get("name").map(str::to_owned) {
        element.or_set(ORIGIN, &name);
        for (key, value) in &mut element.attributes {
            if key == "name" {
                value.push_str(suffix);
            }
        }
    }
    element.children.iter_mut().for_each(|c| rename(c, suffix));
}

/// Names of the copies of each joint.
fn gather(element: &Element, copies: &mut BTreeMap<String, Vec<String>>) {
    for child in &element.children {
        if child.name == "joint"
            && let (Some(origin), Some(name)) = (child.get(ORIGIN), child.get("name"))
        {
            copies
                .entry(origin.to_owned())
                .or_default()
                .push(name.to_owned());
        }
        gather(child, copies);
    }
}

/// A drive for each copy of its joint, or the drive as it is.
fn of_copies(
    drive: Element,
    copies: &BTreeMap<String, Vec<String>>,
    left: &mut usize,
    out: &mut Vec<Element>,
) -> Result<(), MjcfError> {
    let Some((origin, names)) = (drive.get("joint")).and_then(|j| copies.get_key_value(j)) else {
        out.push(drive);
        return Ok(());
    };
    let all = names.len().saturating_mul(size(&drive));
    let Some(rest) = left.checked_sub(all) else {
        return Err(drive.error("joint", too_many()));
    };
    *left = rest;
    out.extend(names.iter().map(|name| {
        let mut copy = drive.clone();
        let suffix = &name[origin.len()..];
        for (key, value) in &mut copy.attributes {
            if key == "name" || key == "joint" {
                value.push_str(suffix);
            }
        }
        copy
    }));
    Ok(())
}

/// What to do about too many copies.
fn too_many() -> String {
    format!("at most {MOST} elements are made in this way; write a lower count")
}
