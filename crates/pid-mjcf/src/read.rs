//! From the text to a [`Mjcf`].

use std::fs;
use std::path::Path;

use pid_derive::mechanism::Mechanism;
use pid_urdf::names;

use crate::actuator::Actuator;
use crate::body::Carrier;
use crate::element::{self, Element};
use crate::error::MjcfError;
use crate::mesh::Meshes;
use crate::reader::Reader;
use crate::replicate;

/// An MJCF model in numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Mjcf {
    /// Moving bodies, depth first, and gravity.
    pub mechanism: Mechanism,
    /// Drives on joints, in the order of the file.
    pub actuators: Vec<Actuator>,
    /// Step of the simulation, s.
    pub timestep: f64,
    /// What is in the file and not in the mechanism, with lines.
    pub warnings: Vec<String>,
}

impl Mjcf {
    /// Reads a file and those that it includes.
    ///
    /// # Errors
    /// If it cannot be read or used; see [`MjcfError`].
    pub fn read(path: impl AsRef<Path>) -> Result<Self, MjcfError> {
        let path = path.as_ref();
        let text = fs::read_to_string(path).map_err(|error| MjcfError::Unreadable {
            file: path.to_owned(),
            error,
        })?;
        Self::parse(path, &text)
    }

    /// Reads a text; `file` is its name in messages, and included files are looked for beside it.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn parse(file: impl AsRef<Path>, text: &str) -> Result<Self, MjcfError> {
        let file = file.as_ref();
        let mut root = element::read(file, text)?;
        let mut reader = Reader::new(&root)?;
        let folder = file.parent().unwrap_or(Path::new(""));
        reader.meshes = Meshes::new(&root, &reader.defaults, &reader.angles, folder)?;
        replicate::expand(&mut root, &reader.angles)?;
        for world in root.all("worldbody") {
            let class = world.get("childclass");
            reader.children(world, Carrier::GROUND, class)?;
        }
        if reader.bodies.is_empty() {
            return Err(MjcfError::NothingMoves {
                file: file.to_owned(),
            });
        }
        reader.scale();
        reader.actuators(&root)?;
        reader.unread(&root);
        names::make_apart(reader.bodies.iter_mut().map(|body| &mut body.joint));
        let mechanism = Mechanism {
            name: names::type_name(root.get("model").unwrap_or("robot")),
            gravity: gravity(&root)?,
            bodies: reader.bodies,
        };
        let list: Vec<String> = (mechanism.without_inertia().into_iter())
            .map(|k| &mechanism.bodies[k])
            .map(|body| format!("`{}` (joint `{}`)", body.link, body.joint))
            .collect();
        if !list.is_empty() {
            return Err(MjcfError::NoInertia {
                file: file.to_owned(),
                list: list.join(", "),
            });
        }
        Ok(Self {
            mechanism,
            actuators: reader.actuators,
            timestep: option::<1>(&root, "timestep")?.map_or(0.002, |[x]| x),
            warnings: reader.warnings,
        })
    }
}

/// Gravity in the frame of the world, unless a flag disables it.
fn gravity(root: &Element) -> Result<[f64; 3], MjcfError> {
    let mut flags = root.all("option").flat_map(|option| option.all("flag"));
    if flags.any(|flag| flag.get("gravity") == Some("disable")) {
        return Ok([0.0; 3]);
    }
    Ok(option(root, "gravity")?.unwrap_or([0.0, 0.0, -9.81]))
}

/// Numbers of the last `<option>` that states them.
fn option<const N: usize>(root: &Element, key: &str) -> Result<Option<[f64; N]>, MjcfError> {
    let mut found = None;
    for element in root.all("option") {
        found = element.numbers(key)?.or(found);
    }
    Ok(found)
}
