//! From the text to a [`Mjcf`].

use std::fs;
use std::path::Path;

use pid_derive::mechanism::{Body, Mechanism};
use pid_urdf::names;

use crate::actuator::Actuator;
use crate::body::Carrier;
use crate::defaults::Defaults;
use crate::element::{self, Element};
use crate::error::MjcfError;
use crate::mesh::Meshes;
use crate::place::Angles;
use crate::replicate;

/// A range or none, or a message.
pub(crate) type Range = Result<Option<(f64, f64)>, MjcfError>;

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

/// Elements beside bodies and drives that act on the motion and are not read.
const UNREAD: [(&str, &str); 3] = [
    ("equality", "ties joints or bodies"),
    ("tendon", "pulls on joints"),
    ("deformable", "is no rigid body"),
];

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

/// What was read so far, and what it is read with.
pub(crate) struct Reader {
    pub(crate) angles: Angles,
    pub(crate) autolimits: bool,
    /// Whether inertias come from geoms always, never, or where none are stated.
    pub(crate) from_geoms: Option<bool>,
    /// Groups of geoms that have mass.
    pub(crate) groups: (f64, f64),
    /// Least mass and least principal moment of a body.
    pub(crate) bounds: (f64, f64),
    /// Mass to which all bodies together are scaled.
    total: Option<f64>,
    /// Mass of all bodies so far, those that do not move too.
    pub(crate) weighed: f64,
    pub(crate) defaults: Defaults,
    pub(crate) meshes: Meshes,
    pub(crate) bodies: Vec<Body>,
    /// Names of their joints as written.
    pub(crate) joint_names: Vec<String>,
    /// Names of ball joints as written.
    pub(crate) balls: Vec<String>,
    pub(crate) actuators: Vec<Actuator>,
    pub(crate) warnings: Vec<String>,
}

impl Reader {
    fn new(root: &Element) -> Result<Self, MjcfError> {
        let mut out = Self {
            angles: Angles {
                unit: 1.0_f64.to_radians(),
                sequence: vec!['x', 'y', 'z'],
            },
            autolimits: true,
            from_geoms: None,
            groups: (0.0, 5.0),
            bounds: (0.0, 0.0),
            total: None,
            weighed: 0.0,
            defaults: Defaults::new(root),
            meshes: Meshes::default(),
            bodies: Vec::new(),
            joint_names: Vec::new(),
            balls: Vec::new(),
            actuators: Vec::new(),
            warnings: Vec::new(),
        };
        for compiler in root.all("compiler") {
            match compiler.get("angle") {
                Some("radian") => out.angles.unit = 1.0,
                Some("degree") => out.angles.unit = 1.0_f64.to_radians(),
                None => {}
                Some(_) => return Err(compiler.error("angle", "write \"radian\" or \"degree\"")),
            }
            if let Some(sequence) = compiler.get("eulerseq") {
                let axes: Vec<char> = sequence.chars().collect();
                if axes.len() != 3 || !axes.iter().all(|c| "xyzXYZ".contains(*c)) {
                    return Err(compiler.error("eulerseq", "write three of x, y, z, X, Y, Z"));
                }
                out.angles.sequence = axes;
            }
            match compiler.get("autolimits") {
                Some("false") => out.autolimits = false,
                Some(_) => out.autolimits = true,
                None => {}
            }
            match compiler.get("inertiafromgeom") {
                Some("true") => out.from_geoms = Some(true),
                Some("false") => out.from_geoms = Some(false),
                Some(_) => out.from_geoms = None,
                None => {}
            }
            if let Some([low, high]) = compiler.numbers("inertiagrouprange")? {
                out.groups = (low, high);
            }
            if compiler.get("coordinate") == Some("global") {
                return Err(compiler.unsupported(
                    "has coordinates in the frame of the world",
                    "convert it to local coordinates, as newer versions of MuJoCo ask for too",
                ));
            }
            out.bounds.0 = compiler.number("boundmass")?.unwrap_or(out.bounds.0);
            out.bounds.1 = compiler.number("boundinertia")?.unwrap_or(out.bounds.1);
            let total = compiler.number("settotalmass")?;
            out.total = total.map_or(out.total, |mass| (mass > 0.0).then_some(mass));
            if compiler.get("balanceinertia") == Some("true") {
                out.warn(compiler, "has `balanceinertia`, which is not read");
            }
        }
        Ok(out)
    }

    pub(crate) fn warn(&mut self, element: &Element, what: &str) {
        let (file, line) = (element.file.display(), element.line);
        let message = format!("{file}:{line}: {} {what}", element.item());
        self.warnings.push(message);
    }

    /// Scales masses and inertias to the stated total.
    fn scale(&mut self) {
        let Some(total) = self.total.filter(|_| self.weighed > 0.0) else {
            return;
        };
        let factor = total / self.weighed;
        for body in &mut self.bodies {
            body.mass *= factor;
            body.inertia = body.inertia.map(|x| factor * x);
        }
    }

    fn unread(&mut self, root: &Element) {
        for option in root.all("option") {
            for key in ["density", "viscosity"] {
                if option.get(key).is_some_and(|x| x.parse() != Ok(0.0)) {
                    self.warn(option, &format!("has a fluid (`{key}`), which is not read"));
                }
            }
        }
        for (name, what) in UNREAD {
            for element in root.all(name).flat_map(|e| &e.children) {
                self.warn(element, &format!("{what}; it is not read"));
            }
        }
    }
}
